"""Blind plans: what can be earned from a belief without reading anything more, the lower bound at the search's leaves.

A plan takes each factor that is known well enough for what it most likely is, and the others for what is worst; it
acts as would be best if that were so, and reads nothing. What it earns under the true belief is a sum along one path,
as long as the visible moves are sure; from the best place on it goes on with what can be had whatever is hidden
(:mod:`harness.solver.floor`). A plan is a policy, so that its value is a lower bound of V*, however it was chosen.

**Rounding.** A path has at most :data:`LONGEST` steps of some ten operations each, so that the sum is off by less than
2⁻⁴¹ of the span of values; the caller takes that off (``slack``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, lean
from harness.solver.branches import Branches

KNOWN = 0.75
"""Probability from which on a plan counts on a factor's value."""
LONGEST = 200
"""Steps of a plan, at most."""
_NOT_ASKED = -1


class Plans(NamedTuple):
    """What is best where all is known. C combinations of the factors' values, V visible values, K factors."""

    value: NDArray[np.float32]
    """(C, V) upper bound of the fully observed problem"""
    stride: NDArray[np.int64]
    """(K,) of each factor in the number of a combination"""
    worst: NDArray[np.int64]
    """(K,) the value that is worst to have"""
    action: NDArray[np.int16]
    """(C, V) the best action, found when it is first asked for"""


def plans(value: NDArray[np.float32], stride: NDArray[np.int64], sizes: tuple[int, ...]) -> Plans:
    """From the values of the grid that has corners alone (:mod:`harness.solver.grid`)."""
    means = value.mean(axis=1, dtype=np.float64).reshape(sizes)
    others = [tuple(i for i in range(len(sizes)) if i != k) for k in range(len(sizes))]
    worst = np.array([means.mean(axis=axes).argmin() for axes in others], dtype=np.int64)
    return Plans(value, stride, worst, np.full(value.shape, _NOT_ASKED, dtype=np.int16))


@compiled
def _best(b: Branches, p: Plans, combination: int, v: int) -> int:
    """The best action where all is known."""
    best, most, discount, stride, value, matrix = 0, -np.inf, b.discount, p.stride, p.value, b.matrix
    for a in range(b.n_actions):
        va = v * b.n_actions + a
        k = b.factor[va]
        n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
        x = 0 if k < 0 else (combination // stride[k]) % n
        total = b.reward[b.first_row[va] + x]
        for j in range(b.first_branch[va], b.first_branch[va + 1]):
            if not b.branch[j].ends:
                for xp in range(n):
                    there = combination if k < 0 else combination + (xp - x) * stride[k]
                    chance = matrix[b.branch[j].matrix + xp * n + x]
                    total += discount * chance * np.float64(value[there, b.branch[j].visible])
        if total > most:
            best, most = a, total
    return best


@lean
def _assumed(p: Plans, k: int, first: int, n: int, belief: NDArray[np.float64]) -> int:
    """What a plan takes factor ``k`` to be, as its part in the number of a combination."""
    best = 0
    for x in range(1, n):
        if belief[first + x] > belief[first + best]:
            best = x
    return (best if belief[first + best] >= KNOWN else p.worst[k]) * p.stride[k]


@compiled
def follow(
    b: Branches, p: Plans, floor: NDArray[np.float64], v: int, belief: NDArray[np.float64], path: NDArray[np.int32]
) -> tuple[float, int]:
    """What the plan from visible value ``v`` and a belief (N,) earns, and its length until the floor takes over.

    Writes the visible values and actions of its steps to ``path`` (LONGEST, 2).
    """
    now, after, combination, offset = belief.copy(), belief.copy(), 0, b.factor_offset
    for k in range(len(p.stride)):
        combination += _assumed(p, k, offset[k], offset[k + 1] - offset[k], now)
    best, length, total, weight = floor[v], 0, 0.0, 1.0
    for step in range(LONGEST):
        if p.action[combination, v] == _NOT_ASKED:
            p.action[combination, v] = _best(b, p, combination, v)
        a = p.action[combination, v]
        va = v * b.n_actions + a
        k, begin, end = b.factor[va], b.first_branch[va], b.first_branch[va + 1]
        n, first = (1, 0) if k < 0 else (offset[k + 1] - offset[k], offset[k])
        for j in range(begin + 1, end):
            if b.branch[j].visible != b.branch[begin].visible or b.branch[j].ends != b.branch[begin].ends:
                return best, length
        path[step, 0], path[step, 1] = v, a
        for x in range(n):
            total += weight * (1.0 if k < 0 else now[first + x]) * b.reward[b.first_row[va] + x]
        v, weight = b.branch[begin].visible, weight * b.discount
        if k >= 0:
            combination -= _assumed(p, k, first, n, now)
            for xp in range(n):
                after[first + xp] = 0.0
                for j in range(begin, end):
                    for x in range(n):
                        after[first + xp] += b.matrix[b.branch[j].matrix + xp * n + x] * now[first + x]
            now[first : first + n] = after[first : first + n]
            combination += _assumed(p, k, first, n, now)
        rest = 0.0 if b.branch[begin].ends else weight * floor[v]
        if total + rest > best:
            best, length = total + rest, step + 1
        if b.branch[begin].ends:
            break
    return best, length
