"""The numbers in a program as numbers to tune: the paper's "variables, and not constants, in the terminal set"."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.errors import PolicyError
from harness.policy.program import ProgramPolicy
from harness.program import Program

Vector = NDArray[np.float64]

DECIMALS = 4
"""Of a program's constants. The program that is played has exactly the numbers that its text shows."""


@dataclass(frozen=True, eq=False)
class Constants:
    """Every number that a belief is compared with in a program, as c1, c2, … in the order of the text.

    A Tunable (:class:`harness.tuning.tunable.Tunable`); bounds [0, 1], for beliefs are probabilities; the start is the
    program's own constants. d of them.
    """

    program: Program
    names: tuple[str, ...] = field(init=False)
    lower: Vector = field(init=False)
    upper: Vector = field(init=False)
    start: Vector = field(init=False)

    def __post_init__(self) -> None:
        """Find the constants.

        Raises:
            PolicyError: there is none.
        """
        start = np.clip(np.round(self.program.constants, DECIMALS), 0.0, 1.0)
        if not len(start):
            raise PolicyError("the program compares no belief with a number, so there is nothing in it to tune")
        names = tuple(f"c{i + 1}" for i in range(len(start)))
        for name, value in (("names", names), ("start", start), ("lower", 0.0 * start), ("upper", 0.0 * start + 1)):
            object.__setattr__(self, name, value)

    def at(self, theta: Vector) -> Program:
        """The program with the constants ``theta`` (d,), rounded to :data:`harness.tuning.constants.DECIMALS`."""
        return self.program.with_constants(np.round(theta, DECIMALS))

    def policy(self, theta: Vector) -> ProgramPolicy:
        """The policy that :meth:`text` spells."""
        return ProgramPolicy(self.at(theta))

    def text(self, theta: Vector) -> str:
        """The program's text, which parses to the very program that :meth:`policy` runs."""
        return self.at(theta).text
