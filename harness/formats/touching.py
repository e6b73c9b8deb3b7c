"""Which hidden variables a step touches: what tells whether a file's variables can be the factors of a domain.

A domain's step depends on and changes one hidden factor at most (:mod:`harness.model.tables`). A file says of every
function on which variables it may depend; on which it does, at a visible value and an action, is found by trying all
their values, as long as these are few. Where more would have to be tried, a variable counts that a rule names.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from harness.formats import limits
from harness.formats.network import Network, ordered
from harness.formats.rules import Function, Points, grid, numbered

_MOST = 2**21
"""Combinations of values that are tried for one function."""
Mask = NDArray[np.bool_]


def touched(network: Network, pairs: Points) -> Mask:
    """(n, hidden variables) which are touched by a step from visible values and actions (n, C)."""
    there, origin = _arrivals(network, pairs)
    c, hidden = network.columns, network.hidden
    found = np.zeros((len(there), len(hidden)), dtype=np.bool_)
    others = [network.moves[j] for j in network.visible]
    for function in [*others, *network.seen, *network.paid]:
        found |= _depends(network, function, there)
    for i, j in enumerate(hidden):
        moved = ~_kept(network, network.moves[j], there, c.before(j))
        found[moved] |= _depends(network, network.moves[j], there[moved])
        found[moved, i] = True
    result = np.zeros((len(pairs), len(hidden)), dtype=np.bool_)
    np.logical_or.at(result, origin, found)
    return result


def _arrivals(network: Network, pairs: Points) -> tuple[Points, NDArray[np.int64]]:
    """The pairs with every visible value that a step may lead to, and which pair each is from."""
    points, origin = pairs, np.arange(len(pairs))
    for function in ordered(network, [network.moves[j] for j in network.visible]):
        column = int(function.columns[-1])
        reached = [np.zeros((0, points.shape[1] + 1), dtype=np.int64)]
        for rows, spread in _tried(network, function, points):
            point, value, _ = function.spread(spread)
            arrived = points[rows[point]]
            arrived[:, column] = value
            reached.append(np.column_stack([origin[rows[point]], arrived]))
        every = np.concatenate(reached)
        _, first = np.unique(numbered(every, [0, *_seen(network)]), return_index=True)
        points, origin = every[first, 1:], every[first, 0]
    return points, origin


def _seen(network: Network) -> list[int]:
    """Columns, one further to the right, of what is visible after the step."""
    return [1 + network.columns.after(j) for j in network.visible]


def correlated(network: Network, points: Points) -> Mask:
    """(hidden, hidden) whether one hidden variable's start depends on another's, at visible starts (n, C)."""
    c, hidden = network.columns, network.hidden
    result = np.zeros((len(hidden), len(hidden)), dtype=np.bool_)
    columns = [c.before(j) for j in hidden]
    for i, j in enumerate(hidden):
        result[i] = _varies(network.start[j], points, columns, []).any(axis=0)
    return result


def _depends(network: Network, function: Function, points: Points) -> Mask:
    """(n, hidden) whether it depends on a hidden variable, before or after the step."""
    c, hidden = network.columns, network.hidden
    before, after = [c.before(j) for j in hidden], [c.after(j) for j in hidden]
    readings = [c.reading(i) for i in range(c.readings)]
    varies = _varies(function, points, [*before, *after], readings)
    return varies[:, : len(hidden)] | varies[:, len(hidden) :]


def _varies(function: Function, points: Points, free: Sequence[int], also: Sequence[int]) -> Mask:
    """(n, len(free)) whether it varies with each of some variables, at any value of them all and of ``also``."""
    varies = np.zeros((len(points), len(free)), dtype=np.bool_)
    columns = [x for x in (*free, *also) if x in function.inputs]
    live = _live(function, points, columns)
    place = [free.index(x) if x in free else -1 for x in columns]
    for rows, names, sizes in _alike(function, live, columns):
        shown = [place[columns.index(x)] for x in names]
        if len(rows) * math.prod(sizes) > _MOST:
            changes = [np.ones(len(rows), dtype=np.bool_)] * len(names)
        else:
            said = _said(function, grid(points[rows], names, sizes)).reshape(len(rows), *sizes)
            changes = [_changes(said, axis + 1) for axis in range(len(names))]
        for i, changed in zip(shown, changes, strict=True):
            if i >= 0:
                varies[rows, i] = changed
    return varies


def _changes(said: NDArray[np.int64], axis: int) -> Mask:
    """(n,) whether a table (n, …) varies along an axis."""
    differs = said != said.take([0], axis)
    return differs.reshape(len(said), -1).any(axis=1)


def _alike(
    function: Function, live: Mask, columns: Sequence[int]
) -> Iterator[tuple[NDArray[np.int64], list[int], list[int]]]:
    """The points at which the same columns are live: their numbers, these columns and their sizes."""
    size = dict(zip(function.columns.tolist(), function.sizes, strict=True))
    if not live.size:
        return
    patterns, which = np.unique(live, axis=0, return_inverse=True)
    for i, pattern in enumerate(patterns):
        if pattern.any():
            names = [x for x, there in zip(columns, pattern, strict=True) if there]
            yield np.flatnonzero(which.reshape(-1) == i), names, [size[x] for x in names]


def _live(function: Function, points: Points, free: Sequence[int]) -> Mask:
    """(n, len(free)) whether a rule names a variable that may decide at a point."""
    live, last = np.zeros((len(points), len(free)), dtype=np.bool_), function.columns[-1]
    for group in function.groups:
        columns = function.columns[group.named]
        known = ~np.isin(columns, [*free, *([] if function.is_value else [last])])
        fits = np.isin(points[:, columns[known]] @ group.strides[known], group.part(known))
        live |= fits[:, None] & np.isin(free, columns)
    return live


def _said(function: Function, points: Points) -> NDArray[np.int64]:
    """(n,) a number for each different value, or distribution, that the function has at the points."""
    if function.is_value:
        return np.unique(function.values(points), return_inverse=True)[1].reshape(-1)
    return alike(len(points), *function.spread(points))[0]


def alike(
    n: int, point: NDArray[np.int64], value: NDArray[np.int64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.int64], list[int]]:
    """Numbers of n sparse distributions, equal for equal ones, and of each number the first that has it.

    Entries lie together point by point.
    """
    begins = np.searchsorted(point, np.arange(n + 1)).tolist()
    values, weights = value.tobytes(), weight.tobytes()
    known: dict[tuple[bytes, bytes], int] = {}
    firsts: list[int] = []
    numbers = np.empty(n, dtype=np.int64)
    for i, (a, b) in enumerate(itertools.pairwise(begins)):
        number = known.setdefault((values[8 * a : 8 * b], weights[8 * a : 8 * b]), len(known))
        if number == len(firsts):
            firsts.append(i)
        numbers[i] = number
    return numbers, firsts


def _tried(network: Network, function: Function, points: Points) -> Iterator[tuple[NDArray[np.int64], Points]]:
    """Points with all values of the hidden variables that may decide there, and of which point each is."""
    c = network.columns
    free = [x for j in network.hidden for x in (c.before(j), c.after(j)) if x in function.inputs]
    live = _live(function, points, free)
    still = np.flatnonzero(~live.any(axis=1))
    yield still, points[still]
    for rows, names, sizes in _alike(function, live, free):
        what = f"{network.file}: the cases of {network.names(int(function.columns[-1])).name}"
        limits.check(what, len(rows) * math.prod(sizes), limits.LARGEST_OUTCOMES, "let it depend on fewer variables")
        yield np.repeat(rows, math.prod(sizes)), grid(points[rows], names, sizes)


def _kept(network: Network, function: Function, points: Points, before: int) -> Mask:
    """(n,) whether a hidden variable surely keeps its value."""
    if before not in function.inputs:
        return np.full(len(points), len(network.names(before)) == 1)
    c = network.columns
    free = [x for j in network.hidden for x in (c.before(j), c.after(j)) if x in function.inputs]
    live = _live(function, points, free)
    kept = np.zeros(len(points), dtype=np.bool_)
    live[:, free.index(before)] = True
    for rows, names, sizes in _alike(function, live, free):
        if len(rows) * math.prod(sizes) <= _MOST:
            tried = grid(points[rows], names, sizes)
            point, value, weight = function.spread(tried)
            same = np.zeros(len(tried), dtype=np.bool_)
            same[point] = (value == tried[point, before]) & (weight == 1)
            same &= np.bincount(point, minlength=len(tried)) == 1
            kept[rows] = same.reshape(len(rows), -1).all(axis=1)
    return kept
