"""Gradient of a smoothed return by the score function, for policies that are no smooth function of their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.engine import rng
from harness.tuning.ascent import Ascent
from harness.tuning.method import MOST_EPISODES, Ask, Move, setting
from harness.tuning.tunable import Vector


@dataclass
class ScoreFunction(Ascent):
    """``score``: momentum ascent on J_s(θ) = E[J(θ + s·z)], z standard normal, by the likelihood ratio.

    A threshold makes the return a step function of θ along every episode, which no automatic differentiation of the
    policy can see through. Softened (the threshold drawn anew around θ for each few episodes; parameter-based
    exploration, Sehnke et al. 2010), the expected return is smooth, and ∇J_s(θ) = E[(J(θ + s·z) − b) · z / s] for any
    baseline b. Draws come in pairs ±z on the same episodes; each is the other's baseline, and what both have in common
    cancels. Points outside the bounds are moved to them, which is part of J. The result is θ as a hard threshold.
    """

    spread: float = setting(0.01, 1e-9)
    """s, the temperature: how soft the thresholds are. The result is the best *soft* threshold: where s is wider than
    the structure of the return (hundredths, for the heuristics), a cliff nearby, as at belief:1, pushes it away."""
    pairs: int = setting(50, 1)
    """Draws ±z an iteration."""
    episodes: int = setting(100, 2, MOST_EPISODES)
    """For each draw; with 50 pairs an iteration has 10,000."""

    def ask(self, iteration: int) -> Ask:
        """θ + s·z and θ − s·z of every pair: (2·pairs, d); each pair has episodes of its own."""
        offset = self.spread * self._draws(iteration)
        points = np.stack([self.theta + offset, self.theta - offset], axis=1).reshape(-1, len(self.theta))
        pair = iteration * self.pairs + np.arange(self.pairs)
        return Ask(
            np.clip(points, self.subject.lower, self.subject.upper), np.repeat(pair * self.episodes, 2), self.episodes
        )

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Climb along the mean over the pairs."""
        return self.climb(iteration, self.terms(iteration, values).mean(axis=0))

    def terms(self, iteration: int, values: Vector) -> Vector:
        """(pairs, d) what each pair says of the gradient: independent, and unbiased for ∇J_s(θ)."""
        up, down = values[0::2], values[1::2]
        terms: Vector = ((up - down) / 2)[:, None] * self._draws(iteration) / self.spread
        return terms

    def _draws(self, iteration: int) -> Vector:
        draws = rng.generator(rng.TRAINING + self.seed, rng.TUNER, iteration)
        return draws.standard_normal((self.pairs, len(self.subject.start)))
