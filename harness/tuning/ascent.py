"""Momentum gradient ascent (the paper's eq. 4, 5 and 7 and Table 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from harness.tuning.method import MOST_EPISODES, Ask, Move, setting
from harness.tuning.tunable import Tunable, Vector


@dataclass
class Ascent:
    """What every momentum ascent shares: v ← γv + α∇J(θ), θ ← θ + v, with a rate that decays.

    The paper clips gradient and momentum and does not say where. A return changes by about 0.1 over ε = 0.01 from noise
    alone, so the estimate is often ±10 and clipping decides what happens: with the gradient clipped at 1 the ascent is
    one by sign, and Table 3's rates, which add up to 0.31, bound what it can travel to about 0.4 in all. Early steps of
    0.05 cross the slope; the decay then shrinks the wandering on the flat top, until a step is below the tolerance.
    """

    subject: Tunable
    seed: int
    rate: float = setting(0.05, 1e-9)
    """α0 of Table 3."""
    decay: float = setting(20.0, 1e-9)
    """α_{t+1} = α_t · exp(−t / decay) (Table 3)."""
    momentum: float = setting(0.2, 0, 0.999)
    """γ of eq. 4 (Table 3)."""
    gradient_clip: float = setting(1.0, 1e-9)
    """Each component of the gradient is kept within ± this."""
    velocity_clip: float = setting(0.05, 1e-9)
    """Each component of v is kept within ± this: a tenth of the thresholds' range."""
    tolerance: float = setting(0.001, 0)
    """Stop when the step is below this (Table 3)."""
    iterations: int = setting(100, 1)
    theta: Vector = field(init=False)

    def __post_init__(self) -> None:
        """At the start, at rest."""
        self.theta = self.subject.start.copy()
        self._velocity = np.zeros_like(self.theta)
        self._rate = self.rate

    def climb(self, iteration: int, gradient: Vector) -> Move:
        """One step of eq. 4 and 5 along a gradient (d,)."""
        clipped = np.clip(gradient, -self.gradient_clip, self.gradient_clip)
        pushed = self.momentum * self._velocity + self._rate * clipped
        self._velocity = np.clip(pushed, -self.velocity_clip, self.velocity_clip)
        before, rate = self.theta, self._rate
        self.theta = np.clip(before + self._velocity, self.subject.lower, self.subject.upper)
        self._rate *= math.exp(-iteration / self.decay)
        step = float(np.abs(self.theta - before).max())
        return Move(step, rate, gradient, self._velocity, self._reason(iteration, step, gradient))

    def _reason(self, iteration: int, step: float, gradient: Vector) -> str:
        if step >= self.tolerance:
            return ""
        if not gradient.any():
            return f"the return is the same at all points asked for, so the gradient is 0{_after(iteration)}{_PLATEAU}"
        return f"the step {step:.2g} is below the tolerance {self.tolerance:g}{_after(iteration)}"


_PLATEAU = " (a plateau: a sweep shows where there is a slope to start from)"


def _after(iteration: int) -> str:
    return f" after {iteration + 1} iteration{'s' if iteration else ''}"


@dataclass
class ForwardDifference(Ascent):
    """``gradient``: a forward difference for each number (eq. 7), both ends on the same episodes.

    Every iteration plays episodes of its own. Within ``epsilon`` of an upper bound the difference is taken backward.
    """

    epsilon: float = setting(0.01, 1e-9, 0.25)
    """ε of eq. 7 (Table 3)."""
    episodes: int = setting(10_000, 2, MOST_EPISODES)
    """At each point (Table 3)."""

    def ask(self, iteration: int) -> Ask:
        """θ, and θ with each of its numbers moved in turn: (1 + d, d)."""
        room = self.theta + self.epsilon <= self.subject.upper
        ends = self.theta + np.diag(np.where(room, self.epsilon, -self.epsilon))
        points = np.vstack([self.theta, ends])
        return Ask(points, np.full(len(points), iteration * self.episodes), self.episodes)

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Climb along the difference quotients."""
        width = np.diagonal(ask.points[1:]) - ask.points[0]
        return self.climb(iteration, (values[1:] - values[0]) / width)
