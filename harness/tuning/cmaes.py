"""CMA-ES (Hansen 2016), by the ``cma`` package."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cma
import numpy as np

from harness.engine import rng
from harness.tuning.method import MOST_EPISODES, Ask, Move, setting
from harness.tuning.tunable import Tunable, Vector


@dataclass
class CmaEs:
    """``cmaes``: candidates from a normal distribution that follows the better half; the same episodes in a generation.

    θ is the distribution's mean, the estimate that noise spoils least. Numbers are scaled to [0, 1] by their bounds.
    """

    subject: Tunable
    seed: int
    sigma: float = setting(0.3, 1e-9, 1.0)
    """First standard deviation, as a share of each number's range."""
    candidates: int = setting(0, 0, 10_000)
    """A generation's; 0 for the package's rule, 4 + 3·ln(d), rounded down."""
    tolerance: float = setting(0.001, 0)
    """Stop when the distribution is narrower than this share of each number's range."""
    patience: int = setting(10, 1)
    """Stop when as many generations find the same return at every candidate: a plateau."""
    iterations: int = setting(60, 1)
    episodes: int = setting(10_000, 2, MOST_EPISODES)
    """At each point."""
    theta: Vector = field(init=False)

    def __post_init__(self) -> None:
        """A distribution around the start."""
        self.theta = self.subject.start.copy()
        self._draws = self._generator(0)
        self._range = self.subject.upper - self.subject.lower
        start = (self.theta - self.subject.lower) / self._range
        if len(start) == 1:
            start = np.append(start, 0.5)  # the package takes no single number: a second one that changes nothing
        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: self._draws.standard_normal(shape),
            "seed": math.nan,  # leaves NumPy's global generator alone: all draws are ours
            "tolx": self.tolerance,
            "tolfun": 0.0,  # values of different generations are of different episodes
            "tolfunhist": 0.0,
            "tolflatfitness": self.patience,
            "verbose": -9,
        }
        if self.candidates:
            options["popsize"] = max(self.candidates, 3)
        self._strategy = cma.CMAEvolutionStrategy(start, self.sigma, options)

    def ask(self, iteration: int) -> Ask:
        """A generation: (candidates, d)."""
        self._draws = self._generator(iteration)
        self._scaled = self._strategy.ask()
        points = self._points(np.array(self._scaled))
        return Ask(points, np.full(len(points), iteration * self.episodes), self.episodes)

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Let the distribution follow."""
        self._strategy.tell(self._scaled, list(-values))  # the package minimises
        before = self.theta
        self.theta = self._points(np.asarray(self._strategy.result.xfavorite)[None, :])[0]
        criteria = ", ".join(f"{name} {value}" for name, value in self._strategy.stop().items())
        stop = f"CMA-ES met its criterion {criteria} after {iteration + 1} generations" if criteria else ""
        return Move(float(np.abs(self.theta - before).max()), float(self._strategy.sigma), stop=stop)

    def _points(self, scaled: Vector) -> Vector:
        d = len(self._range)
        points = self.subject.lower + scaled[:, :d] * self._range
        return np.clip(points, self.subject.lower, self.subject.upper)

    def _generator(self, iteration: int) -> np.random.Generator:
        return rng.generator(rng.TRAINING + self.seed, rng.TUNER, iteration)
