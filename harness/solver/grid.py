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
from harness.solver.backups import Backups, Rows
from harness.solver.levels import Levels, mixture

UP = 1.2e-7
"""Relative; more than half the spacing of float32, so that what is rounded to it after the addition is not below."""
_ABREAST = 16
_TOLERANCE = 1e-10


def waves(levels: Levels) -> list[NDArray[np.int32]]:
    """All cells in the order of a sweep: from certainty to doubt, in waves that a sweep may do in any order.

    The levels of a factor are ranked, the certain ones first. A wave holds the cells of one sum of ranks: two of them
    differ in two factors at least, so that neither reads the other. What a reading leads to is mostly more certain than
    what it came from, hence has its new value already.
    """
    total = np.zeros(1, dtype=np.int32)
    for k in range(len(levels.stride)):
        point = levels.point[levels.offset[k] : levels.offset[k + 1]]
        rank = np.empty(len(point), dtype=np.int32)
        rank[np.argsort(-point.max(axis=1), kind="stable")] = np.arange(len(point))
        total = (total[:, None] + rank).ravel()
    order = np.argsort(total.astype(np.uint16), kind="stable").astype(np.int32)
    return np.split(order, np.cumsum(np.bincount(total))[:-1])


@compiled
def sweep(
    value: NDArray[np.float32],
    s: Backups,
    cells: NDArray[np.int32],
    offset: NDArray[np.int64],
    stride: NDArray[np.int64],
    floor: NDArray[np.float64],
    discount: float,
) -> None:
    """Back up cells of one wave, in place; ``value`` (all cells, V).

    Moves within a cell are solved from ``floor`` (V,), a lower bound of the value, for ``_ABREAST`` cells at once.
    """
    V = value.shape[1]
    now, best, dense = np.zeros((V, _ABREAST)), np.zeros(V), np.zeros(V)
    slack = 1e-12 * (1.0 + np.abs(floor).max())
    for begin in range(0, len(cells), _ABREAST):
        count = min(_ABREAST, len(cells) - begin)
        for c in range(count):
            best[:] = floor
            _touch(value, s, cells[begin + c], offset, stride, best, dense)
            for v in range(V):
                now[v, c] = best[v]
        excess = slack + _move(s.moves, now) / (1.0 - discount)
        for c in range(count):
            mine = value[cells[begin + c]]
            for v in range(V):
                new = now[v, c] + excess
                mine[v] = min(mine[v], np.float32(new + UP * abs(new)))


@inlined
def _touch(
    value: NDArray[np.float32],
    s: Backups,
    cell: int,
    offset: NDArray[np.int64],
    stride: NDArray[np.int64],
    best: NDArray[np.float64],
    scratch: NDArray[np.float64],
) -> None:
    """Raise ``best`` (V,) to the best of what touches a factor."""
    r, rest = s.rows, cell
    for k in range(len(stride)):
        place = rest // stride[k]
        rest -= place * stride[k]
        level = offset[k] + place
        for d in range(s.block[level], s.block[level + 1]):
            reward = s.dense_reward[d]
            for v in range(len(best)):
                scratch[v] = reward[v]
            for e in range(s.dense_first[d], s.dense_first[d + 1]):
                there, weight = value[cell + s.dense_step[e]], s.dense_weight[e]
                for v in range(len(best)):
                    scratch[v] += weight[v] * np.float64(there[v])
            for v in range(len(best)):
                best[v] = scratch[v] if scratch[v] > best[v] else best[v]
        for j in range(s.group[level], s.group[level + 1]):
            total = r.reward[j]
            for e in range(r.first[j], r.first[j + 1]):
                total += r.weight[e] * np.float64(value[cell + r.step[e], r.visible[e]])
            best[r.at[j]] = max(best[r.at[j]], total)


@inlined
def _move(m: Rows, now: NDArray[np.float64]) -> float:
    """Raise ``now`` (V, _ABREAST) by the moves that touch no factor until nothing rises; by how much it did last."""
    change, passes = _TOLERANCE + 1.0, 0
    rise, total = np.zeros(_ABREAST), np.zeros(_ABREAST)
    while change > _TOLERANCE and passes < 10_000:
        rise[:] = 0.0
        for i in range(len(m.at)):
            j = i if passes % 2 == 0 else len(m.at) - 1 - i
            mine, e = now[m.at[j]], m.first[j]
            there, weight, reward = now[m.visible[e]], m.weight[e], m.reward[j]
            for c in range(_ABREAST):
                total[c] = reward + weight * there[c]
            for e in range(m.first[j] + 1, m.first[j + 1]):
                there, weight = now[m.visible[e]], m.weight[e]
                for c in range(_ABREAST):
                    total[c] += weight * there[c]
            for c in range(_ABREAST):
                up = total[c] - mine[c]
                rise[c] = up if up > rise[c] else rise[c]
                mine[c] = total[c] if up > 0.0 else mine[c]
        change = rise.max()
        passes += 1
    return change


class Above(NamedTuple):
    """The product grid, to be asked for an upper bound anywhere."""

    value: NDArray[np.float32]
    """(cells, V)"""
    offset: NDArray[np.int64]
    point: NDArray[np.float64]
    stride: NDArray[np.int64]


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
        term = weights[i] * np.float64(above.value[cells[i] + shift, v])
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
