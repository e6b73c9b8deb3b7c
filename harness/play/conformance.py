"""The public conformance check: is a domain well formed, and does an engine step it by the contract?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from harness import engine as engines
from harness import registry
from harness.engine.batch import Batch
from harness.errors import HarnessError, printable
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON, simulate
from harness.policy.simple import RandomPolicy

_TOLERANCE = 1e-9


class ConformanceError(HarnessError):
    """A domain or an engine breaks the contract; the message lists every breach found."""

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
    breaches = list(_check_tables(domain))
    if not breaches:  # an engine on broken tables would only fail in stranger ways
        breaches = list(_check_engine(domain, engines.choose(engine, domain), episodes, seed))
    if breaches:
        raise ConformanceError(f"{domain.name} breaks the contract: " + "; ".join(dict.fromkeys(breaches)))


def _exported(d: Domain) -> SimpleNamespace:
    return SimpleNamespace(**d.arrays)


def _check_tables(d: Domain) -> Iterator[str]:
    t = _exported(d)
    rows, outcomes = len(t.legal), len(t.outcome_visible)
    if not 0 < d.discount <= 1:
        yield f"the discount {d.discount} is not in (0, 1]"
    for what, names in (
        ("action", d.actions),
        ("observation", d.observations),
        ("feature", [f[0] for f in d.features]),
    ):
        if len(set(names)) != len(names):
            yield f"two {what}s share a name"
    if len(t.first_row) != d.n_visible * d.n_actions or len(t.terminal) != d.n_visible:
        yield "first_row, factor or terminal do not have one entry a visible value (and action)"
        return
    if (np.diff(t.row_outcomes) < 1).any() or t.row_outcomes[-1] != outcomes or len(t.row_outcomes) != rows + 1:
        yield "a row has no outcome, or row_outcomes does not end at the last outcome"
        return
    yield from _check_ranges(d)
    yield from _check_probabilities(d)
    if (t.first_row.reshape(d.n_visible, -1)[t.terminal] != -1).any():
        yield "a terminal visible value has rows"
    if not np.isfinite(d.arrays["outcome_reward"]).all():
        yield "a reward is not a finite number"
    for v in np.flatnonzero(~t.terminal):
        first = t.first_row[v * d.n_actions : (v + 1) * d.n_actions]
        if not t.legal[first].any():
            yield f"no action is legal at visible value {v}"
            return


def _check_ranges(d: Domain) -> Iterator[str]:
    t = _exported(d)
    sizes = np.array([*d.factor_sizes, 1])  # the last entry serves factor −1: one row
    live = np.repeat(~t.terminal, d.n_actions)
    ends = t.first_row[live] + sizes[t.factor[live]]
    if (t.first_row[live] < 0).any() or (ends > len(t.legal)).any():
        yield "first_row points outside the rows"
    bounds = (
        ("outcome_visible", 0, d.n_visible),
        ("outcome_value", 0, int(sizes.max())),
        ("outcome_observation", 0, len(t.observation_probability)),
        ("factor", -1, len(d.factors)),
        ("start_visible", 0, d.n_visible),
        ("start_observation", -1, len(t.observation_probability)),
        ("prior_factor", -1, len(d.factors)),
    )
    for name, low, high in bounds:
        array = getattr(t, name)
        if (array < low).any() or (array >= high).any():
            yield f"{name} leaves the range {low} … {high - 1}"
    if any(not 0 <= k < len(d.factors) or not 0 <= x < d.factor_sizes[k] for _, k, x in d.features):
        yield "a feature names a factor or value that does not exist"
    if t.observation_probability.shape[1] != d.n_observations:
        yield "the observation distributions do not have one entry an observation"


def _check_probabilities(d: Domain) -> Iterator[str]:
    t = _exported(d)
    if (t.outcome_probability <= 0).any() or (t.observation_probability < 0).any():
        yield "a probability is negative, or an outcome has none"
    totals = np.add.reduceat(t.outcome_probability, t.row_outcomes[:-1])
    if not np.allclose(totals, 1, atol=_TOLERANCE):
        yield f"the outcomes of row {np.abs(totals - 1).argmax()} do not sum to 1"
    if not np.allclose(t.outcome_cdf[t.row_outcomes[1:] - 1], totals, atol=_TOLERANCE):
        yield "outcome_cdf does not end at the row's total"
    if not np.allclose(t.observation_probability.sum(axis=1), 1, atol=_TOLERANCE):
        yield "an observation distribution does not sum to 1"
    if not np.allclose(np.cumsum(t.observation_probability, axis=1), t.observation_cdf, atol=_TOLERANCE):
        yield "observation_cdf is not the running sum of observation_probability"
    if (np.diff(t.start_cdf) <= 0).any() or abs(t.start_cdf[-1] - 1) > _TOLERANCE:
        yield "start_cdf does not rise to 1"
    for k in range(len(d.factors)):
        prior = t.prior_marginals[:, d.factor_offset[k] : d.factor_offset[k + 1]]
        if (prior < 0).any() or not np.allclose(prior.sum(axis=1), 1, atol=_TOLERANCE):
            yield f"the prior of {d.factors[k]} is not a distribution"
    if set(t.start_visible) != set(t.prior_visible):
        yield "start_visible and prior_visible differ"


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
    t = _exported(d)
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
            expected = _predicted(d, before, record.actions, alive)
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


def _predicted(d: Domain, batch: Batch, actions: NDArray[np.int32], alive: NDArray[np.intp]) -> NDArray[np.float64]:
    """(len(alive), O) probability of each next observation under the belief before the step."""
    t = _exported(d)
    predicted = np.zeros((len(alive), d.n_observations))
    for i, e in enumerate(alive):
        va = batch.visible[e] * d.n_actions + actions[e]
        k = t.factor[va]
        weights = [1.0] if k < 0 else batch.marginals[e, d.factor_offset[k] : d.factor_offset[k + 1]]
        for x, weight in enumerate(weights):
            if weight > 0:
                row = t.first_row[va] + x
                for j in range(t.row_outcomes[row], t.row_outcomes[row + 1]):
                    predicted[i] += (
                        weight * t.outcome_probability[j] * t.observation_probability[t.outcome_observation[j]]
                    )
    return predicted
