"""One number after the other, by bisection: for returns that are step functions of each number."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.tuning.method import MOST_EPISODES, Ask, Move, setting
from harness.tuning.tunable import Tunable, Vector

_DIGITS = 10  # so that the grid has the numbers that people write


@dataclass
class Lines:
    """``lines``: the best value of one number at a time, on one fixed set of episodes, until no number moves.

    On fixed episodes the return is a step function of a threshold: it changes only where the threshold passes a belief
    that some episode reaches, and there are few. So a number is tried at a few places over its whole range, and then
    the two edges of the best stretch are found by bisection; between two places with equal means nothing is looked
    for. A number moves only if that is better, and then to a place that was played: θ is never worse on these episodes
    than the start. Where it moves it takes the middle of the best stretch, as far as can be from both edges.
    """

    subject: Tunable
    seed: int
    resolution: float = setting(0.01, 1e-6, 1.0)
    """Of every number: places are ``lower`` + whole multiples of this."""
    coarse: int = setting(4, 1)
    """Stretches of the first look at a number's range."""
    rounds: int = setting(3, 1)
    """Times that every number is gone through, at most."""
    iterations: int = setting(2000, 1)
    episodes: int = setting(10_000, 2, MOST_EPISODES)
    """The same at every point of the run."""
    theta: Vector = field(init=False)

    def __post_init__(self) -> None:
        """At the start, whose return is not known yet."""
        self.theta = self.subject.start.copy()
        self._number, self._since, self._round = 0, 0, 0  # which one; how many since the last move; which round
        self._known: dict[float, float] = {}  # of this number: its values and the return there

    def ask(self, iteration: int) -> Ask:
        """θ with one of its numbers at other values: (n, d)."""
        self._values = self._wanted()
        points = np.repeat(self.theta[None, :], len(self._values), axis=0)
        points[:, self._number] = self._values
        return Ask(points, np.zeros(len(points), dtype=np.int64), self.episodes)

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Narrow the best stretch; at its end move, and go on with the next number."""
        self._known.update(zip(self._values, values.tolist(), strict=True))
        step, stop = 0.0, ""
        while not stop and not self._wanted():
            step = max(step, self._settle())
            stop = self._next()
        return Move(step, self.resolution, stop=stop)

    def _wanted(self) -> list[float]:
        """Values of the present number to play next; none when its best stretch is known."""
        now = float(self.theta[self._number])
        if len(self._known) < 2:
            return sorted({*self._grid(), now} - self._known.keys())
        known = sorted(self._known)
        first, last = self._best_stretch(known)
        edges = [(known[i], known[i + 1]) for i in (first - 1, last) if 0 <= i < len(known) - 1]
        return [middle for edge in edges if (middle := self._between(*edge)) is not None]

    def _grid(self) -> list[float]:
        low, high = float(self.subject.lower[self._number]), float(self.subject.upper[self._number])
        return [self._rounded(x) for x in np.linspace(low, high, self.coarse + 1)]

    def _rounded(self, x: float) -> float:
        low, high = float(self.subject.lower[self._number]), float(self.subject.upper[self._number])
        return min(high, round(low + round((x - low) / self.resolution) * self.resolution, _DIGITS))

    def _between(self, low: float, high: float) -> float | None:
        """The place nearest the middle of two values; None where there is none between them."""
        middle = self._rounded((low + high) / 2)
        return middle if low < middle < high and middle not in self._known else None

    def _best_stretch(self, known: list[float]) -> tuple[int, int]:
        """First and last index of the neighbouring values that share the best return; θ's own stretch where it does."""
        best = max(self._known.values())
        now = float(self.theta[self._number])
        first = last = known.index(now) if self._known[now] == best else self._argmax(known)
        while first > 0 and self._known[known[first - 1]] == best:
            first -= 1
        while last < len(known) - 1 and self._known[known[last + 1]] == best:
            last += 1
        return first, last

    def _argmax(self, known: list[float]) -> int:
        return max(range(len(known)), key=lambda i: self._known[known[i]])

    def _settle(self) -> float:
        """Move the present number if another value is better; how far."""
        known, k = sorted(self._known), self._number
        first, last = self._best_stretch(known)
        now = float(self.theta[k])
        if self._known[now] == self._known[known[first]]:
            self._since += 1
            return 0.0
        middle = (known[first] + known[last]) / 2
        self.theta = self.theta.copy()
        self.theta[k] = min(known[first : last + 1], key=lambda x: abs(x - middle))
        self._since = 1
        return abs(float(self.theta[k]) - now)

    def _next(self) -> str:
        """Go on with the next number, whose return at θ is known from the last one; why not, where all is done."""
        value = self._known[float(self.theta[self._number])]
        d = len(self.theta)
        self._number = (self._number + 1) % d
        self._round += self._number == 0
        self._known = {float(self.theta[self._number]): value}
        if self._since >= d:
            return "no single number can be moved for the better on these episodes"
        return f"all {self.rounds} rounds are done" if self._round >= self.rounds else ""
