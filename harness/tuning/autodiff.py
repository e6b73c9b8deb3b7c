"""Gradient ascent on the smooth exact return, whose temperature falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.expectation.smooth.forward import COLDEST, HOTTEST, MOST_SITUATIONS
from harness.tuning.ascent import Ascent
from harness.tuning.method import MOST_EPISODES, Ask, Move, Softness, setting
from harness.tuning.tunable import Vector


@dataclass
class Autodiff(Ascent):
    """``autodiff``: momentum ascent along derivatives of the expected return with gates for comparisons.

    Value and gradient are those of :func:`harness.smooth`, computed, not played. A gate is soft over some τ of belief,
    so that a hot ascent sees cliffs from afar, and crosses plateaus; but what it climbs is then a policy that sometimes
    decides otherwise. τ falls from ``temperature`` by ``cooling`` in every iteration to ``coldest``. The ascent's own
    rule of stopping holds from there on.
    """

    decay: float = setting(60.0, 1e-9)
    """As of ``gradient``; slower, for a rate that outlasts the cooling."""
    iterations: int = setting(40, 1)
    temperature: float = setting(0.1, COLDEST, HOTTEST)
    """τ at first."""
    cooling: float = setting(0.85, 0.01, 1.0)
    """τ of an iteration over that of the one before."""
    coldest: float = setting(0.005, COLDEST, HOTTEST)
    """τ at last."""
    situations: int = setting(2_000, 2, MOST_SITUATIONS)
    """Of a step; where there are more, the unlikely ones are drawn, without bias."""
    episodes: int = setting(10_000, 2, MOST_EPISODES)
    """On which the result is played by its hard thresholds, beside the fresh ones; the ascent itself plays none."""

    def ask(self, iteration: int) -> Ask:
        """θ: (1, d), softly."""
        soft = Softness(self._temperature(iteration), self.situations)
        return Ask(self.theta[None, :], np.array([iteration * self.episodes]), self.episodes, soft)

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Climb along the derivatives."""
        return self.climb(iteration, values[1:])

    def _temperature(self, iteration: int) -> float:
        return max(self.coldest, self.temperature * self.cooling**iteration)

    def _reason(self, iteration: int, step: float, gradient: Vector) -> str:
        cold = self._temperature(iteration) == self.coldest
        return super()._reason(iteration, step, gradient) if cold else ""
