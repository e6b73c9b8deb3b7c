"""One step ahead of an exact belief: posteriors, what the grid says of every action, and runs that go by it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.splitmix import next_uniform
from harness.model.tables import compiled, inlined, lean
from harness.solver.branches import Branches
from harness.solver.grid import Above, Parts, dropped, mixed, parts_of, roundings, spread, widest, write_parts
from harness.solver.plans import Plans

SNAP = float(2**43)
"""Posteriors are multiples of one over this."""


class Model(NamedTuple):
    """What the search knows of the domain."""

    branches: Branches
    above: Above
    floor: NDArray[np.float64]
    """(V,) what can be had whatever is hidden"""
    slack: float
    plans: Plans


@lean
def posterior(
    b: Branches, i: int, n: int, k: int, before: NDArray[np.float64], first: int, after: NDArray[np.float64]
) -> float:
    """Write the factor's belief after branch ``i``, in multiples of 1/SNAP, to ``after[first:]``; its probability."""
    matrix = b.matrix
    total, start = 0.0, b.branch[i].matrix
    if k < 0:
        return matrix[start]
    for xp in range(n):
        p = 0.0
        for x in range(n):
            p += matrix[start + xp * n + x] * before[first + x]
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


class Scratch(NamedTuple):
    """A belief as mixtures of levels, and what looking ahead from it writes to."""

    parts: Parts
    cells: NDArray[np.int64]
    weights: NDArray[np.float64]
    after: NDArray[np.float64]


@inlined
def scratch_of(b: Branches, above: Above, belief: NDArray[np.float64], fine: bool) -> Scratch:
    """For an exact belief (N,), on the grid (``fine``) or its base."""
    parts = parts_of(above, b.factor_offset, belief, fine)
    size = widest(parts)
    return Scratch(parts, np.empty(size, dtype=np.int64), np.empty(size), belief.copy())


@lean
def ahead(b: Branches, above: Above, v: int, belief: NDArray[np.float64], a: int, s: Scratch, fine: bool) -> float:
    """The base's bound of an action's next beliefs, discounted, or (``fine``) how much lower the sparse grid's is."""
    across, cells, weights, inexact, own = above.across, s.cells, s.weights, roundings(above), len(above.stride)
    va = v * b.n_actions + a
    k = b.factor[va]
    n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
    first = 0 if k < 0 else b.factor_offset[k]
    count, total, steps, shares, parts = spread(s.parts, k, cells, weights), 0.0, s.parts.step, s.parts.share, 1
    steps[own, 0], shares[own, 0] = 0, 1.0
    for j in range(b.first_branch[va], b.first_branch[va + 1]):
        p = posterior(b, j, n, k, belief, first, s.after)
        if p > 0.0 and not b.branch[j].ends:
            if k >= 0:
                write_parts(above, b.factor_offset, s.after, (k, k + 1), fine, s.parts, own)
                parts = s.parts.counts[own]
            for e in range(parts):
                if fine:
                    there = dropped(above, cells, weights, count, steps[own, e], b.branch[j].visible)
                else:
                    there = mixed(across, cells, weights, count, steps[own, e], b.branch[j].visible, inexact)
                total += b.discount * p * shares[own, e] * there
    for x in range(n if k >= 0 else 0):
        s.after[first + x] = belief[first + x]
    return total


@lean
def expected_reward(b: Branches, v: int, belief: NDArray[np.float64], a: int) -> float:
    """Of an action at visible value ``v`` and an exact belief (N,)."""
    k, row, total = b.factor[v * b.n_actions + a], b.first_row[v * b.n_actions + a], 0.0
    for x in range(1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]):
        total += (1.0 if k < 0 else belief[b.factor_offset[k] + x]) * b.reward[row + x]
    return total


@compiled
def look_ahead(b: Branches, above: Above, v: int, belief: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """Write the base's upper bounds of all actions (A,) at visible value ``v`` and an exact belief (N,)."""
    s = scratch_of(b, above, belief, False)
    for a in range(len(values)):
        values[a] = expected_reward(b, v, belief, a) + ahead(b, above, v, belief, a, s, False)


@compiled
def action_value(b: Branches, above: Above, v: int, belief: NDArray[np.float64], a: int) -> float:
    """The sparse grid's upper bound of one action."""
    total = expected_reward(b, v, belief, a)
    total += ahead(b, above, v, belief, a, scratch_of(b, above, belief, False), False)
    return total - ahead(b, above, v, belief, a, scratch_of(b, above, belief, True), True)


@compiled
def sensitivity(b: Branches, above: Above, v: int, belief: NDArray[np.float64], spans: NDArray[np.float64]) -> None:
    """Write how much it is worth to know each factor (K,): the base's values over its own, most less least."""
    s, own = scratch_of(b, above, belief, False), len(spans)
    for k in range(len(spans)):
        count, low, high = spread(s.parts, k, s.cells, s.weights), np.inf, -np.inf
        first, last = b.factor_offset[k], b.factor_offset[k + 1]
        for x in range(first, last):
            s.after[first:last] = 0.0
            s.after[x] = 1.0
            write_parts(above, b.factor_offset, s.after, (k, k + 1), False, s.parts, own)
            known = mixed(above.across, s.cells, s.weights, count, s.parts.step[own, 0], v, roundings(above))
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
