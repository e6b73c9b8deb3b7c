"""Simultaneous perturbation stochastic approximation (Spall 1992, gains after Spall 1998)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.engine import rng
from harness.tuning.method import MOST_EPISODES, Ask, Move, setting
from harness.tuning.tunable import Tunable, Vector


@dataclass
class Spsa:
    """``spsa``: two points an iteration, however many numbers: all are perturbed at once, each by ±c_k at random.

    θ ← θ + a_k·ĝ, ĝ_i = (J(θ + c_k·Δ) − J(θ − c_k·Δ)) / (2·c_k·Δ_i), on the same episodes; a_k = a / (A + k + 1)^α,
    c_k = c / (k + 1)^γ. ``a`` fits returns that change by some tens over the range of a threshold.
    """

    subject: Tunable
    seed: int
    a: float = setting(0.005, 1e-12)
    c: float = setting(0.02, 1e-9, 0.25)
    """First perturbation: wide enough for the difference to rise above its noise."""
    stability: float = setting(5.0, 0)
    """A: about a tenth of the iterations (Spall)."""
    alpha: float = setting(0.602, 0)
    gamma: float = setting(0.101, 0)
    largest_step: float = setting(0.05, 1e-9)
    """Each component of a step is kept within ± this."""
    iterations: int = setting(60, 1)
    episodes: int = setting(10_000, 2, MOST_EPISODES)
    """At each point."""
    theta: Vector = field(init=False)

    def __post_init__(self) -> None:
        """At the start."""
        self.theta = self.subject.start.copy()

    def ask(self, iteration: int) -> Ask:
        """θ + c_k·Δ and θ − c_k·Δ: (2, d); moved inward first where one would leave the bounds."""
        width = self._width(iteration)
        room = np.minimum(width, (self.subject.upper - self.subject.lower) / 2)
        middle = np.clip(self.theta, self.subject.lower + room, self.subject.upper - room)
        points = np.stack([middle + room * self._signs(iteration), middle - room * self._signs(iteration)])
        points = np.clip(points, self.subject.lower, self.subject.upper)  # rounding may leave by a last digit
        return Ask(points, np.full(2, iteration * self.episodes), self.episodes)

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Step along the difference."""
        gradient = (values[0] - values[1]) / (ask.points[0] - ask.points[1])
        gain = self.a / (self.stability + iteration + 1) ** self.alpha
        before = self.theta
        step = np.clip(gain * gradient, -self.largest_step, self.largest_step)
        self.theta = np.clip(before + step, self.subject.lower, self.subject.upper)
        return Move(float(np.abs(self.theta - before).max()), gain, gradient)

    def _width(self, iteration: int) -> float:
        return self.c / (iteration + 1) ** self.gamma

    def _signs(self, iteration: int) -> Vector:
        draws = rng.generator(rng.TRAINING + self.seed, rng.TUNER, iteration)
        return draws.choice([-1.0, 1.0], size=len(self.theta))
