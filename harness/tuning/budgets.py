"""The budget of an online planner as numbers to sweep: return against simulations, and the time that they take."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.play.evaluation import Evaluation
from harness.policy.planner import despot, pomcp
from harness.policy.planner.budget import MOST
from harness.tuning.constants import Vector

COLUMN = "milliseconds"
"""An action, of a processor: it depends on the machine, unlike all else in a row."""


class Planner(NamedTuple):
    """An online planner with whole numbers that say how long it thinks."""

    make: Callable[[Domain, str], Any]
    """(domain, what stands behind the colon of the policy string) -> the planner."""
    default: int
    """Of the first number."""
    most: Mapping[str, int]
    """Of each of the numbers; the first is the one that needs no name in a policy string."""
    numbers: Callable[[Any], list[int]]
    """Those of a planner."""


PLANNERS = {
    pomcp.WORD: Planner(pomcp.make, pomcp.SIMULATIONS, {"simulations": MOST}, lambda p: [p.budget.count]),
    despot.WORD: Planner(
        despot.make,
        despot.SCENARIOS,
        {"scenarios": despot.MOST_SCENARIOS, "trials": MOST},
        lambda p: [p.scenarios, p.budget.count],
    ),
}
"""By the first word of a policy string."""


@dataclass(frozen=True, eq=False)
class Budgeted:
    """A planner as a Tunable whose numbers are its budget; other settings stay as they are given."""

    domain: Domain
    word: str
    settings: str
    start: Vector
    max_episodes: int
    """As many episodes does a point get unless told otherwise."""

    @property
    def names(self) -> tuple[str, ...]:
        """``simulations``, or what the planner counts instead."""
        return tuple(PLANNERS[self.word].most)

    @property
    def lower(self) -> Vector:
        """One of each."""
        return np.ones(len(self.names))

    @property
    def upper(self) -> Vector:
        """The most that a policy string may ask for."""
        return np.array([float(most) for most in PLANNERS[self.word].most.values()])

    def policy(self, theta: Vector) -> Any:
        """The planner at these numbers; broken ones are rounded."""
        return PLANNERS[self.word].make(self.domain, self.text(theta).partition(":")[2])

    def text(self, theta: Vector) -> str:
        """Its policy string."""
        first, *others = (str(round(float(x))) for x in theta)
        named = [f",{name}={x}" for name, x in zip(self.names[1:], others, strict=True)]
        return f"{self.word}:{first}{''.join(named)}{self.settings}"


def of_planner(spec: object, domain: Domain) -> Budgeted | None:
    """What a planner's string makes to sweep over; None for any other policy.

    Raises:
        PolicyError: it is a planner's, and something in it is unknown or out of range, or its budget is a time.
    """
    word, _, given = spec.partition(":") if isinstance(spec, str) else ("", "", "")
    if word not in PLANNERS:
        return None
    planner = PLANNERS[word]
    made = planner.make(domain, given or str(planner.default))
    names = [part.partition("=")[0] for part in given.split(",") if "=" in part]
    if "time" in names:
        raise PolicyError(f"a sweep of {word} counts {' and '.join(planner.most)}; leave time out")
    others = [part for part in given.split(",") if "=" in part and part.partition("=")[0] not in planner.most]
    settings = "".join(f",{part}" for part in others)
    return Budgeted(domain, word, settings, np.array(planner.numbers(made), dtype=np.float64), made.max_episodes)


def milliseconds(seconds: float, played: Evaluation) -> float:
    """What an action took, from the processor's seconds of all threads."""
    return 1000.0 * seconds / float(played.steps.sum())
