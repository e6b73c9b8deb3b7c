"""What random legal actions earn from a simulated state on: the rollouts of planners, where most of their time goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.splitmix import STRIDE, uniform_of
from harness.model.tables import Records, compiled, draw_outcome, inlined, row_of

WAY = np.dtype(
    [
        ("visible", np.int32),
        ("plain", np.bool_),  # nothing hidden decides, nothing hidden changes: what follows holds
        ("legal", np.bool_),
        ("ends", np.bool_),
        ("reward", np.float64),
    ],
    align=True,
)
"""Of (visible value, action): what comes of it where that is sure and nobody looks at the reading."""


def ways_of(domain: Domain) -> Records:
    """(V·A,) of :data:`WAY` under the domain's reward."""
    t = domain.tables
    sizes = np.array([*domain.factor_sizes, 1])[t.choices["factor"]]  # the last entry where there is no factor: −1
    entry = np.flatnonzero(t.choices["first_row"] >= 0)
    choice = np.repeat(entry, sizes[entry])  # of every row that belongs to one
    value = np.concatenate([np.arange(n) for n in sizes[entry]])
    rows = t.rows[t.choices["first_row"][choice] + value]
    came = t.outcomes[rows["first"]]
    ways = np.zeros(len(t.choices), WAY)
    ways["legal"][choice] = rows["legal"]
    for name in ("visible", "ends", "reward"):
        ways[name][choice] = came[name]
    kept = (t.choices["factor"][choice] < 0) | (came["value"] == value)
    same = (ways["legal"][choice] == rows["legal"]) & (rows["last"] - rows["first"] == 1) & kept
    for name in ("visible", "ends", "reward"):
        same &= ways[name][choice] == came[name]
    ways["plain"][entry] = True
    ways["plain"][choice[~same]] = False
    return ways


@inlined
def random_legal(
    ways: Records,
    choices: Records,
    rows: Records,
    n_actions: int,
    v: int,
    values: NDArray[np.int16],
    state: np.uint64,
) -> tuple[int, np.uint64]:
    """Uniform over the actions that are legal in the simulated state, and the random state after it."""
    legal, va = False, 0
    while not legal:  # rejection: nearly all actions are legal nearly everywhere, and one always is
        state += STRIDE
        va = v * n_actions + int(uniform_of(state) * n_actions)
        legal = ways[va].legal if ways[va].plain else rows[row_of(choices, va, values, 0)].legal
    return va - v * n_actions, state


@compiled
def random_return(
    ways: Records,
    choices: Records,
    rows: Records,
    outcomes: Records,
    n_actions: int,
    discount: float,
    steps: int,
    v: int,
    a: int,
    values: NDArray[np.int16],
    random: NDArray[np.uint64],
) -> float:
    """Discounted return of ``a`` and then random legal actions, ``steps`` in all; ``values`` (1, K) is overwritten.

    A step takes one random number for its outcome, looked at only where there is more than one.
    """
    total, weight, state = 0.0, 1.0, random[0]
    for _ in range(steps):
        va = v * n_actions + a
        state += STRIDE
        if ways[va].plain:
            total += weight * ways[va].reward
            v, ends = ways[va].visible, ways[va].ends
        else:
            i, _ = draw_outcome(rows, outcomes, row_of(choices, va, values, 0), uniform_of(state))
            if choices[va].factor >= 0:
                values[0, choices[va].factor] = outcomes[i].value
            total += weight * outcomes[i].reward
            v, ends = outcomes[i].visible, outcomes[i].ends
        weight *= discount
        if ends:
            break
        a, state = random_legal(ways, choices, rows, n_actions, v, values, state)
    random[0] = state
    return total
