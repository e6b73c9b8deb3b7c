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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined
from harness.solver.branches import Branches
from harness.solver.levels import Levels, mixture

UP = 1.2e-7
"""Relative; more than half the spacing of float32, so that what is rounded to it after the addition is not below."""


class Rows(NamedTuple):
    """Backups: for visible value ``at``, ``reward + Σ weight · U(cell + step, visible)`` over the row's entries.

    Entries are shared by all cells: they say how far to go from a cell. The share that stays in the very same cell is
    solved for.
    """

    at: NDArray[np.int32]
    reward: NDArray[np.float64]
    first: NDArray[np.int64]
    """(rows + 1,)"""
    visible: NDArray[np.int32]
    """(entries,) next visible value"""
    step: NDArray[np.int64]
    """(entries,) next cell less the present one"""
    weight: NDArray[np.float64]
    """(entries,) discounted probability"""


class Backups(NamedTuple):
    """The grid's MDP."""

    moves: Rows
    """What touches no factor."""
    group: NDArray[np.int64]
    """(L + 1,) ``rows`` of a level (of all factors counted through) begin here."""
    rows: Rows
    """What touches a factor, by its level."""
    block: NDArray[np.int64]
    """(L + 1,) ``dense`` of a level begins here."""
    dense_reward: NDArray[np.float64]
    """(blocks, V) actions that leave the visible value alone whatever it is; −inf where they cannot be taken."""
    dense_first: NDArray[np.int64]
    """(blocks + 1,)"""
    dense_step: NDArray[np.int64]
    """(terms,)"""
    dense_weight: NDArray[np.float64]
    """(terms, V)"""


def backups(b: Branches, levels: Levels, floor: NDArray[np.float64]) -> Backups:
    """The grid's MDP from the model and the levels; ``floor`` (V,) is a lower bound of the value."""
    k, level, rows = _rows(b, levels.offset, levels.point, levels.stride)
    goes_on = np.add.reduceat(rows.weight, rows.first[:-1]) > 0
    useful = goes_on | (rows.reward > floor[rows.at])  # an end, or a loop for ever, may be worse than what can be had
    moves = _chosen(rows, np.flatnonzero(useful & (k < 0)))
    place = levels.offset[np.maximum(k, 0)] + level
    blocks, taken = _blocks(b, rows, np.where(useful & (k >= 0), place, -1), levels)
    sparse = np.flatnonzero(useful & (k >= 0) & ~taken)
    sparse = sparse[np.argsort(place[sparse], kind="stable")]
    group = np.searchsorted(place[sparse], np.arange(levels.offset[-1] + 1)).astype(np.int64)
    return Backups(moves, group, _chosen(rows, sparse), *blocks)


def _chosen(rows: Rows, which: NDArray[np.intp]) -> Rows:
    """Some of the rows, in the order given."""
    counts = np.diff(rows.first)[which]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    entries = np.repeat(rows.first[:-1][which] - first[:-1], counts) + np.arange(first[-1])
    return Rows(
        rows.at[which], rows.reward[which], first, rows.visible[entries], rows.step[entries], rows.weight[entries]
    )


def _blocks(
    b: Branches, rows: Rows, place: NDArray[np.int64], levels: Levels
) -> tuple[
    tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]], Any
]:
    """Rows at most visible values that stay there, gathered so that one loop over the values does them all."""
    taken = np.zeros(len(place), dtype=np.bool_)
    entry_row = np.repeat(np.arange(len(place)), np.diff(rows.first))
    stays = np.ones(len(place), dtype=np.bool_)
    stays[entry_row[rows.visible != rows.at[entry_row]]] = False
    block, rewards, first, steps, weights = [0], [], [0], [], []
    for level in range(int(levels.offset[-1])):
        here = np.flatnonzero((place == level) & stays)
        while len(here) > b.n_visible // 2:
            values, chosen = np.unique(rows.at[here], return_index=True)
            mine = here[chosen]
            reward = np.full(b.n_visible, -np.inf)
            reward[values] = rows.reward[mine]
            entries = np.flatnonzero(np.isin(entry_row, mine))
            for step in np.unique(rows.step[entries]):
                weight = np.zeros(b.n_visible)
                at_step = entries[rows.step[entries] == step]
                weight[rows.at[entry_row[at_step]]] = rows.weight[at_step]
                steps.append(step)
                weights.append(weight)
            rewards.append(reward)
            first.append(len(steps))
            taken[mine] = True
            here = here[~taken[here]]
        block.append(len(rewards))
    return (
        np.array(block),
        np.array(rewards).reshape(-1, b.n_visible),
        np.array(first),
        np.array(steps, dtype=np.int64),
        np.array(weights).reshape(-1, b.n_visible),
    ), taken


@compiled
def _rows(
    b: Branches, offset: NDArray[np.int64], point: NDArray[np.float64], stride: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Rows]:
    """All backups, each with its factor and the level of it (−1 and 0 where it touches none)."""
    V, A, widest = b.n_visible, b.n_actions, point.shape[1]
    factor = [np.int64(0) for _ in range(0)]
    own = [np.int64(0) for _ in range(0)]
    at = [np.int32(0) for _ in range(0)]
    reward = [0.0 for _ in range(0)]
    first = [np.int64(0)]
    visible = [np.int32(0) for _ in range(0)]
    step = [np.int64(0) for _ in range(0)]
    weight = [0.0 for _ in range(0)]
    level, share, posterior = np.zeros(widest + 1, dtype=np.int64), np.zeros(widest + 1), np.zeros(widest)
    for va in range(V * A):
        if b.first_row[va] < 0:
            continue
        k = b.factor[va]
        n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
        for place in range(1 if k < 0 else offset[k + 1] - offset[k]):
            begin, paid, rest = len(visible), 0.0, 1.0
            for x in range(n):
                paid += (1.0 if k < 0 else point[offset[k] + place, x]) * b.reward[b.first_row[va] + x]
            for i in range(b.first_branch[va], b.first_branch[va + 1]):
                v, total = b.branch[i].visible, 0.0
                for xp in range(n):
                    posterior[xp] = 0.0
                    for x in range(n):
                        p = 1.0 if k < 0 else point[offset[k] + place, x]
                        posterior[xp] += b.matrix[b.branch[i].matrix + xp * n + x] * p
                    total += posterior[xp]
                if b.branch[i].ends or total <= 0.0:
                    continue
                count = 1
                level[0], share[0] = 0, 1.0
                if k >= 0:
                    for x in range(n):
                        posterior[x] /= total
                    count = mixture(offset, point, k, n, posterior, 0, level, share)
                for e in range(count):
                    ahead = np.int64(0) if k < 0 else (level[e] - place) * stride[k]
                    w = b.discount * total * share[e]
                    if v == va // A and ahead == 0:
                        rest -= w
                    else:
                        same = begin
                        while same < len(visible) and not (visible[same] == v and step[same] == ahead):
                            same += 1
                        if same < len(visible):
                            weight[same] += w
                        else:
                            visible.append(np.int32(v))
                            step.append(ahead)
                            weight.append(w)
            if len(visible) == begin:  # so that every row has an entry
                visible.append(np.int32(va // A))
                step.append(np.int64(0))
                weight.append(0.0)
            for e in range(begin, len(visible)):
                weight[e] /= rest
            factor.append(np.int64(k))
            own.append(np.int64(place))
            at.append(np.int32(va // A))
            reward.append(paid / rest)
            first.append(np.int64(len(visible)))
    rows = Rows(np.array(at), np.array(reward), np.array(first), np.array(visible), np.array(step), np.array(weight))
    return np.array(factor), np.array(own), rows


@inlined
def _disturbed(
    cell: int,
    offset: NDArray[np.int64],
    stride: NDArray[np.int64],
    moved: NDArray[np.bool_],
    moving: NDArray[np.bool_],
) -> bool:
    found = moved[cell] or moving[cell]
    for k in range(len(stride)):
        size = offset[k + 1] - offset[k]
        first = cell - ((cell // stride[k]) % size) * stride[k]
        for level in range(size):
            near = first + level * stride[k]
            found = found or moved[near] or moving[near]
    return found


@compiled
def sweep(
    value: NDArray[np.float32],
    s: Backups,
    offset: NDArray[np.int64],
    stride: NDArray[np.int64],
    floor: NDArray[np.float64],
    discount: float,
    backward: bool,
    lowest: int,
    highest: int,
    moved: NDArray[np.bool_],
    moving: NDArray[np.bool_],
    enough: float,
) -> float:
    """One pass over cells ``lowest … highest − 1``, in place; the largest fall of a value.

    ``value`` (cells, V); ``floor`` (V,) is a lower bound of the value from which moves within a cell are solved. Only
    cells are looked at of which a neighbour fell by more than ``enough`` in the last pass (``moved``, (cells,)) or this
    one (``moving``).
    """
    m, r = s.moves, s.rows
    m_at, m_reward, m_first, m_visible, m_weight = m.at, m.reward, m.first, m.visible, m.weight
    r_at, r_reward, r_first, r_visible, r_step, r_weight = r.at, r.reward, r.first, r.visible, r.step, r.weight
    V, K = value.shape[1], len(stride)
    now, dense = np.zeros(V), np.zeros(V)
    single = len(m_visible) == len(m_at)  # every move is sure: no inner loop
    slack = 1e-12 * (1.0 + np.abs(floor).max())
    fall, tolerance = 0.0, 1e-10
    for i in range(highest - lowest):
        cell = highest - 1 - i if backward else lowest + i
        if not _disturbed(cell, offset, stride, moved, moving):
            continue
        now[:] = floor
        for k in range(K):
            level = offset[k] + (cell // stride[k]) % (offset[k + 1] - offset[k])
            for d in range(s.block[level], s.block[level + 1]):
                dense[:] = s.dense_reward[d]
                for e in range(s.dense_first[d], s.dense_first[d + 1]):
                    there, weight = value[cell + s.dense_step[e]], s.dense_weight[e]
                    for v in range(V):
                        dense[v] += weight[v] * np.float64(there[v])
                for v in range(V):
                    now[v] = max(now[v], dense[v])
            for j in range(s.group[level], s.group[level + 1]):
                total = r_reward[j]
                for e in range(r_first[j], r_first[j + 1]):
                    total += r_weight[e] * np.float64(value[cell + r_step[e], r_visible[e]])
                now[r_at[j]] = max(now[r_at[j]], total)
        change, passes = tolerance + 1.0, 0
        while change > tolerance and passes < 10_000:
            change = 0.0
            for i in range(len(m_at)):
                j = i if passes % 2 == 0 else len(m_at) - 1 - i
                total = m_reward[j]
                if single:
                    total += m_weight[j] * now[m_visible[j]]
                else:
                    for e in range(m_first[j], m_first[j + 1]):
                        total += m_weight[e] * now[m_visible[e]]
                if total > now[m_at[j]]:
                    change = max(change, total - now[m_at[j]])
                    now[m_at[j]] = total
            passes += 1
        excess = slack + change / (1.0 - discount)
        for v in range(V):
            new = now[v] + excess
            rounded = np.float32(new + UP * abs(new))
            if rounded < value[cell, v]:
                fell = np.float64(value[cell, v] - rounded)
                fall = max(fall, fell)
                moving[cell] = moving[cell] or fell > enough
                value[cell, v] = rounded
    return fall


class Above(NamedTuple):
    """The product grid, to be asked for an upper bound anywhere."""

    value: NDArray[np.float32]
    """(cells, V)"""
    offset: NDArray[np.int64]
    point: NDArray[np.float64]
    stride: NDArray[np.int64]


@compiled
def spread(
    offset: NDArray[np.int64],
    point: NDArray[np.float64],
    stride: NDArray[np.int64],
    factor_offset: NDArray[np.int64],
    belief: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """A belief (N,) as a mixture of cells: their numbers and weights."""
    level, share = np.zeros(point.shape[1] + 1, dtype=np.int64), np.zeros(point.shape[1] + 1)
    cells, weights = np.zeros(1, dtype=np.int64), np.ones(1)
    for k in range(len(stride)):
        n = factor_offset[k + 1] - factor_offset[k]
        count = mixture(offset, point, k, n, belief, factor_offset[k], level, share)
        if count == 1:
            cells += level[0] * stride[k]
            weights *= share[0]
        else:
            old, before, size = cells, weights, len(cells)
            cells, weights = np.empty(size * count, dtype=np.int64), np.empty(size * count)
            for e in range(count):
                for i in range(size):
                    cells[e * size + i] = old[i] + level[e] * stride[k]
                    weights[e * size + i] = before[i] * share[e]
    return cells, weights


@compiled
def grid_value(above: Above, factor_offset: NDArray[np.int64], v: int, belief: NDArray[np.float64]) -> float:
    """The grid's upper bound at any belief: the mixture over the levels of every factor."""
    cells, weights = spread(above.offset, above.point, above.stride, factor_offset, belief)
    total, size = 0.0, 0.0
    for i in range(len(cells)):
        term = weights[i] * np.float64(above.value[cells[i], v])
        total += term
        size += abs(term)
    return total + 1e-12 * size


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


@compiled
def robust(b: Branches, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """(V,) a value that can be had whatever is hidden, and the action that has it, by visible value alone.

    The hidden value is the worst at every step: L(v) = max_a min_x R(v, a, x) + γ Σ Pr(v'|v, a, x) L(v'). Every iterate
    from below is a lower bound of V*; an action is kept only where its backup raised the value.
    """
    V, A = b.n_visible, b.n_actions
    lowest = min(0.0, b.reward.min()) / (1.0 - b.discount)
    value, action = np.full(V, lowest), np.zeros(V, dtype=np.int32)
    for v in range(V):
        if b.first_row[v * A] < 0:
            value[v] = 0.0
    slack = 1e-13 * (1.0 + np.abs(b.reward).max() / (1.0 - b.discount))
    change, rounds = tolerance + 1.0, 0
    while change > tolerance and rounds < 100_000:
        change = 0.0
        rounds += 1
        for v in range(V):
            for a in range(A):
                va = v * A + a
                if b.first_row[va] < 0:
                    continue
                k = b.factor[va]
                n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
                worst = np.inf
                for x in range(n):
                    total = b.reward[b.first_row[va] + x]
                    for i in range(b.first_branch[va], b.first_branch[va + 1]):
                        p = 0.0
                        for xp in range(n):
                            p += b.matrix[b.branch[i].matrix + xp * n + x]
                        if not b.branch[i].ends:
                            total += b.discount * p * value[b.branch[i].visible]
                    worst = min(worst, total)
                worst -= slack
                if worst > value[v] + 0.01 * tolerance:
                    change = max(change, worst - value[v])
                    value[v], action[v] = worst, a
    return value, action
