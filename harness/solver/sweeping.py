"""Sweeps of the grid: backups of many cells, in an order that lets one sweep do most of the work."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined
from harness.solver.backups import Backups, Rows
from harness.solver.grid import UP, Above, made, row_of
from harness.solver.levels import Levels

_ABREAST = 16
_TOLERANCE = 1e-10


def ranks(levels: Levels) -> list[NDArray[np.int32]]:
    """Of every factor's levels: their places in the order from certainty to doubt."""
    found = []
    for k in range(len(levels.stride)):
        point = levels.point[levels.offset[k] : levels.offset[k + 1]]
        rank = np.empty(len(point), dtype=np.int32)
        rank[np.argsort(-point.max(axis=1), kind="stable")] = np.arange(len(point))
        found.append(rank)
    return found


def waves(levels: Levels) -> list[NDArray[np.int32]]:
    """All cells in the order of a sweep: from certainty to doubt, in waves that a sweep may do in any order.

    The levels of a factor are ranked, the certain ones first. A wave holds the cells of one sum of ranks: two of them
    differ in two factors at least, so that neither reads the other. What a reading leads to is mostly more certain than
    what it came from, hence has its new value already.
    """
    total = np.zeros(1, dtype=np.int32)
    for rank in ranks(levels):
        total = (total[:, None] + rank).ravel()
    order = np.argsort(total.astype(np.uint16), kind="stable").astype(np.int32)
    return np.split(order, np.cumsum(np.bincount(total))[:-1])


@compiled
def sweep(above: Above, s: Backups, cells: NDArray[Any], floor: NDArray[np.float64], discount: float) -> None:
    """Back up cells of one wave, in place.

    Moves within a cell are solved from ``floor`` (V,), a lower bound of the value, for ``_ABREAST`` cells at once.
    """
    V = above.value.shape[1]
    now, best, dense = np.zeros((V, _ABREAST)), np.zeros(V), np.zeros(V)
    value, table, held = above.value, above.table, above.cell
    slack = 1e-12 * (1.0 + np.abs(floor).max())
    for begin in range(0, len(cells), _ABREAST):
        count = min(_ABREAST, len(cells) - begin)
        for c in range(count):
            best[:] = floor
            _touch(above, s, cells[begin + c], best, dense)
            for v in range(V):
                now[v, c] = best[v]
        excess = slack + _move(s.moves, now) / (1.0 - discount)
        for c in range(count):
            mine = row_of(table, held, cells[begin + c])
            mine = mine if mine >= 0 else made(above, cells[begin + c])
            for v in range(V):
                new = now[v, c] + excess
                value[mine, v] = min(value[mine, v], np.float32(new + UP * abs(new)))


@inlined
def _touch(above: Above, s: Backups, cell: int, best: NDArray[np.float64], scratch: NDArray[np.float64]) -> None:
    """Raise ``best`` (V,) to the best of what touches a factor."""
    value, table, held, stride, offset = above.value, above.table, above.cell, above.stride, above.offset
    block, dense_reward, dense_first, dense_step, dense_weight = (
        s.block, s.dense_reward, s.dense_first, s.dense_step, s.dense_weight
    )  # fmt: skip
    group, at, reward, first, visible, step, weight = (
        s.group, s.rows.at, s.rows.reward, s.rows.first, s.rows.visible, s.rows.step, s.rows.weight
    )  # fmt: skip
    rest = cell
    for k in range(len(stride)):
        place = rest // stride[k]
        rest -= place * stride[k]
        level = offset[k] + place
        for d in range(block[level], block[level + 1]):
            for v in range(len(best)):
                scratch[v] = dense_reward[d, v]
            for e in range(dense_first[d], dense_first[d + 1]):
                row = row_of(table, held, cell + dense_step[e])
                row = row if row >= 0 else made(above, cell + dense_step[e])
                for v in range(len(best)):
                    scratch[v] += dense_weight[e, v] * np.float64(value[row, v])
            for v in range(len(best)):
                best[v] = scratch[v] if scratch[v] > best[v] else best[v]
        for j in range(group[level], group[level + 1]):
            total = reward[j]
            for e in range(first[j], first[j + 1]):
                row = row_of(table, held, cell + step[e])
                row = row if row >= 0 else made(above, cell + step[e])
                total += weight[e] * np.float64(value[row, visible[e]])
            best[at[j]] = max(best[at[j]], total)


@inlined
def _move(m: Rows, now: NDArray[np.float64]) -> float:
    """Raise ``now`` (V, _ABREAST) by the moves that touch no factor until nothing rises; by how much it did last."""
    at, rewards, first, visible, weights = m.at, m.reward, m.first, m.visible, m.weight
    change, passes = _TOLERANCE + 1.0, 0
    rise, total = np.zeros(_ABREAST), np.zeros(_ABREAST)
    while change > _TOLERANCE and passes < 10_000:
        rise[:] = 0.0
        for i in range(len(at)):
            j = i if passes % 2 == 0 else len(at) - 1 - i
            mine, there, weight, reward = at[j], visible[first[j]], weights[first[j]], rewards[j]
            for c in range(_ABREAST):
                total[c] = reward + weight * now[there, c]
            for e in range(first[j] + 1, first[j + 1]):
                there, weight = visible[e], weights[e]
                for c in range(_ABREAST):
                    total[c] += weight * now[there, c]
            for c in range(_ABREAST):
                up = total[c] - now[mine, c]
                rise[c] = up if up > rise[c] else rise[c]
                now[mine, c] = total[c] if up > 0.0 else now[mine, c]
        change = rise.max()
        passes += 1
    return change
