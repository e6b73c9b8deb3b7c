"""One step ahead of an exact belief: posteriors, what the grid says of every action, and runs that go by it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.splitmix import next_uniform
from harness.model.tables import compiled, inlined
from harness.solver.branches import Branches
from harness.solver.grid import Above, mixed, spread, widest
from harness.solver.levels import mixture

SNAP = float(2**43)
"""Posteriors are multiples of one over this."""


class Model(NamedTuple):
    """What the search knows of the domain."""

    branches: Branches
    above: Above
    quick: Above
    """The whole grid below a sparse one: looser, and quickly asked"""
    floor: NDArray[np.float64]
    """(V,) what can be had whatever is hidden"""
    slack: float


@inlined
def posterior(
    b: Branches, i: int, n: int, k: int, before: NDArray[np.float64], first: int, after: NDArray[np.float64]
) -> float:
    """Write the factor's belief after branch ``i``, in multiples of 1/SNAP, to ``after[first:]``; its probability."""
    total, start = 0.0, b.branch[i].matrix
    if k < 0:
        return b.matrix[start]
    for xp in range(n):
        p = 0.0
        for x in range(n):
            p += b.matrix[start + xp * n + x] * before[first + x]
        after[first + xp] = p
        total += p
    if total > 0.0:
        rest = 1.0
        for xp in range(n - 1, 0, -1):
            p = np.floor(after[first + xp] / total * SNAP + 0.5) / SNAP
            after[first + xp] = p
            rest -= p
        after[first] = max(0.0, rest)
    return total


@compiled
def action_value(b: Branches, above: Above, v: int, belief: NDArray[np.float64], a: int) -> float:
    """A grid's upper bound of an action at visible value ``v`` and an exact belief (N,)."""
    va = v * b.n_actions + a
    k = b.factor[va]
    n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
    first = 0 if k < 0 else b.factor_offset[k]
    size = widest(above, b.factor_offset, belief)
    cells, weights, after = np.empty(size, dtype=np.int64), np.empty(size), belief.copy()
    level, share = np.zeros(above.point.shape[1] + 1, dtype=np.int64), np.zeros(above.point.shape[1] + 1)
    count, total = spread(above, b.factor_offset, belief, k, cells, weights), 0.0
    for x in range(n):
        total += (1.0 if k < 0 else belief[first + x]) * b.reward[b.first_row[va] + x]
    for j in range(b.first_branch[va], b.first_branch[va + 1]):
        p = posterior(b, j, n, k, belief, first, after)
        if p > 0.0 and not b.branch[j].ends:
            level[0], share[0], parts = 0, 1.0, 1
            if k >= 0:
                parts = mixture(above.offset, above.point, k, n, after, first, level, share)
            for e in range(parts):
                shift = 0 if k < 0 else level[e] * above.stride[k]
                total += b.discount * p * share[e] * mixed(above, cells, weights, count, shift, b.branch[j].visible)
    return total


@compiled
def look_ahead(b: Branches, above: Above, v: int, belief: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """Write a grid's upper bounds of all actions (A,)."""
    for a in range(len(values)):
        values[a] = action_value(b, above, v, belief, a)


@compiled
def sensitivity(b: Branches, above: Above, v: int, belief: NDArray[np.float64], spans: NDArray[np.float64]) -> None:
    """Write how much it is worth to know each factor (K,): the grid's values over its own, most less least."""
    size = widest(above, b.factor_offset, belief)
    cells, weights = np.empty(size, dtype=np.int64), np.empty(size)
    level, share = np.zeros(above.point.shape[1] + 1, dtype=np.int64), np.zeros(above.point.shape[1] + 1)
    for k in range(len(spans)):
        n = b.factor_offset[k + 1] - b.factor_offset[k]
        count = spread(above, b.factor_offset, belief, k, cells, weights)
        low, high, corner = np.inf, -np.inf, np.zeros(n)
        for x in range(n):
            corner[:] = 0.0
            corner[x] = 1.0
            mixture(above.offset, above.point, k, n, corner, 0, level, share)
            known = mixed(above, cells, weights, count, level[0] * above.stride[k], v)
            low, high = min(low, known), max(high, known)
        spans[k] = high - low


@compiled
def greedy_runs(
    m: Model,
    start: int,
    begin: NDArray[np.float64],
    seed: int,
    runs: int,
    horizon: int,
    beliefs: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> int:
    """Follow the action that the grid has highest, branches by chance, from visible value ``start`` and ``begin`` (N,).

    Writes the beliefs met (S, N), and (S, K) the discount by then times what it is worth to know each factor; how many.
    """
    b = m.branches
    values, count = np.empty(b.n_actions), 0
    for run in range(runs):
        state = np.array([np.uint64(seed * runs + run)])
        v, now, weight, fresh = int(start), begin.copy(), 1.0, True
        for _ in range(horizon):
            if fresh:
                beliefs[count] = now
                sensitivity(b, m.above, v, now, weights[count])
                weights[count] *= weight
                count += 1
            look_ahead(b, m.above, v, now, values)
            va = v * b.n_actions + np.argmax(values)
            k = b.factor[va]
            n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
            first = 0 if k < 0 else b.factor_offset[k]
            u, drawn, after = next_uniform(state), -1, now.copy()
            for j in range(b.first_branch[va], b.first_branch[va + 1]):
                p = posterior(b, j, n, k, now, first, after)
                if p > 0.0:
                    drawn = j
                    u -= p
                    if u < 0.0:
                        break
            posterior(b, drawn, n, k, now, first, after)
            if b.branch[drawn].ends:
                break
            weight *= b.discount
            fresh = k >= 0
            v, now = int(b.branch[drawn].visible), after
    return count
