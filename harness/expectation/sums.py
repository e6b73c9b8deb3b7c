"""What the steps of an expansion add up to, and what rounding and unexpanded situations leave open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness import cards
from harness.expectation.left import Prospects
from harness.expectation.merging import GRAIN
from harness.expectation.situations import Layer, visible_of
from harness.model.domain import Domain

_UNIT = 2.0**-53


class Interval(NamedTuple):
    """A number that lies between two others; they are equal where it is known."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """The number itself where it is known."""
        return (self.low + self.high) / 2

    def __str__(self) -> str:
        """One number or two."""
        return f"{self.low:.4f}" if self.low == self.high else f"{self.low:.4f} to {self.high:.4f}"


@dataclass(frozen=True)
class Exact:
    """What a policy earns in expectation, computed; intervals where not all situations could be expanded."""

    domain: Domain
    policy: str
    horizon: int
    mean: Interval
    """Undiscounted return within the horizon."""
    discounted: Interval
    """The same at the domain's discount."""
    steps: Interval
    """Steps until the end, the policy's stop, or the horizon."""
    success: Interval
    """Probability of reaching a terminal state."""
    rounding: float
    """Bound of what rounding may have changed in either end of ``mean``, and so of ``discounted``."""
    situations: int
    """Expanded, over all steps."""
    widest: int
    """In the step that had most."""
    left: float
    """Probability of the situations that were not expanded; 0 where the numbers are exact."""

    @property
    def is_exact(self) -> bool:
        """Whether nothing was left unexpanded."""
        return self.left == 0.0

    def __repr__(self) -> str:
        """The numbers and what they are of, on one line."""
        return cards.line("Exact", f"{self.policy} on {self.domain.name}", self._facts())

    def _repr_html_(self) -> str:
        return cards.card("Exact", f"{self.policy} on {self.domain.name}", self._facts())

    def _facts(self) -> dict[str, object]:
        more = {} if self.is_exact else {"not expanded": f"{self.left:.2g} of the probability"}
        return {
            "return": self.mean,
            "discounted": self.discounted,
            "horizon": self.horizon,
            "situations": f"{self.situations:,}",
            "rounding": f"{self.rounding:.0e}",
            **more,
        }


class Sums:
    """Collects the steps of one expansion.

    The bound of rounding is one of total variation. A step of a layer multiplies and adds numbers that are not
    negative: for each situation a rounding error of ``_each`` units at most, of the terms merged into one, and of
    1/GRAIN for every marginal that was rounded. Steps carry the total error on without enlarging it, so that after t
    steps the masses are off by the sum of t such errors, and the reward of the step by that times the largest reward.
    """

    def __init__(self, domain: Domain, horizon: int) -> None:
        """Nothing is earned yet."""
        t = domain.tables
        self._domain, self._horizon = domain, horizon
        self._prospects = [Prospects(domain, horizon, discount) for discount in (1.0, domain.discount)]
        self._largest = float(np.abs(t.outcomes["reward"]).max(initial=0.0))
        longest = int((t.rows["last"] - t.rows["first"]).max(initial=1)) * max(domain.factor_sizes, default=1)
        self._each = 8 + 4 * longest + sum(8 + 4 * domain.factor_sizes[sensor.factor] for sensor in domain.sensors)
        self._rewards: list[float] = []
        self._active: list[float] = []
        self._ended: list[float] = []
        self._low, self._high = np.zeros(4), np.zeros(4)
        self._situations = self._widest = 0
        self._left = self._off = self._rounding = 0.0

    def started(self, layer: Layer) -> Layer:
        """The first layer, without situations that have ended before they began."""
        done = self._domain.tables.terminal[visible_of(layer.key[:, 0])]
        self._ended.append(float(layer.mass[done].sum()))
        return Layer(layer.key[~done], layer.mass[~done])

    def step(self, active: float, reward: float, ended: float) -> None:
        """One more step: the probability of taking it, its expected reward, and the probability that it is the last."""
        self._active.append(active)
        self._rewards.append(reward)
        self._ended.append(ended)

    def merged(self, expanded: int, most: int, rounded: bool) -> None:
        """The step's situations: how many there were, most merged into one, and whether marginals were rounded."""
        self._situations += expanded
        self._widest = max(self._widest, expanded)
        adding = most * (len(self._domain.factors) + 1)
        self._off += (self._each + adding) * _UNIT + (self._domain.n_marginals / GRAIN if rounded else 0.0)
        self._rounding += self._off * self._largest

    def leave(self, layer: Layer, step: int) -> None:
        """Situations after so many steps that are not expanded."""
        mass = float(layer.mass.sum())
        bounds = [prospects.of(layer, step) for prospects in self._prospects]
        self._low += [*(low for low, _ in bounds), 0.0, 0.0]
        self._high += [*(high for _, high in bounds), mass * (self._horizon - step), mass]
        self._left += mass

    def result(self, name: str) -> Exact:
        """All of it."""
        weights = self._domain.discount ** np.arange(len(self._rewards))
        rewards = np.array(self._rewards)
        known = np.array([rewards.sum(), rewards @ weights, np.sum(self._active), np.sum(self._ended)])
        ends = zip((known + self._low).tolist(), (known + self._high).tolist(), strict=True)
        mean, discounted, steps, success = (Interval(*pair) for pair in ends)
        return Exact(
            domain=self._domain,
            policy=name,
            horizon=self._horizon,
            mean=mean,
            discounted=discounted,
            steps=steps,
            success=success,
            rounding=self._rounding,
            situations=self._situations,
            widest=self._widest,
            left=self._left,
        )
