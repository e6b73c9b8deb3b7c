"""One pass of dual numbers through the situations of a policy: its smooth expected return, and the gradient."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from numbers import Real
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from harness import cards, registry
from harness import policy as policies
from harness.engine import rng
from harness.errors import HarnessError, PolicyError, check_whole, quoted
from harness.expectation.expanding import expand, ways
from harness.expectation.situations import SEEN, first_layer
from harness.expectation.smooth.duals import Rows, written
from harness.expectation.smooth.heuristics import SoftAccuracy, SoftBelief, SoftThresholds
from harness.expectation.smooth.layers import disclose, thin, together
from harness.expectation.smooth.programs import SoftProgram
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON, check_played
from harness.policy import Policy
from harness.policy.heuristic import AccuracyPolicy, BeliefPolicy
from harness.policy.program import ProgramPolicy
from harness.policy.thresholds import ThresholdsPolicy

SITUATIONS = 20_000
"""Of a step at most, before the return is sampled in part."""
MOST_SITUATIONS = 10_000_000
COLDEST, HOTTEST = 1e-9, 1e3
"""Temperatures."""
_ROWS = 200_000  # that a policy writes at a time


@dataclass(frozen=True)
class Smooth:
    """What a policy earns in expectation when its comparisons with constants are gates, and how that changes."""

    value: float
    """Undiscounted return within the horizon."""
    gradient: NDArray[np.float64]
    """(d,) its derivatives by the policy's constants, in the order in which the policy names them."""
    discounted: float
    """The same at the domain's discount."""
    discounted_gradient: NDArray[np.float64]
    """(d,)"""
    situations: int
    """Expanded, over all steps."""
    thinned: int
    """Steps in which there were too many situations, and some stand for all; 0 where nothing was left to chance."""

    def __repr__(self) -> str:
        """The numbers on one line."""
        shown = np.array2string(self.gradient, precision=4, threshold=6)
        facts = {"gradient": shown, "discounted": f"{self.discounted:.4f}", "situations": f"{self.situations:,}"}
        facts["thinned steps"] = f"{self.thinned}"
        return cards.line("Smooth", f"{self.value:.4f}", facts)


class Soft(Protocol):
    """A policy with gates. A situation is M words of its memory, what is seen, and the beliefs."""

    constants: int
    """d"""
    memory: NDArray[np.int64]
    """(M,) at the start."""
    most: int
    """Things that it may do in one situation, at most."""

    def act(self, key: NDArray[np.int64], mass: NDArray[np.float64], temperature: float) -> tuple[Rows, int]:
        """Room with what may be done, and how many rows of it are written; memory in ``key`` may move on in place."""

    def watched(self, rows: Rows) -> NDArray[np.bool_]:
        """(B, K) of which factors the belief may yet be looked at."""


def smooth(
    domain: Domain | str,
    policy: Policy | str,
    *,
    temperature: float,
    horizon: int = HORIZON,
    situations: int = SITUATIONS,
    seed: int = 0,
) -> Smooth:
    """The expected return of a policy whose comparisons of beliefs and accuracies with constants are gates.

    A comparison x > c is true with probability sigmoid((x − c) / τ), anew whenever it is made; both ways are followed.
    As τ → 0 the value tends to :func:`harness.exact`'s, but for constants that equal a belief which is reached: there
    the return jumps, and the smooth one lies between.

    Args:
        domain: a domain or its name; its shaping counts.
        policy: a program (its constants are the numbers that it compares beliefs with, in the order of its text),
            ``belief``, ``accuracy`` or ``thresholds``, as a policy string or an object.
        temperature: τ, in the unit of the beliefs, from 1e-9 to 1000.
        horizon: steps after which an episode is truncated.
        situations: of one step at most. Where there are more, the likely ones are kept and the others drawn, without
            bias of value and gradient.
        seed: of these draws.

    Raises:
        PolicyError: the policy is another one.
        HarnessError: an argument is wrong.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    check_played(seed=seed, horizon=horizon)
    check_whole("situations", situations, 2, MOST_SITUATIONS)
    if isinstance(temperature, bool) or not isinstance(temperature, Real) or not COLDEST <= temperature <= HOTTEST:
        raise HarnessError(f"temperature must be a number from {COLDEST} to {HOTTEST}, not {quoted(temperature)}")
    made = policies.named(policy, domain)[1]
    return forward(domain, made, temperature, horizon, situations, rng.generator(seed, rng.TUNER, 0))


def forward(
    domain: Domain, policy: Policy, temperature: float, horizon: int, situations: int, draws: np.random.Generator
) -> Smooth:
    """:func:`smooth` with its arguments checked, and with given random numbers.

    Raises:
        PolicyError: as there.
    """
    return _Forward(domain, softened(domain, policy), temperature, situations, draws).run(horizon)


def softened(domain: Domain, policy: Policy, constants: int | None = None) -> Soft:
    """A policy with gates in place of its comparisons with constants.

    Args:
        domain: what it acts on.
        policy: the policy.
        constants: how many it must have.

    Raises:
        PolicyError: it is of a kind whose comparisons are not known, or has another number of constants.
    """
    if domain.sensors:
        raise PolicyError(
            f"{domain.name} is read by sensors at every step, for which no smooth return is known; tune by cmaes"
        )
    made: Soft | None = None
    if isinstance(policy, ProgramPolicy):
        made = SoftProgram(policy)
    for kind, soft in _HEURISTICS.items():
        if isinstance(policy, kind):
            made = soft(policy, domain.feature_columns)
    if made is None or constants not in (None, made.constants):
        raise PolicyError(
            f"{type(policy).__name__} has no comparisons with these numbers that are known, so no smooth return "
            "(programs, belief, accuracy and thresholds have one); tune it by --method cmaes, which only plays it"
        )
    return made


_HEURISTICS: dict[type, Callable[[Any, NDArray[np.int64]], Soft]] = {
    BeliefPolicy: SoftBelief,
    AccuracyPolicy: SoftAccuracy,
    ThresholdsPolicy: SoftThresholds,
}


class _Forward:
    """One pass."""

    def __init__(
        self, domain: Domain, soft: Soft, temperature: float, situations: int, draws: np.random.Generator
    ) -> None:
        self.domain, self.soft, self.temperature, self.most, self.draws = domain, soft, temperature, situations, draws
        self.ways = ways(domain.tables)
        self.expanded = self.thinned = 0

    def run(self, horizon: int) -> Smooth:
        """To the horizon, or until no situation is left."""
        key, mass = self._begin()
        rewards = np.zeros((horizon, mass.shape[1]))
        for step in range(horizon):
            if not len(key):
                break
            key, mass = self._step(key, mass, rewards[step])
            if len(key) > self.most:
                key, mass = thin(key, mass, self.most, self.draws.random())
                self.thinned += 1
        total, discounted = rewards.sum(axis=0), self.domain.discount ** np.arange(horizon) @ rewards
        return Smooth(
            float(total[0]), total[1:], float(discounted[0]), discounted[1:], self.expanded, self.thinned
        )  # fmt: skip

    def _begin(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        layer = first_layer(self.domain)
        alive = ~self.domain.tables.terminal[layer.key[:, 0] // SEEN]
        key = layer.key[alive]
        self.prior = key[0, 1:].copy().view(np.float64)
        mass = np.zeros((len(key), 1 + self.soft.constants))
        mass[:, 0] = layer.mass[alive]
        return np.hstack([np.tile(self.soft.memory, (len(key), 1)), key]), mass

    def _step(
        self, key: NDArray[np.int64], mass: NDArray[np.float64], paid: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The situations after a step; ``paid`` (1 + d,) takes its expected reward."""
        parts = [together(*self._expanded(key[i], mass[i], paid)) for i in self._chunks(len(key))]
        keys, masses = zip(*parts, strict=True)
        return together(np.concatenate(keys), np.concatenate(masses)) if len(parts) > 1 else parts[0]

    def _chunks(self, count: int) -> Iterator[slice]:
        size = max(1, _ROWS // self.soft.most)
        return (slice(i, i + size) for i in range(0, count, size))

    def _expanded(
        self, key: NDArray[np.int64], mass: NDArray[np.float64], paid: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Expansion is linear in the masses: it is done for masses of 1, and duals multiply what comes out."""
        rows, count = self.soft.act(key, mass, self.temperature)
        rows = written(rows, count)
        told = np.hstack([rows.memory, key[rows.source, rows.memory.shape[1] :]])
        told, weight, origin = disclose(
            told, rows.mass, self.soft.watched(rows), self.prior, self.domain.factor_offset
        )  # fmt: skip
        actions = rows.action[origin]
        self.expanded += len(told)
        seen = told[:, -1 - self.domain.n_marginals]
        needed = int(self.ways[seen // SEEN * self.domain.n_actions + actions].sum()) + 1
        after, chance = np.empty((needed, told.shape[1]), dtype=np.int64), np.empty(needed)
        parents, rewards, ended = np.empty(needed, dtype=np.int64), np.empty(len(told)), np.empty(len(told))
        n = expand(self.domain.tables, told, np.ones(len(told)), actions, after, chance, parents, rewards, ended)
        paid += rewards @ weight
        return after[:n], weight[parents[:n]] * chance[:n, None]
