"""The literature's problems against the files that they circulate in.

The files are not part of this repository. What stands here of each are two sums over all that it says, taken once, of
the file as :func:`harness.load` reads it: of the probability of every next state and reading, and of every reward,
weighed by cosines of codes that do not depend on how a file numbers its states.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import harness
from harness.model.domain import Domain

Code = Callable[[int], float]


def checksums(d: Domain, cell: Code, value: Code, action: Code, reading: Code) -> tuple[float, float]:
    """The two sums of a domain with one hidden factor; the end of an episode has the code 0, and reads nothing."""
    t, dynamics, rewards = d.arrays, 0.0, 0.0
    cosines = np.cos([2 * reading(o) for o in range(d.n_observations)])
    for v in np.flatnonzero(~t["terminal"]).tolist():
        for a in range(d.n_actions):
            row = int(t["first_row"][v * d.n_actions + a])
            for x in range(d.factor_sizes[0]):
                if np.isnan(value(x)):
                    continue
                weight = np.cos(cell(v) + 3 * action(a) + 7 * value(x))
                at = row + (x if t["factor"][v * d.n_actions + a] >= 0 else 0)
                for j in range(t["row_outcomes"][at], t["row_outcomes"][at + 1]):
                    vp = int(t["outcome_visible"][j])
                    xp = int(t["outcome_value"][j]) if t["factor"][v * d.n_actions + a] >= 0 else x
                    ended = t["terminal"][vp] or np.isnan(value(xp))
                    seen = 1.0 if ended else t["observation_probability"][t["outcome_observation"][j]] @ cosines
                    next_code = 0.0 if ended else cell(vp) + 5 * value(xp)
                    dynamics += weight * t["outcome_probability"][j] * np.cos(next_code) * seen
                    rewards += weight * t["outcome_probability"][j] * t["outcome_reward"][0][j]
    return float(dynamics), float(rewards)


def numbered(d: Domain) -> tuple[float, float]:
    """Of domains whose whole state is hidden, in the order of the file."""
    return checksums(d, lambda v: 0.0, float, float, float)


def placed(d: Domain, values: list[float]) -> tuple[float, float]:
    """Of domains with a visible cell (x, y), whose hidden values have codes of their own."""
    here = d.visible_values.astype(float) @ [1, 10]
    return checksums(d, lambda v: float(here[v]), lambda x: values[x], float, float)


@pytest.mark.parametrize(
    ("name", "dynamics", "rewards"),
    [
        ("tiger", 0.7512342876, 7.7116568364),
        ("tiger-grid", 1.1239105, -7.1300717),
        ("hallway", 5.7625562, -0.5076993),
        ("hallway2", 1.1116609, 0.7209775),
    ],
)
def test_a_hidden_state_s_tables_are_those_of_the_file(name, dynamics, rewards):
    assert numbered(harness.load(name)) == pytest.approx((dynamics, rewards), abs=2e-4)  # files have six digits


def test_tag_is_that_of_tagavoid_pomdpx():
    domain = harness.load("tag")
    cells = [float(x) + 10 * float(y) for x, y in (label.strip("()").split(",") for label in domain.factor_labels[0])]
    assert placed(domain, cells) == pytest.approx((-36.3520153, 70.9554540), abs=2e-4)


def test_heaven_and_hell_are_those_of_heavenhell_pomdp():
    assert placed(harness.load("heaven-hell"), [0.0, 1.0]) == pytest.approx((1.1677959979, 0.1957539278), abs=1e-8)
