"""What a planner's simulations need of a domain, and the compiled verbs that they share."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.splitmix import next_uniform
from harness.model.tables import Records, Sensors, inlined
from harness.policy.planner.random_play import ways_of

_NEGLIGIBLE = 0.01  # of the present reward: what is weighed less is not simulated
LONGEST = 1000
"""Steps that a simulation may reach ahead."""


class Model(NamedTuple):
    """A domain as simulations see it. V visible values, A actions, K hidden factors."""

    choices: Records
    rows: Records
    outcomes: Records
    reading_probability: NDArray[np.float64]
    reading_cdf: NDArray[np.float64]
    sensors: Sensors | None
    factor_offset: NDArray[np.int64]
    ways: Records
    """(V·A,) of :data:`.random_play.WAY`."""
    allowed: NDArray[np.bool_]
    """(V·A,) choices that are legal for some hidden value: what trees branch on."""
    n_actions: int
    discount: float
    horizon: int
    """Steps that a simulation reaches ahead."""

    def __deepcopy__(self, memo: object) -> Model:
        """Itself: nobody writes to it, so copies of a policy share it."""
        return self


def model_of(domain: Domain, depth: int | None = None) -> Model:
    """The domain under its true reward; simulations reach ``depth`` steps ahead, by default :func:`horizon_of`."""
    true = domain.shaped("none")
    t = true.tables
    return Model(
        t.choices,
        t.rows,
        t.outcomes,
        t.reading_probability,
        t.reading_cdf,
        t.sensors,
        t.factor_offset,
        ways_of(true),
        _allowed(domain),
        domain.n_actions,
        float(domain.discount),
        depth or horizon_of(domain.discount),
    )


def horizon_of(discount: float) -> int:
    """Steps after which a reward weighs less than a hundredth: 90 at a discount of 0.95."""
    return LONGEST if discount >= 1.0 else min(LONGEST, math.ceil(math.log(_NEGLIGIBLE) / math.log(discount)))


def reward_range(domain: Domain) -> float:
    """The largest reward of a legal step less the smallest: 20 on RockSample, whose penalty nobody has to pay."""
    t = domain.shaped("none").tables
    legal = np.repeat(t.rows["legal"], t.rows["last"] - t.rows["first"])
    rewards = t.outcomes["reward"][legal]
    return float(rewards.max() - rewards.min())


def _allowed(domain: Domain) -> NDArray[np.bool_]:
    t = domain.tables
    sizes = np.array([*domain.factor_sizes, 1])[t.choices["factor"]]  # the last entry where there is no factor: −1
    first = t.choices["first_row"]
    legal = np.concatenate([[0], np.cumsum(t.rows["legal"])])
    return (first >= 0) & (legal[np.where(first >= 0, first + sizes, 0)] > legal[np.maximum(first, 0)])


@inlined
def draw_hidden(
    factor_offset: NDArray[np.int64],
    marginals: NDArray[np.float64],
    e: int,
    state: NDArray[np.uint64],
    hidden: NDArray[np.int16],
) -> None:
    """Values of all factors from the belief of episode ``e``, into ``hidden[0]``."""
    for k in range(len(factor_offset) - 1):
        first = factor_offset[k]
        u = next_uniform(state)
        total = 0.0
        for x in range(factor_offset[k + 1] - first):
            if marginals[e, first + x] > 0.0:
                hidden[0, k] = x
                total += marginals[e, first + x]
                if u < total:
                    break
