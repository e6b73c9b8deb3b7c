"""What can be had whatever is hidden: the lower bound that the search starts from, and the policy behind it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled
from harness.solver.branches import Branches


@compiled
def robust(b: Branches, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """(V,) a value that can be had whatever is hidden, and the action that has it, by visible value alone.

    The hidden value is the worst at every step: L(v) = max_a min_x R(v, a, x) + γ Σ Pr(v' given v, a, x) L(v'). Every
    iterate from below is a lower bound of V*; an action is kept only where its backup raised the value.
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
