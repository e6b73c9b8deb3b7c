"""The public conformance checks: is a domain well formed, does an engine step it by the contract, is a policy one?"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import engine as engines
from harness import host, registry
from harness import policy as policies
from harness.engine.batch import Batch
from harness.errors import HarnessError, check_whole, printable
from harness.model import validation
from harness.model.domain import Domain
from harness.model.joining import joined
from harness.model.tables import STOP
from harness.play.evaluation import HORIZON, MOST, check_played, simulate
from harness.policy import Policy
from harness.policy.base import copied
from harness.policy.simple import RandomPolicy

_TOLERANCE = 1e-9
_SEEN = 17  # bytes kept of an episode's step


class ConformanceError(HarnessError):
    """A domain, an engine or a policy breaks the contract; the message lists every breach found."""

    def __str__(self) -> str:
        """All of the list, however long."""
        return printable(self.args[0])


def check_domain(domain: Domain | str, engine: str = "auto", episodes: int = 500, seed: int = 0) -> None:
    """Check a domain's tables, then an engine against them, on random episodes.

    Of the tables: indices in range, probabilities that sum to 1, cumulative ones that match, names as many as values,
    terminal values without rows, a legal action everywhere, priors that are distributions. Of the engine: the same
    episodes whatever the batch, what happens after the end (nothing, and reward 0), beliefs that are distributions and
    never rule out what happened, rewards and observations that the tables hold possible, frequencies of initial states
    and of next observations as the tables say (within five standard errors).

    Raises:
        ConformanceError: with every breach found.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    check_played(episodes=episodes, seed=seed, horizon=HORIZON)
    check_whole("episodes", episodes, 2, MOST)  # they are played in two halves
    host.check_memory(f"{episodes:,} episodes", episodes * 2 * (HORIZON + 1) * _SEEN)
    breaches = list(validation.breaches(domain))
    if not breaches:  # an engine on broken tables would only fail in stranger ways
        breaches = list(_check_engine(domain, engines.choose(engine, domain), episodes, seed))
    if breaches:
        raise ConformanceError(f"{domain.name} breaks the contract: " + "; ".join(dict.fromkeys(breaches)))


def _exported(d: Domain) -> SimpleNamespace:
    return SimpleNamespace(**d.arrays)


def _check_engine(d: Domain, engine: str, episodes: int, seed: int) -> Iterator[str]:
    tracking = RandomPolicy()
    tracking.uses_belief = True  # random actions, but with the belief kept
    whole = _episodes(d, tracking, engine, seed, 0, episodes)
    half = episodes // 2
    for first, count in ((0, half), (half, episodes - half)):
        part = _episodes(d, tracking, engine, seed, first, count)
        if not all(np.array_equal(a[:, first : first + count], b) for a, b in zip(whole, part, strict=True)):
            yield "episodes depend on the batch that they are stepped in"
            break
    yield from _check_course(d, engine, episodes, seed, tracking)


def _episodes(
    d: Domain, policy: RandomPolicy, engine: str, seed: int, first: int, count: int
) -> list[NDArray[np.float64]]:
    """Visible values, observations, rewards and done flags, each (steps + 1, count)."""
    records = [
        (r.batch.visible.copy(), r.batch.observation.copy(), r.rewards.copy(), r.batch.done.copy())
        for r in simulate(d, policy, engine, seed, first, count, HORIZON)
    ]
    while len(records) < HORIZON + 1:  # all had ended: they stay as they are, and are paid nothing
        visible, observation, rewards, done = records[-1]
        records.append((visible, observation, np.zeros_like(rewards), done))
    return [np.array(column) for column in zip(*records, strict=True)]


def _check_course(d: Domain, engine: str, episodes: int, seed: int, policy: RandomPolicy) -> Iterator[str]:
    t, predict = _exported(d), _predictor(d)
    starts = np.zeros(d.n_visible)
    surprise: list[NDArray[np.float64]] = []
    before: Batch | None = None
    for record in simulate(d, policy, engine, seed, 0, episodes, HORIZON):
        now = record.batch
        if record.actions is None:
            np.add.at(starts, now.visible, 1)
        yield from _check_belief(d, now)
        if before is not None and record.actions is not None:
            ended = ~record.active
            if record.rewards[ended].any() or (now.visible[ended] != before.visible[ended]).any():
                yield "an episode changes or is paid after its end"
            if not np.array_equal(now.done, t.terminal[now.visible]):
                yield "done is not the same as a terminal visible value"
            alive = np.flatnonzero(record.active)
            expected = predict(before, record.actions, alive)
            seen = np.zeros_like(expected)
            known = now.observation[alive] >= 0
            seen[np.flatnonzero(known), now.observation[alive][known]] = 1
            if (expected[seen > 0] <= 0).any():
                yield "an observation came that the belief held impossible"
            surprise.append(np.stack([(seen - expected).sum(axis=0), (expected * (1 - expected)).sum(axis=0)]))
        before = _copy(now)
    expected_starts = np.bincount(t.start_visible, np.diff(t.start_cdf, prepend=0), d.n_visible) * episodes
    if (np.abs(starts - expected_starts) > 5 * np.sqrt(expected_starts) + 1e-9 * episodes).any():
        yield "initial visible values do not have their probabilities"
    difference, variance = np.sum(surprise, axis=0)
    if (np.abs(difference) > 5 * np.sqrt(variance) + 1e-6).any():
        yield "observations do not come as often as the belief and the tables predict"


def _copy(batch: Batch) -> Batch:
    return replace(
        batch,
        visible=batch.visible.copy(),
        observation=batch.observation.copy(),
        marginals=batch.marginals.copy(),
        done=batch.done.copy(),
    )


def _check_belief(d: Domain, batch: Batch) -> Iterator[str]:
    for k in range(len(d.factors)):
        factor = batch.marginals[:, d.factor_offset[k] : d.factor_offset[k + 1]]
        if (factor < 0).any() or not np.allclose(factor.sum(axis=1), 1, atol=_TOLERANCE):
            yield f"the belief over {d.factors[k]} is not a distribution"


_Predict = Callable[[Batch, NDArray[np.int32], NDArray[np.intp]], NDArray[np.float64]]


def _predictor(domain: Domain) -> _Predict:
    """What gives (len(alive), O), the probability of each next observation under the belief before the step.

    Where sensors read several factors at once, it goes by the joint value of all.
    """
    d = joined(domain)
    t = _exported(d)

    @functools.cache
    def readings(va: int) -> NDArray[np.float64]:
        """(n, O) for each value of the relevant factor."""
        k, first = t.factor[va], t.first_row[va]
        ends = t.row_outcomes[first : first + (1 if k < 0 else d.factor_sizes[k]) + 1]
        ways = slice(ends[0], ends[-1])
        weighted = t.outcome_probability[ways, None] * t.observation_probability[t.outcome_observation[ways]]
        return np.add.reduceat(weighted, ends[:-1] - ends[0], axis=0)

    def predict(batch: Batch, actions: NDArray[np.int32], alive: NDArray[np.intp]) -> NDArray[np.float64]:
        predicted = np.zeros((len(alive), d.n_observations))
        marginals = batch.joint(alive) if domain.sensors else batch.marginals[alive]
        for i, e in enumerate(alive):
            va = int(batch.visible[e]) * d.n_actions + int(actions[e])
            k = t.factor[va]
            weights = np.ones(1) if k < 0 else marginals[i, d.factor_offset[k] : d.factor_offset[k + 1]]
            predicted[i] = weights @ readings(va)
        return predicted

    return predict


class _Way(NamedTuple):
    """How episodes are cut into batches and played."""

    batch: int
    threads: int
    batches: int
    """At most so many."""

    def __str__(self) -> str:
        return f"{self.batch}" + (f" on {self.threads} threads" if self.threads > 1 else "")


_SMALL = 20  # batches: a small one takes as long as a large one
_MEND = "keep what is remembered in arrays made in reset(batch), draw by batch.uniform(), share nothing between copies"


def check_policy(
    policy: Policy | str, domain: Domain | str, episodes: int = 1000, seed: int = 0, horizon: int = HORIZON
) -> None:
    """Check that a policy acts alike however its episodes are played, so that its score is one number.

    Fresh copies of it play the same episodes all in one batch, twice, the first of them in batches of 7 and of 1,
    and all in quarters, one after the other and on four threads: every action must be the same. And an episode that
    the policy has left (by −1) must stay left. The object given stays as it is.

    Args:
        policy: any object with ``reset`` and ``act`` on batches, or a policy string.
        domain: a domain or its name.
        episodes: how many; fewer for a policy that takes long over a decision.
        seed: of the episodes.
        horizon: steps after which an episode is cut.

    Raises:
        ConformanceError: with every way of playing that gave other actions.
        PolicyError: the policy is unknown, cannot be copied, or returned something that is no action.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    name, made = policies.named(policy, domain)
    check_played(episodes=episodes, seed=seed, horizon=horizon)
    batches = episodes * 8 * (domain.n_marginals + 12)
    host.check_memory(f"{episodes:,} episodes of {horizon:,} steps", episodes * horizon * 12 + batches)
    copied(made)
    whole = _actions(domain, made, _Way(episodes, 1, 1), episodes, seed, horizon)
    left = (whole[:-1] == STOP) & (whole[1:] != STOP)
    if left.any():
        raise ConformanceError(f"{name} goes on in episode {left.any(axis=0).argmax()}, which it had left by {STOP}")
    breaches = list(_check_ways(domain, made, whole, seed))
    if breaches:
        raise ConformanceError(f"{name} acts otherwise in batches of {', '.join(breaches)}: {_MEND}")


def _check_ways(d: Domain, policy: Policy, whole: NDArray[np.int32], seed: int) -> Iterator[str]:
    horizon, episodes = whole.shape
    quarter = -(-episodes // 4)
    small = (_Way(7, 1, _SMALL), _Way(1, 1, _SMALL), _Way(7, 4, _SMALL))
    for way in (_Way(episodes, 1, 1), *small, _Way(quarter, 1, 4), _Way(quarter, 4, 4)):
        try:
            played = _actions(d, policy, way, episodes, seed, horizon)
        except Exception as error:  # whatever the policy's own code raises
            yield f"{way} (a {type(error).__name__})"
            continue
        differ = (played != whole[:, : played.shape[1]]).any(axis=0)
        if differ.any():
            yield f"{way} ({differ.sum()} of {len(differ)})"


def _actions(d: Domain, policy: Policy, way: _Way, episodes: int, seed: int, horizon: int) -> NDArray[np.int32]:
    """(horizon, E) actions in the first E episodes, as many as the way has batches for; STOP after the end."""
    firsts = range(0, episodes, way.batch)[: way.batches]
    played = np.full((horizon, min(episodes, way.batch * way.batches)), STOP, dtype=np.int32)

    def play(first: int) -> None:
        part = played[:, first : first + way.batch]
        for step, record in enumerate(simulate(d, policy, "tables", seed, first, part.shape[1], horizon)):
            if record.actions is not None:
                part[step - 1] = np.where(record.active, record.actions, STOP)

    with ThreadPoolExecutor(way.threads) as pool:
        list(pool.map(play, firsts))
    return played
