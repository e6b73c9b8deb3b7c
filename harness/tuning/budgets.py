"""The budget of an online planner as a number to sweep: return against simulations, and the time that they take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.model.domain import Domain
from harness.play.evaluation import Evaluation
from harness.policy.planner import pomcp
from harness.policy.planner.budget import MOST
from harness.tuning.constants import Vector

COLUMN = "milliseconds"
"""An action, of a processor: it depends on the machine, unlike all else in a row."""


@dataclass(frozen=True, eq=False)
class Simulations:
    """A planner as a Tunable with one number, its simulations an action; other settings stay as they are given."""

    domain: Domain
    settings: str
    start: Vector
    names: tuple[str, ...] = ("simulations",)

    @property
    def lower(self) -> Vector:
        """One simulation."""
        return np.array([1.0])

    @property
    def upper(self) -> Vector:
        """The most that a policy string may ask for."""
        return np.array([float(MOST)])

    def policy(self, theta: Vector) -> pomcp.POMCPPolicy:
        """The planner with so many simulations; a broken number is rounded."""
        return pomcp.make(self.domain, self.text(theta).partition(":")[2])

    def text(self, theta: Vector) -> str:
        """Its policy string."""
        return f"{pomcp.WORD}:{round(float(theta[0]))}{self.settings}"


def of_planner(spec: object, domain: Domain) -> Simulations | None:
    """What a planner's string makes to sweep over; None for any other policy.

    Raises:
        PolicyError: it is a planner's, and something in it is unknown or out of range.
    """
    word, _, given = spec.partition(":") if isinstance(spec, str) else ("", "", "")
    if word != pomcp.WORD:
        return None
    others = [
        part for part in given.split(",") if "=" in part and part.partition("=")[0] not in ("simulations", "time")
    ]
    settings = "".join(f",{part}" for part in others)
    made = pomcp.make(domain, given or str(pomcp.SIMULATIONS))
    return Simulations(domain, settings, np.array([float(made.budget.count)]))


def milliseconds(seconds: float, played: Evaluation) -> float:
    """What an action took, from the processor's seconds of all threads."""
    return 1000.0 * seconds / float(played.steps.sum())
