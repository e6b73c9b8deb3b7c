"""The return as a function of a policy's numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from harness import engine as engines
from harness.engine import rng
from harness.errors import HarnessError, nearest, quoted
from harness.expectation.smooth.forward import forward
from harness.model.domain import Domain
from harness.play import executor, population
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

    def smooth(self, ask: Ask) -> Vector:
        """(1 + d,) the smooth return of a soft ask's point, and its gradient."""


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
        items = [(point, int(first), ask.episodes) for point, first in zip(ask.points, ask.first, strict=True)]
        workers = executor.current() if self.engine == "tables" else None
        return np.stack(list(executor.ordered(workers, _returns, items, self, name=self._name)))

    def _name(self, item: tuple[Vector, int, int]) -> str:
        return f"{self.subject.text(item[0]).splitlines()[0]} on {self.domain.name}"

    def _together(self, subject: Constants, ask: Ask) -> NDArray[np.float64]:
        """The same returns, by one compiled loop over all points that meet the same episodes."""
        returns = np.empty((len(ask.points), ask.episodes))
        engine, workers = engines.choose(self.engine, self.domain), executor.threads(self.workers)
        for first in np.unique(ask.first):
            rows = np.flatnonzero(ask.first == first)
            programs = [subject.at(ask.points[row]) for row in rows]
            episodes = population.Episodes(self.range + self.seed, int(first), ask.episodes, self.horizon)
            returns[rows] = population.play(self.domain, programs, episodes, engine, workers).returns
        return returns

    def smooth(self, ask: Ask) -> Vector:
        """(1 + d,) the smooth return by ``measure``, and its gradient.

        Raises:
            PolicyError: the policy has none by the numbers that are tuned.
        """
        soft, first = ask.soft, int(ask.first[0])
        assert soft is not None
        draws = rng.generator(self.range + self.seed, rng.TUNER, first)
        policy = self.subject.policy(ask.points[0])
        found = forward(self.domain, policy, soft.temperature, self.horizon, soft.situations, draws)
        if self.measure == "return":
            return np.append(found.value, found.gradient)
        return np.append(found.discounted, found.discounted_gradient)

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


def _returns(played: Episodes, item: tuple[Vector, int, int]) -> NDArray[np.float64]:
    """(episodes,) the returns at a point in the episodes from a first one on."""
    point, first, episodes = item
    return measured(played.play(point, episodes, played.range + played.seed, first), played.measure)


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
