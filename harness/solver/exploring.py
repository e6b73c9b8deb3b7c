"""Runs on the grid that back up what they meet: the cells that matter, of a grid too large to be whole.

In the manner of RTDP (Barto, Bradtke and Singh 1995): from the start, always the action that the grid has highest, what
follows by chance; then the cells met are backed up, the certain ones first. Bounds are too high where nobody looked, so
runs go there and bring them down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.splitmix import next_uniform
from harness.model.tables import compiled, inlined
from harness.solver.backups import Backups
from harness.solver.grid import Above, made, row_of
from harness.solver.levels import Levels
from harness.solver.sweeping import ranks, sweep

_TOGETHER = 64
"""Runs between backups"""
_HORIZON = 500
ROOM = 20_000
"""Rows that a batch will hardly exceed; what exceeds them is not kept, which costs time only."""


class Places(NamedTuple):
    """Where the backups of a visible value are. V visible values, L levels."""

    move: NDArray[np.int64]
    """(V + 1,) among the moves"""
    row: NDArray[np.int64]
    """(L, V + 1) among the rows of a level"""
    rank: NDArray[np.int64]
    """(L,) of a level in its factor, the certain ones first"""


def places(s: Backups, levels: Levels, n_visible: int) -> Places:
    """Where the backups of every visible value are; they lie in its order."""
    values = np.arange(n_visible + 1)
    rows = [a + np.searchsorted(s.rows.at[a:b], values) for a, b in zip(s.group[:-1], s.group[1:], strict=True)]
    return Places(np.searchsorted(s.moves.at, values), np.array(rows), np.concatenate(ranks(levels)))


@compiled
def _step(above: Above, s: Backups, p: Places, cell: int, v: int, u: float) -> tuple[int, int]:
    """Cell and visible value that follow the best action; −1 for none."""
    value, table, held, stride, offset = above.value, above.table, above.cell, above.stride, above.offset
    best, kind, which = -np.inf, 0, 0
    mine = row_of(table, held, cell)
    mine = mine if mine >= 0 else made(above, cell)
    reward, first, visible, weight = s.moves.reward, s.moves.first, s.moves.visible, s.moves.weight
    for j in range(p.move[v], p.move[v + 1]):
        total = reward[j]
        for e in range(first[j], first[j + 1]):
            total += weight[e] * np.float64(value[mine, visible[e]])
        if total > best:
            best, kind, which = total, 0, j
    block, dense_reward, dense_first, dense_step, dense_weight = (
        s.block, s.dense_reward, s.dense_first, s.dense_step, s.dense_weight
    )  # fmt: skip
    own, reward, first, visible, step, weight = (
        p.row, s.rows.reward, s.rows.first, s.rows.visible, s.rows.step, s.rows.weight
    )  # fmt: skip
    rest = cell
    for k in range(len(stride)):
        place = rest // stride[k]
        rest -= place * stride[k]
        level = offset[k] + place
        for d in range(block[level], block[level + 1]):
            total = dense_reward[d, v]
            for e in range(dense_first[d], dense_first[d + 1]):
                if dense_weight[e, v] > 0.0:
                    row = row_of(table, held, cell + dense_step[e])
                    row = row if row >= 0 else made(above, cell + dense_step[e])
                    total += dense_weight[e, v] * np.float64(value[row, v])
            if total > best:
                best, kind, which = total, 1, d
        for j in range(own[level, v], own[level, v + 1]):
            total = reward[j]
            for e in range(first[j], first[j + 1]):
                row = row_of(table, held, cell + step[e])
                row = row if row >= 0 else made(above, cell + step[e])
                total += weight[e] * np.float64(value[row, visible[e]])
            if total > best:
                best, kind, which = total, 2, j
    if best == -np.inf:
        return -1, -1
    if kind == 1:
        for e in range(s.dense_first[which], s.dense_first[which + 1]):
            u -= s.dense_weight[e, v]
            if u < 0.0:
                return cell + s.dense_step[e], v
        return -1, -1
    r = s.moves if kind == 0 else s.rows
    for e in range(r.first[which], r.first[which + 1]):
        u -= r.weight[e]
        if u < 0.0:
            return cell + (0 if kind == 0 else r.step[e]), int(r.visible[e])
    return -1, -1


@compiled
def explore(
    above: Above,
    s: Backups,
    p: Places,
    floor: NDArray[np.float64],
    discount: float,
    v: int,
    cells: NDArray[np.int64],
    weights: NDArray[np.float64],
    seed: int,
    batches: int,
) -> int:
    """Runs from visible value ``v`` and a mixture of cells, in batches; ends early where the room may not suffice.

    Returns how many batches there were.
    """
    met = np.empty(_TOGETHER * _HORIZON, dtype=np.int64)
    for batch in range(batches):
        if len(above.cell) - above.used[0] < ROOM:
            return batch
        count = 0
        for run in range(_TOGETHER):
            state = np.array([np.uint64((seed + batch) * _TOGETHER + run)])
            cell, now, u = -1, int(v), next_uniform(state)
            for i in range(len(weights)):
                u -= weights[i]
                if u < 0.0 and cell < 0:
                    cell = int(cells[i])
            begin = count
            while cell >= 0 and count - begin < _HORIZON:
                if count == begin or met[count - 1] != cell:
                    met[count] = cell
                    count += 1
                cell, now = _step(above, s, p, cell, now, next_uniform(state))
        sweep(above, s, _certain_first(above, p, np.unique(met[:count])), floor, discount)
    return batches


@inlined
def _certain_first(above: Above, p: Places, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    total = np.zeros(len(cells), dtype=np.int64)
    for i in range(len(cells)):
        rest = cells[i]
        for k in range(len(above.stride)):
            place = rest // above.stride[k]
            rest -= place * above.stride[k]
            total[i] += p.rank[above.offset[k] + place]
    return cells[np.argsort(total, kind="mergesort")]
