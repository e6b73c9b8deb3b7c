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

**How the search reads it.** A belief is a mixture of cells, of up to 2^m where m factors lie between levels. Most of a
sparse grid's cells are what its base says, and a mixture of mixtures along the same lines is one mixture of the base;
so the search asks the base once, from a copy where all cells of a visible value lie together, and takes off by how much
the rows that the sparse grid holds are lower than they were when made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined, lean
from harness.solver.levels import Levels, mixture

UP = 1.2e-7
"""Relative; more than half the spacing of float32, so that what is rounded to it after the addition is not below."""


class Above(NamedTuple):
    """The product grid, to be asked for an upper bound anywhere.

    A whole grid has a row for every cell, in their order. A sparse one has rows for the cells met so far, found by a
    hash table; what it does not hold lies between the rows of a coarser whole grid, the base. L levels in all. A whole
    grid is its own base.
    """

    value: NDArray[np.float32]
    """(rows, V); in a sparse grid, row 0 is for what is not kept"""
    fill: NDArray[np.float32]
    """(rows, V) of a sparse grid: what a row was when it was made, the base's mixture"""
    across: NDArray[np.float32]
    """(V, base's cells): the base as it was when the search last began, in the order in which the search reads it"""
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
    none, rows, entries = np.zeros(0, dtype=np.int64), value[:0], int(levels.offset[-1])
    steps = [np.arange(n) * stride for n, stride in zip(levels.counts, levels.stride, strict=True)]
    return Above(
        value,
        rows,
        np.ascontiguousarray(value.T),
        levels.offset,
        levels.point,
        levels.stride,
        none,
        none,
        none,
        rows,
        np.arange(entries + 1),
        np.concatenate([none, *steps]),
        np.ones(entries),
    )


def sparse(
    base: NDArray[np.float32],
    across: NDArray[np.float32],
    old: Levels,
    new: Levels,
    sizes: Sequence[int],
    rows: int,
) -> Above:
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
        np.empty((rows, base.shape[1]), dtype=np.float32),
        across,
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
    used, shape = int(above.used[0]), (rows, above.value.shape[1])
    value, fill = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)
    cell = np.zeros(rows, dtype=np.int64)
    value[:used], fill[:used], cell[:used] = above.value[:used], above.fill[:used], above.cell[:used]
    table = np.zeros(1 << int(np.ceil(np.log2(2 * rows))), dtype=np.int64)
    larger = above._replace(value=value, fill=fill, cell=cell, table=table)
    _rehash(larger)
    return larger


@compiled
def _rehash(above: Above) -> None:
    for row in range(1, above.used[0]):
        above.table[slot_of(above.table, above.cell, above.cell[row])] = row


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
        new.fill[row] = old.fill[row]
    new.used[0] = old.used[0]
    _rehash(new)


@lean
def slot_of(table: NDArray[np.int64], cells: NDArray[np.int64], cell: int) -> int:
    """Where in the table of a sparse grid a cell is, or would be; ``cells``: the grid's ``cell``."""
    mixed_up = np.uint64(cell) * np.uint64(0x9E3779B97F4A7C15)
    mixed_up = (mixed_up ^ (mixed_up >> np.uint64(32))) * np.uint64(0xD6E8FEB86659FD93)
    mask = len(table) - 1
    slot = np.int64(mixed_up >> np.uint64(32)) & mask
    while table[slot] > 0 and cells[table[slot]] != cell:
        slot = (slot + 1) & mask
    return int(slot)


@lean
def row_of(table: NDArray[np.int64], cells: NDArray[np.int64], cell: int) -> int:
    """The row of a cell; −1 where a sparse grid has none. ``table``, ``cells``: the grid's ``table`` and ``cell``.

    These and not the grid, as Numba counts references to all arrays of a tuple at every call that is given one.
    """
    if len(table) == 0:
        return cell
    row = table[slot_of(table, cells, cell)]
    return int(row) if row > 0 else -1


@compiled
def made(above: Above, cell: int) -> int:
    """A new row, from the base, of a cell that has none; row 0, which is not kept, where there is no room."""
    row = 0
    if above.used[0] < len(above.cell):
        slot, row = slot_of(above.table, above.cell, cell), int(above.used[0])
        above.used[0] += 1
        above.cell[row] = cell
        above.table[slot] = row
    _fill(above, cell, row)
    return row


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
    base, value, fill = above.base, above.value, above.fill
    sums, sizes = np.zeros(V), np.zeros(V)
    for i in range(size):
        there, weight = cells[i], weights[i]
        for v in range(V):
            sums[v] += weight * np.float64(base[there, v])
            sizes[v] += weight * abs(np.float64(base[there, v]))
    for v in range(V):
        fill[row, v] = np.float32(sums[v] + (UP + (size + K) * 2.0**-52) * sizes[v])
        value[row, v] = fill[row, v]


class Parts(NamedTuple):
    """A belief as mixtures of levels, factor by factor, and a place for one more factor's. K factors."""

    step: NDArray[np.int64]
    """(K + 1, E) what each level adds to the number of a cell"""
    share: NDArray[np.float64]
    """(K + 1, E)"""
    counts: NDArray[np.int64]
    """(K + 1,) levels that a factor's belief is a mixture of"""
    level: NDArray[np.int64]
    weight: NDArray[np.float64]
    """(E,) both: to write to on the way"""


@inlined
def room_for(above: Above) -> Parts:
    """Parts of all factors, to be written by :func:`write_parts`, and a place more."""
    places, size = len(above.stride) + 1, (above.point.shape[1] + 1) ** 2
    return Parts(
        np.zeros((places, size), dtype=np.int64),
        np.zeros((places, size)),
        np.ones(places, dtype=np.int64),
        np.zeros(size, dtype=np.int64),
        np.zeros(size),
    )


@lean
def write_parts(
    above: Above,
    factor_offset: NDArray[np.int64],
    belief: NDArray[np.float64],
    factors: tuple[int, int],
    fine: bool,
    parts: Parts,
    at: int,
) -> None:
    """Write the beliefs of factors ``factors[0] … factors[1] − 1`` as mixtures of levels, from place ``at`` on.

    The levels are the grid's own (``fine``), or those of its base that these are mixtures of. ``belief`` (N,).
    """
    offset, point, stride = above.offset, above.point, above.stride
    base_first, base_step, base_share = above.base_first, above.base_step, above.base_share
    step, share, counts, level, weight = parts.step, parts.share, parts.counts, parts.level, parts.weight
    for k in range(factors[0], factors[1]):
        n, found = factor_offset[k + 1] - factor_offset[k], 0
        count = mixture(offset, point, k, n, belief, factor_offset[k], level, weight)
        for e in range(count):
            if fine:
                step[at, e], share[at, e] = level[e] * stride[k], weight[e]
            else:
                own = offset[k] + level[e]
                for i in range(base_first[own], base_first[own + 1]):
                    same = 0
                    while same < found and step[at, same] != base_step[i]:
                        same += 1
                    if same == found:
                        step[at, found], share[at, found] = base_step[i], 0.0
                        found += 1
                    share[at, same] += weight[e] * base_share[i]
        counts[at] = count if fine else found
        at += 1


@inlined
def parts_of(above: Above, factor_offset: NDArray[np.int64], belief: NDArray[np.float64], fine: bool) -> Parts:
    """A belief (N,) as mixtures of the levels of the grid (``fine``) or of its base."""
    parts = room_for(above)
    write_parts(above, factor_offset, belief, (0, len(above.stride)), fine, parts, 0)
    return parts


@lean
def widest(parts: Parts) -> int:
    """Cells that the belief is a mixture of."""
    total = 1
    for k in range(len(parts.counts) - 1):
        total *= parts.counts[k]
    return total


@lean
def spread(parts: Parts, without: int, cells: NDArray[np.int64], weights: NDArray[np.float64]) -> int:
    """Write the belief as a mixture of cells; how many it took. The arrays must hold :func:`widest`.

    Factor ``without`` (−1: none) is left at its level 0.
    """
    steps, shares, counts = parts.step, parts.share, parts.counts
    cells[0], weights[0], total = 0, 1.0, 1
    for k in range(len(counts) - 1):
        if k != without:
            for e in range(counts[k] - 1, -1, -1):  # the first one last, as it is written over what is read
                step, share = steps[k, e], shares[k, e]
                for i in range(total):
                    cells[e * total + i] = cells[i] + step
                    weights[e * total + i] = weights[i] * share
            total *= counts[k]
    return total


@lean
def mixed(
    across: NDArray[np.float32],
    cells: NDArray[np.int64],
    weights: NDArray[np.float64],
    count: int,
    shift: int,
    v: int,
    roundings: int,
) -> float:
    """The base's upper bound at a mixture of its cells, all moved by ``shift``; its rounding is added.

    ``across``: of the grid; ``roundings``: of a weight (:func:`roundings`).
    """
    total, size = 0.0, 0.0
    for i in range(count):
        term = weights[i] * np.float64(across[v, cells[i] + shift])
        total += term
        size += abs(term)
    return total + (count + roundings) * 2.0**-52 * size


@lean
def dropped(
    above: Above, cells: NDArray[np.int64], weights: NDArray[np.float64], count: int, shift: int, v: int
) -> float:
    """How much lower than the base a sparse grid is at a mixture of its own cells; rounding is taken off.

    A row that it does not hold is what the base says, so that only those which it holds count.
    """
    table, held, fill, value, total = above.table, above.cell, above.fill, above.value, 0.0
    for i in range(count):
        row = table[slot_of(table, held, cells[i] + shift)]
        if row > 0:
            before = np.float64(fill[row, v])
            total += weights[i] * max(0.0, before - np.float64(value[row, v]) - 2.0 * UP * abs(before))
    return total * (1.0 - (count + roundings(above)) * 2.0**-52)


@lean
def roundings(above: Above) -> int:
    """Of a weight of a mixture, at most."""
    return 4 * len(above.stride) + 20


@compiled
def cells_of(
    above: Above, factor_offset: NDArray[np.int64], belief: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The cells of the grid that a belief is a mixture of, and their weights."""
    parts = parts_of(above, factor_offset, belief, True)
    cells, weights = np.empty(widest(parts), dtype=np.int64), np.empty(widest(parts))
    spread(parts, -1, cells, weights)
    return cells, weights


@compiled
def grid_value(above: Above, factor_offset: NDArray[np.int64], v: int, belief: NDArray[np.float64]) -> float:
    """The grid's upper bound at any belief: the mixture over the levels of every factor."""
    parts = parts_of(above, factor_offset, belief, False)
    cells, weights = np.empty(widest(parts), dtype=np.int64), np.empty(widest(parts))
    value = mixed(above.across, cells, weights, spread(parts, -1, cells, weights), 0, v, roundings(above))
    if len(above.table) == 0:
        return value
    cells, weights = cells_of(above, factor_offset, belief)
    return value - dropped(above, cells, weights, len(cells), 0, v)


@compiled
def start_value(above: Above, factor_offset: NDArray[np.int64], v: int, belief: NDArray[np.float64]) -> float:
    """The same as the grid is now, which the search may not have been given yet."""
    if len(above.table) > 0:
        return grid_value(above, factor_offset, v, belief)
    parts = parts_of(above, factor_offset, belief, False)
    cells, weights = np.empty(widest(parts), dtype=np.int64), np.empty(widest(parts))
    return mixed(above.value.T, cells, weights, spread(parts, -1, cells, weights), 0, v, roundings(above))


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
