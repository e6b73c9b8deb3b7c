"""The product grid's MDP: what an action leads to from a cell, the same for all cells with one level of a factor."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled
from harness.solver.branches import Branches
from harness.solver.levels import Levels, mixture


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
