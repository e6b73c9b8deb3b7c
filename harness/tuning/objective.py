"""The return as a function of a policy's numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from harness import engine as engines
from harness import host
from harness.engine import rng
from harness.errors import HarnessError, nearest, quoted
from harness.model.domain import Domain
from harness.play import population
from harness.play.evaluation import Evaluation, evaluate
from harness.tuning.constants import Constants
from harness.tuning.method import Ask
from harness.tuning.tunable import Tunable, Vector

MEASURES = ("return", "discounted")
"""What is maximised: the undiscounted return within the horizon (the paper's), or the discounted one."""

SEEDS = rng.HELD_OUT
"""Seeds of runs lie below this, so that training, held-out and everybody's episodes never meet."""


class Objective(Protocol):
    """Anything that can be played at points; a method sees nothing else of the world."""

    def __call__(self, ask: Ask) -> NDArray[np.float64]:
        """(n, episodes) a return for every point and episode."""


@dataclass(frozen=True)
class Episodes:
    """The returns of a tunable policy on a domain, in episodes that nobody scores with."""

    domain: Domain
    subject: Tunable
    seed: int
    horizon: int
    measure: str
    engine: str = "auto"
    workers: int | None = None
    range: int = rng.TRAINING
    """Of seeds: what is added to ``seed``."""

    def __call__(self, ask: Ask) -> NDArray[np.float64]:
        """(n, episodes) returns by :attr:`measure`, as the domain's shaping pays them."""
        if isinstance(self.subject, Constants) and self.measure == "return":
            return self._together(self.subject, ask)
        first = (int(k) for k in ask.first)
        return np.stack(
            [
                measured(self.play(point, ask.episodes, self.range + self.seed, k), self.measure)
                for point, k in zip(ask.points, first, strict=True)
            ]
        )

    def _together(self, subject: Constants, ask: Ask) -> NDArray[np.float64]:
        """The same returns, by one compiled loop over all points that meet the same episodes."""
        returns = np.empty((len(ask.points), ask.episodes))
        engine, workers = engines.choose(self.engine, self.domain), host.workers(self.workers)
        for first in np.unique(ask.first):
            rows = np.flatnonzero(ask.first == first)
            programs = [subject.at(ask.points[row]) for row in rows]
            episodes = population.Episodes(self.range + self.seed, int(first), ask.episodes, self.horizon)
            returns[rows] = population.play(self.domain, programs, episodes, engine, workers).returns
        return returns

    def play(self, theta: Vector, episodes: int, seed: int, first: int = 0) -> Evaluation:
        """The policy at one point."""
        return evaluate(
            self.domain,
            self.subject.policy(theta),
            episodes=episodes,
            seed=seed,
            first=first,
            horizon=self.horizon,
            engine=self.engine,
            workers=self.workers,
        )


def measured(result: Evaluation, measure: str) -> NDArray[np.float64]:
    """(episodes,) the returns that a measure is about."""
    return result.returns if measure == "return" else result.discounted


def check(measure: str, seed: int) -> None:
    """Check what every run needs.

    Raises:
        HarnessError: the measure is unknown or the seed out of range.
    """
    if measure not in MEASURES:
        raise HarnessError(f"no measure {quoted(measure)}{nearest(measure, MEASURES)} (known: {', '.join(MEASURES)})")
    if not 0 <= seed < SEEDS:
        raise HarnessError(f"seed must be a whole number from 0 to 2**61 - 1, not {seed}")
