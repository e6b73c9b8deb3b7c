"""The product-grid upper bound: the optimal value can be no larger than that of an MDP over a few beliefs a factor.

A step moves the belief of one factor, along a straight line or within a small simplex, and the optimal value V* is
convex there; so V*(posterior) is at most a mixture of V* at levels (:mod:`harness.solver.levels`), and the backup

    U(v, g) ← max_a R(v, g, a) + γ Σ_branches Pr(branch) Σ_m w_m U(v', g with level m)

keeps U above V* wherever it was. With the corners only this is the fully observed problem; with {0, ½, 1} a reading
either tells all or nothing.

**Why the numbers are bounds, after rounding too.** Each stored value is at least V* at its belief; by induction over
the updates. At first all values are the largest reward over 1 − γ, or mixtures of valid values. A backup of valid
values is valid (V* = T V* ≤ T U), and so is one in which an action's own share s of the same cell is solved for,
(rest)/(1 − s): V* ≤ rest + s·V*. Moves that touch no factor are solved within a cell, from below, to a residual; the
residual over 1 − γ is added. Sums run in float64 over at most some hundred terms, whose rounding is below ``slack``,
added before the value is rounded up to float32. The minimum of the old and the new value, both valid, is kept: bounds
only fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined
from harness.solver.levels import Levels, mixture

UP = 1.2e-7
"""Relative; more than half the spacing of float32, so that what is rounded to it after the addition is not below."""


class Above(NamedTuple):
    """The product grid, to be asked for an upper bound anywhere.

    A whole grid has a row for every cell, in their order. A sparse one has rows for the cells met so far, found by a
    hash table; what it does not hold lies between the rows of a coarser whole grid, the base. L levels in all.
    """

    value: NDArray[np.float32]
    """(rows, V); in a sparse grid, row 0 is for what is not kept"""
    offset: NDArray[np.int64]
    point: NDArray[np.float64]
    stride: NDArray[np.int64]
    table: NDArray[np.int64]
    """Open addressing: rows by the hash of their cells, 0: free. A power of two long; empty in a whole grid."""
    cell: NDArray[np.int64]
    """(rows,) of a sparse grid"""
    used: NDArray[np.int64]
    """(1,) rows in use, of a sparse grid"""
    base: NDArray[np.float32]
    """(base's cells, V)"""
    base_first: NDArray[np.int64]
    """(L + 1,) each level as a mixture of the base's levels: where its entries begin"""
    base_step: NDArray[np.int64]
    """(entries,) what the base's level adds to the number of a cell"""
    base_share: NDArray[np.float64]
    """(entries,)"""


def whole(value: NDArray[np.float32], levels: Levels) -> Above:
    """A grid that has all cells."""
    none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
    return Above(
        value, levels.offset, levels.point, levels.stride, none, none, none, value[:0], none, none, nothing
    )  # fmt: skip


def sparse(base: NDArray[np.float32], old: Levels, new: Levels, sizes: Sequence[int], rows: int) -> Above:
    """A grid of more levels over a whole one, with room for so many rows and none in use."""
    first, steps, shares = [0], [], []
    for k, n in enumerate(sizes):
        points = new.point[new.offset[k] : new.offset[k + 1]]
        for level, share, count in zip(*_mixtures(old.offset, old.point, k, n, points), strict=True):
            steps.append(level[:count] * old.stride[k])
            shares.append(share[:count])
            first.append(first[-1] + int(count))
    return Above(
        np.empty((rows, base.shape[1]), dtype=np.float32),
        new.offset,
        new.point,
        new.stride,
        np.zeros(1 << int(np.ceil(np.log2(2 * rows))), dtype=np.int64),
        np.zeros(rows, dtype=np.int64),
        np.ones(1, dtype=np.int64),
        base,
        np.array(first),
        np.concatenate(steps),
        np.concatenate(shares),
    )


def roomier(above: Above, rows: int) -> Above:
    """The same sparse grid with room for more rows."""
    used = int(above.used[0])
    value, cell = np.empty((rows, above.value.shape[1]), dtype=np.float32), np.zeros(rows, dtype=np.int64)
    value[:used], cell[:used] = above.value[:used], above.cell[:used]
    table = np.zeros(1 << int(np.ceil(np.log2(2 * rows))), dtype=np.int64)
    larger = above._replace(value=value, cell=cell, table=table)
    _rehash(larger)
    return larger


@compiled
def _rehash(above: Above) -> None:
    for row in range(1, above.used[0]):
        above.table[_slot(above, above.cell[row])] = row


@compiled
def carry(old: Above, new: Above, place: NDArray[np.int64]) -> None:
    """Copy the rows of a sparse grid to one of more levels; ``place`` (L,): each level among the new ones."""
    for row in range(1, old.used[0]):
        rest, cell = old.cell[row], np.int64(0)
        for k in range(len(old.stride)):
            level = old.offset[k] + rest // old.stride[k]
            rest -= (rest // old.stride[k]) * old.stride[k]
            cell += place[level] * new.stride[k]
        new.cell[row] = cell
        new.value[row] = old.value[row]
    new.used[0] = old.used[0]
    _rehash(new)


@inlined
def _slot(above: Above, cell: int) -> int:
    """Where in the table a cell is, or would be."""
    mask = len(above.table) - 1
    slot = np.int64((np.uint64(cell) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(20)) & mask
    while above.table[slot] > 0 and above.cell[above.table[slot]] != cell:
        slot = (slot + 1) & mask
    return int(slot)


@inlined
def row_of(above: Above, cell: int) -> int:
    """The row of a cell. In a sparse grid one is made from the base if there is none, and kept if there is room."""
    if len(above.table) == 0:
        return cell
    slot = _slot(above, cell)
    row = above.table[slot]
    if row == 0:
        if above.used[0] < len(above.cell):
            row = above.used[0]
            above.used[0] += 1
            above.cell[row] = cell
            above.table[slot] = row
        _fill(above, cell, row)
    return row


@inlined
def _value_at(above: Above, cell: int, v: int) -> float:
    """The upper bound at a cell, whether the grid holds it or not."""
    if len(above.table) == 0:
        return np.float64(above.value[cell, v])
    row = above.table[_slot(above, cell)]
    if row > 0:
        return np.float64(above.value[row, v])
    return _between(above, cell, v)


@compiled
def _between(above: Above, cell: int, v: int) -> float:
    """The base's mixture for a cell."""
    K, size = len(above.stride), 1
    level, rest = np.empty(K, dtype=np.int64), cell
    for k in range(K):
        level[k] = above.offset[k] + rest // above.stride[k]
        rest -= (rest // above.stride[k]) * above.stride[k]
        size *= above.base_first[level[k] + 1] - above.base_first[level[k]]
    total, width = 0.0, 0.0
    for i in range(size):
        rest, there, weight = i, 0, 1.0
        for k in range(K):
            first = above.base_first[level[k]]
            count = above.base_first[level[k] + 1] - first
            there += above.base_step[first + rest % count]
            weight *= above.base_share[first + rest % count]
            rest //= count
        term = weight * np.float64(above.base[there, v])
        total += term
        width += abs(term)
    return total + (size + 2 * K) * 2.0**-52 * width


@compiled
def _fill(above: Above, cell: int, row: int) -> None:
    """Write the base's mixture for a cell to a row."""
    V, K, size = above.value.shape[1], len(above.stride), 1
    for again in range(2):
        if again == 1:
            cells, weights = np.zeros(size, dtype=np.int64), np.ones(size)
        rest, total = cell, 1
        for k in range(K):
            level = above.offset[k] + rest // above.stride[k]
            rest -= (rest // above.stride[k]) * above.stride[k]
            first, count = above.base_first[level], above.base_first[level + 1] - above.base_first[level]
            for e in range(count - 1 if again == 1 else -1, -1, -1):
                for i in range(total):
                    cells[e * total + i] = cells[i] + above.base_step[first + e]
                    weights[e * total + i] = weights[i] * above.base_share[first + e]
            total *= count
        size = total
    sums, sizes = np.zeros(V), np.zeros(V)
    for i in range(size):
        there, weight = above.base[cells[i]], weights[i]
        for v in range(V):
            sums[v] += weight * np.float64(there[v])
            sizes[v] += weight * abs(np.float64(there[v]))
    mine = above.value[row]
    for v in range(V):
        mine[v] = np.float32(sums[v] + (UP + (size + K) * 2.0**-52) * sizes[v])


@inlined
def spread(
    above: Above,
    factor_offset: NDArray[np.int64],
    belief: NDArray[np.float64],
    without: int,
    cells: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> int:
    """Write a belief (N,) as a mixture of cells, their numbers and weights; how many it took.

    Factor ``without`` (−1: none) is left at its level 0. The arrays must hold what :func:`widest` says.
    """
    size = above.point.shape[1] + 1
    level, share = np.zeros(size, dtype=np.int64), np.zeros(size)
    cells[0], weights[0], total = 0, 1.0, 1
    for k in range(len(above.stride)):
        if k != without:
            n = factor_offset[k + 1] - factor_offset[k]
            count = mixture(above.offset, above.point, k, n, belief, factor_offset[k], level, share)
            for e in range(count - 1, -1, -1):  # the first one last, as it is written over what is read
                for i in range(total):
                    cells[e * total + i] = cells[i] + level[e] * above.stride[k]
                    weights[e * total + i] = weights[i] * share[e]
            total *= count
    return total


@inlined
def widest(above: Above, factor_offset: NDArray[np.int64], belief: NDArray[np.float64]) -> int:
    """Cells that a belief (N,) is a mixture of."""
    size, total = above.point.shape[1] + 1, 1
    level, share = np.zeros(size, dtype=np.int64), np.zeros(size)
    for k in range(len(above.stride)):
        n = factor_offset[k + 1] - factor_offset[k]
        total *= mixture(above.offset, above.point, k, n, belief, factor_offset[k], level, share)
    return total


@inlined
def mixed(
    above: Above, cells: NDArray[np.int64], weights: NDArray[np.float64], count: int, shift: int, v: int
) -> float:
    """The grid's upper bound at a mixture of cells, all moved by ``shift``; its rounding is added."""
    total, size = 0.0, 0.0
    for i in range(count):
        term = weights[i] * _value_at(above, cells[i] + shift, v)
        total += term
        size += abs(term)
    return total + (count + 2 * len(above.stride) + 10) * 2.0**-52 * size


@compiled
def grid_value(above: Above, factor_offset: NDArray[np.int64], v: int, belief: NDArray[np.float64]) -> float:
    """The grid's upper bound at any belief: the mixture over the levels of every factor."""
    size = widest(above, factor_offset, belief)
    cells, weights = np.empty(size, dtype=np.int64), np.empty(size)
    return mixed(above, cells, weights, spread(above, factor_offset, belief, -1, cells, weights), 0, v)


def finer(value: NDArray[np.float32], old: Levels, new: Levels, sizes: Sequence[int]) -> NDArray[np.float32]:
    """The old grid's values (cells, V) on a grid with more levels: mixtures, along one factor at a time."""
    counts = [int(n) for n in old.counts]
    for k, n in enumerate(sizes):
        points = new.point[new.offset[k] : new.offset[k + 1]]
        counts[k] = len(points)
        if len(points) > old.counts[k]:
            after = int(np.prod(counts[k + 1 :])) * value.shape[1]
            shaped = value.reshape(-1, int(old.counts[k]), after)
            value = _along(shaped, *_mixtures(old.offset, old.point, k, n, points)).reshape(-1, value.shape[1])
    return value


@compiled
def _mixtures(
    offset: NDArray[np.int64], point: NDArray[np.float64], k: int, n: int, points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """For each of the points (P, largest factor) its mixture of old levels: levels (P, n + 1), weights, how many."""
    level, weight = np.zeros((len(points), n + 1), dtype=np.int64), np.zeros((len(points), n + 1))
    count = np.zeros(len(points), dtype=np.int64)
    for i in range(len(points)):
        count[i] = mixture(offset, point, k, n, points[i], 0, level[i], weight[i])
    return level, weight, count


@compiled
def _along(
    coarse: NDArray[np.float32], level: NDArray[np.int64], weight: NDArray[np.float64], count: NDArray[np.int64]
) -> NDArray[np.float32]:
    """(before, levels, after) → (before, points, after); rounded up, but for points that are levels."""
    fine = np.empty((coarse.shape[0], len(count), coarse.shape[2]), dtype=np.float32)
    for i in range(coarse.shape[0]):
        for p in range(len(count)):
            for j in range(coarse.shape[2]):
                if count[p] == 1:
                    fine[i, p, j] = coarse[i, level[p, 0], j]
                else:
                    total, size = 0.0, 0.0
                    for e in range(count[p]):
                        term = weight[p, e] * np.float64(coarse[i, level[p, e], j])
                        total += term
                        size += abs(term)
                    fine[i, p, j] = np.float32(total + UP * size)
    return fine
