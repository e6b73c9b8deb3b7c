"""Belief levels: the few beliefs of each hidden factor that the product grid holds, and how others lie between them.

The optimal value is convex in the belief, so that at a belief which is a mixture of levels it is at most the mixture of
the values there, whatever the mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.indexing import strides
from harness.model.tables import lean

Point = tuple[float, ...]


class Levels(NamedTuple):
    """The levels of K factors; L of them in all."""

    offset: NDArray[np.int64]
    """(K + 1,) first level of each factor, counted through."""
    point: NDArray[np.float64]
    """(L, largest factor) beliefs, zero beyond the factor's size. A factor's corners are among its levels. Those of a
    factor with two values are in the order of the second value's probability; otherwise the corners come first."""
    stride: NDArray[np.int64]
    """(K,) of each factor in the number of a cell."""

    @property
    def counts(self) -> NDArray[np.int64]:
        """(K,) levels of each factor."""
        return np.diff(self.offset)

    @property
    def cells(self) -> int:
        """Combinations of levels, for each visible value."""
        return int(np.prod(self.counts))


def make(points: Sequence[Sequence[Point]]) -> Levels:
    """Levels from lists of beliefs, one list a factor, beside the corners, which are always there."""
    lists = [_ordered(list(factor)) for factor in points]
    counts = np.array([len(factor) for factor in lists], dtype=np.int64)
    widest = max((len(factor[0]) for factor in lists), default=1)
    table = np.zeros((int(counts.sum()), widest))
    for i, point in enumerate(point for factor in lists for point in factor):
        table[i, : len(point)] = point
    offset = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    stride = strides(counts)
    return Levels(offset, table, stride)


def corners(sizes: Sequence[int]) -> list[list[Point]]:
    """Only certainty, for factors of the given sizes."""
    return [[tuple(row) for row in np.eye(n)] for n in sizes]


def places(old: Levels, new: Levels) -> NDArray[np.int64]:
    """(L,) where each of the old levels is among its factor's new ones, which hold them all."""
    found = []
    for k in range(len(old.stride)):
        mine = new.point[new.offset[k] : new.offset[k + 1]].tolist()
        found += [mine.index(point) for point in old.point[old.offset[k] : old.offset[k + 1]].tolist()]
    return np.array(found, dtype=np.int64)


def _ordered(points: list[Point]) -> list[Point]:
    n = len(points[0])
    certain = [tuple(row) for row in np.eye(n).tolist()]
    others = sorted({tuple(map(float, p)) for p in points} - set(certain))
    return sorted([*certain, *others], key=lambda p: p[1]) if n == 2 else [*certain, *others]


@lean
def mixture(
    offset: NDArray[np.int64],
    point: NDArray[np.float64],
    k: int,
    n: int,
    belief: NDArray[np.float64],
    first: int,
    level: NDArray[np.int64],
    weight: NDArray[np.float64],
) -> int:
    """Write belief ``belief[first : first + n]`` of factor ``k`` as a mixture of its levels; how many it took.

    Two values: the two neighbours. More: the inner level that can carry most of it, the rest on the corners (the
    sawtooth). ``level`` (numbered within the factor) and ``weight`` must hold n + 1 entries.
    """
    low, count = offset[k], 0
    if n == 2:
        b = belief[first + 1]
        i = low
        while i < offset[k + 1] - 2 and b >= point[i + 1, 1]:
            i += 1
        share = (b - point[i, 1]) / (point[i + 1, 1] - point[i, 1])
        if share < 1.0:
            level[0], weight[0] = i - low, 1.0 - share
            count = 1
        if share > 0.0:
            level[count], weight[count] = i + 1 - low, share
            count += 1
    else:
        best, carried = -1, 0.0
        for i in range(low + n, offset[k + 1]):
            share = 1.0
            for x in range(n):
                if point[i, x] > 0.0:
                    share = min(share, belief[first + x] / point[i, x])
            if share > carried:
                best, carried = i, share
        if best >= 0:
            level[0], weight[0] = best - low, carried
            count = 1
        for x in range(n):
            rest = belief[first + x] - (carried * point[best, x] if best >= 0 else 0.0)
            if rest > 1e-15:
                level[count], weight[count] = x, rest
                count += 1
    return count
