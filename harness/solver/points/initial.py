"""Bounds to begin with: the fast informed bound above, policies that do not look at what is hidden below.

Above (Hauskrecht 2000): ``U_a(v, h) ← R + γ Σ_branches max_a' Σ_h' Pr(h', branch | v, h, a) U_a'(v', h')``. For every
belief b, V*(v, b) ≤ max_a Σ_h b(h) U_a(v, h): it is as if the hidden value were told after every reading, one step
late. Below: the value of a policy that acts by the visible value alone is linear in the belief, an alpha vector.

**Rounding.** Both start on the safe side of all values, and an update moves a number no further than to its backup,
plus or less a ``slack`` that is above the rounding of the sum. Hence, by induction, U stays at or above its exact
backup and so above the exact fixed point, and each vector stays at or below the exact backup of its policy's vectors,
whenever the sweeps end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled
from harness.solver.points.steps import Steps

ROUNDING = 2.0**-48
"""More than the relative error of a term of a sum: half a unit in the last place for each operation, and with room."""

_SWEEPS = 2000
_STILL = 1e-6
"""Sweeps end when nothing moves by more than this share of the span of values."""


def slack_of(s: Steps) -> float:
    """More than the rounding of a backup: of a sum over a row, or of one over a belief, and of the tables."""
    return (ROUNDING * (s.terms + s.n_hidden + 8) + s.unsure) * (1.0 + s.span)


def cautious(s: Steps) -> NDArray[np.int64]:
    """(V,) the action of the best worst case over what is hidden, at every step; 0 where there is nothing to do."""
    live = np.flatnonzero(s.size)
    choice = np.repeat(np.arange(len(s.size)), s.size)  # of a row
    rows = np.repeat(np.arange(len(choice)), np.diff(s.first_entry))  # of an entry
    ahead = s.branch_visible[s.first_branch[choice[rows]] + s.branch]
    value, action = np.full(s.n_visible, -s.span), np.zeros(s.n_visible, dtype=np.int64)
    for _ in range(_SWEEPS):
        worth = s.reward + s.discount * np.bincount(rows, s.probability * value[ahead], len(choice))
        worst = np.full(len(s.size), -np.inf)
        worst[live] = np.minimum.reduceat(worth, s.first_row[live])
        best = worst.reshape(s.n_visible, -1).max(axis=1)
        better = best > value + _STILL * (1.0 + s.span)
        if not better.any():
            break
        action[better] = worst.reshape(s.n_visible, -1).argmax(axis=1)[better]
        value[better] = best[better]
    return action


@compiled
def informed(s: Steps, value: NDArray[np.float64], slack: float, backward: bool) -> float:
    """One sweep of the fast informed bound in place, ``value`` (V, A, H); the largest fall."""
    fall, together = 0.0, np.zeros(s.n_actions)
    V, A, H = value.shape
    for i in range(V * A):
        va = V * A - 1 - i if backward else i
        for h in range(H if s.size[va] > 0 else 0):
            row = s.first_row[va] + h // s.stride[va] % s.size[va]
            total, last = s.reward[row] + slack, s.first_entry[row + 1]
            e = s.first_entry[row]
            while e < last:
                j = s.branch[e]
                v = s.branch_visible[s.first_branch[va] + j]
                for a in range(A):
                    together[a] = 0.0
                while e < last and s.branch[e] == j:
                    for a in range(A):
                        together[a] += s.probability[e] * value[v, a, h + s.shift[e]]
                    e += 1
                best = together[0]
                for a in range(1, A):
                    best = max(best, together[a])
                total += s.discount * best
            fall = max(fall, value[va // A, va % A, h] - total)
            value[va // A, va % A, h] = min(value[va // A, va % A, h], total)
    return fall


@compiled
def followed(s: Steps, action: NDArray[np.int64], value: NDArray[np.float64], slack: float, backward: bool) -> float:
    """One sweep of what acting by ``action`` (V,) earns, in place, ``value`` (V, H); the largest rise."""
    rise = 0.0
    V, H = value.shape
    for i in range(V):
        v = V - 1 - i if backward else i
        va = v * s.n_actions + action[v]
        for h in range(H if s.size[va] > 0 else 0):
            row = s.first_row[va] + h // s.stride[va] % s.size[va]
            total = 0.0
            for e in range(s.first_entry[row], s.first_entry[row + 1]):
                there = s.branch_visible[s.first_branch[va] + s.branch[e]]
                total += s.probability[e] * value[there, h + s.shift[e]]
            total = s.reward[row] - slack + s.discount * total
            rise = max(rise, total - value[v, h])
            value[v, h] = max(value[v, h], total)
    return rise


def lowest(s: Steps, slack: float) -> float:
    """A number below what any policy earns, and below its own backup."""
    return (min(0.0, float(s.reward.min(initial=0.0))) - 2.0 * slack) / (1.0 - s.discount) - slack


def highest(s: Steps, slack: float) -> float:
    """A number above what any policy earns, and above its own backup."""
    return (max(0.0, float(s.reward.max(initial=0.0))) + 2.0 * slack) / (1.0 - s.discount) + slack


def bounded_above(s: Steps, slack: float) -> NDArray[np.float64]:
    """(V, A, H) the fast informed bound; 0 at the end."""
    value = np.full((s.n_visible, s.n_actions, s.n_hidden), highest(s, slack))
    for k in range(_SWEEPS):
        if informed(s, value, slack, k % 2 == 1) <= _STILL * (1.0 + s.span):
            break
    value[s.size.reshape(s.n_visible, -1)[:, 0] == 0] = 0.0
    return value


def value_of(s: Steps, action: NDArray[np.int64], slack: float) -> NDArray[np.float64]:
    """(V, H) at most what acting by ``action`` (V,) earns."""
    value = np.full((s.n_visible, s.n_hidden), lowest(s, slack))
    for k in range(_SWEEPS):
        if followed(s, action, value, slack, k % 2 == 1) <= _STILL * (1.0 + s.span):
            break
    return value
