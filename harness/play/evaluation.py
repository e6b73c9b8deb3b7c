"""Policy × domain × engine × seed → returns, and the score with its uncertainty."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import cards, host, registry
from harness import engine as engines
from harness import policy as policies
from harness.engine import Engine, rng
from harness.engine.batch import Batch, read_only
from harness.errors import check_whole
from harness.model.domain import Domain
from harness.model.tables import STOP, compiled
from harness.play import executor
from harness.play.executor import Workers
from harness.policy import Policy
from harness.policy.base import can_be_copied, checked, fresh, whole
from harness.progress import Bar, Progress

HORIZON = 50
"""Steps after which an episode is truncated (paper, Table 2)."""
MOST = 100_000_000
"""Episodes of one evaluation, and steps of an episode, at most."""
KEPT = 21
"""Bytes that an evaluation keeps of each episode."""
_LAST = 2**62  # number of an episode
_COLUMNS = 12  # numbers of 8 bytes that a batch takes for each episode, besides the belief

EPISODES = 10_000
Z95 = 1.959963984540054
"""Standard normal quantile of a two-sided 95 % interval."""

# How many threads there are must not decide the batches: then no policy's score can depend on it.
_BATCHES = 16
_LEAST, _BATCH = 2_500, 32_768  # episodes a batch: a step costs some time whatever its size, and memory an episode
_JULIA_BATCH = 131_072  # one call into Julia a step, its threads inside


class Score(NamedTuple):
    """Mean return of a policy with its uncertainty, from independent episodes."""

    episodes: int
    mean: float
    """Mean undiscounted return within the horizon."""
    sem: float
    """Its standard error."""
    ci_low: float
    ci_high: float
    """95 % interval of the mean (normal)."""
    discounted_mean: float
    discounted_sem: float
    steps_mean: float
    """Mean number of steps until the end or the horizon."""
    success_rate: float
    """Share of episodes that reached a terminal state (RockSample: left; BorderCross: crossed)."""


@dataclass(frozen=True)
class Evaluation:
    """All episodes of one evaluation; every array has one entry an episode, in order."""

    domain: Domain
    policy: str
    engine: str
    seed: int
    horizon: int
    returns: NDArray[np.float64]
    """Undiscounted."""
    discounted: NDArray[np.float64]
    steps: NDArray[np.int32]
    terminated: NDArray[np.bool_]
    """Whether a terminal state was reached within the horizon (otherwise the episode was truncated)."""

    @property
    def score(self) -> Score:
        """Means and standard errors."""
        mean, sem = mean_and_sem(self.returns)
        discounted_mean, discounted_sem = mean_and_sem(self.discounted)
        return Score(
            len(self.returns),
            mean,
            sem,
            mean - Z95 * sem,
            mean + Z95 * sem,
            discounted_mean,
            discounted_sem,
            float(self.steps.mean()),
            float(self.terminated.mean()),
        )

    def __repr__(self) -> str:
        """The score and what it is of, on one line."""
        return cards.line("Evaluation", f"{self.policy} on {self.domain.name}", _facts(self))

    def _repr_html_(self) -> str:
        return cards.card("Evaluation", f"{self.policy} on {self.domain.name}", _facts(self))


def _facts(result: Evaluation) -> dict[str, object]:
    score = result.score
    return {
        "return": cards.plus_minus(score.mean, score.sem),
        "discounted": cards.plus_minus(score.discounted_mean, score.discounted_sem),
        "success": f"{score.success_rate:.1%}",
        "episodes": f"{score.episodes:,}",
        "seed": result.seed,
        "horizon": result.horizon,
        "engine": result.engine,
    }


def mean_and_sem(values: NDArray[np.float64]) -> tuple[float, float]:
    """Mean and its standard error; both exact where all values are equal. One value says nothing of its error: NaN."""
    if len(values) == 1:
        return float(values[0]), math.nan
    if values.min() == values.max():
        return float(values[0]), 0.0
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


class StepRecord(NamedTuple):
    """What happened in one step of a batch, for replays and for tests. Arrays have one entry an episode."""

    batch: Batch
    """After the step; before the first one for the reset."""
    actions: NDArray[np.int32] | None
    """None for the reset."""
    rewards: NDArray[np.float64]
    active: NDArray[np.bool_]
    """Episodes that took part in the step: not ended before it, and not stopped by their policy."""


def simulate(
    domain: Domain, policy: Policy, engine: str, seed: int, first: int, count: int, horizon: int
) -> Iterator[StepRecord]:
    """Step episodes ``first … first + count − 1`` together; yields the reset and then every step.

    ``engine`` is ``tables`` or ``julia``. A fresh copy of the policy plays.
    The arrays of a record are overwritten by the next step.
    """
    policies.check_engine(policy, engine)
    policy = fresh(policy)
    stepper = engines.make(engine, domain, count, getattr(policy, "uses_belief", True))
    batch = _view(stepper, seed, first)
    stepper.reset(rng.uniforms(seed, rng.ENGINE, 0, first, count))
    policy.reset(batch)
    yield StepRecord(batch, None, np.zeros(count), np.ones(count, dtype=np.bool_))
    for step in range(1, horizon + 1):
        if stepper.done.all():
            return
        actions = checked(policy.act(batch), batch)
        active = ~stepper.done & (actions != STOP)
        if not active.any():
            return
        rewards = stepper.step(actions, rng.uniforms(seed, rng.ENGINE, step, first, count))
        batch.step = step
        yield StepRecord(batch, actions, rewards, active)


def _view(stepper: Engine, seed: int, first: int) -> Batch:
    return Batch(
        stepper.domain,
        read_only(stepper.visible),
        read_only(stepper.observation),
        read_only(stepper.marginals),
        read_only(stepper.done),
        seed=seed,
        first=first,
    )


def evaluate(
    domain: Domain | str,
    policy: Policy | str,
    *,
    episodes: int = EPISODES,
    seed: int = 0,
    first: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    workers: int | None = None,
    progress: Progress = False,
) -> Evaluation:
    """Score a policy on a domain.

    Args:
        domain: a domain or its name.
        policy: a policy string such as ``belief:0.84``, or any object with ``reset`` and ``act`` on batches.
        episodes: how many; episode k of a seed is the same whatever their number.
        seed: of the episodes.
        first: number of the first episode; the episodes are ``first … first + episodes − 1`` of the seed.
        horizon: steps after which an episode is truncated.
        engine: ``tables``, ``julia`` or ``auto``.
        workers: threads of the tables engine (default: one a core). The numbers do not depend on it. A policy that
            cannot be copied plays in one, and a warning says so.
        progress: True for a bar on a terminal, or a function that is called with the number of episodes finished since
            its last call.

    Raises:
        HarnessError: an argument is wrong (the message says which and how to mend it).
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    check_played(episodes=episodes, seed=seed, first=first, horizon=horizon)
    threads = executor.threads(workers)
    engine = engines.choose(engine, domain)
    policies.check_engine(policy, engine)
    spec, made = policies.named(policy, domain)
    threads = 1 if engine == "julia" or not can_be_copied(made) else threads
    size = _batch_size(made, engine, episodes)
    batches = min(threads * size, episodes) * 8 * (domain.n_marginals + _COLUMNS)
    host.check_memory(f"{episodes:,} episodes", episodes * KEPT * 2 + batches)
    chunks = [(first + done, min(size, episodes - done)) for done in range(0, episodes, size)]
    away = executor.current() if engine == "tables" and can_be_copied(made) else None
    game = _Game(domain, made, engine, seed, horizon)
    with Bar(progress, episodes, desc=spec, unit="episode", delay=2) as bar:
        if away is None:
            parts = _here(game, chunks, threads, bar)
        else:
            parts = _away(away, game, f"of {spec} on {domain.name}", chunks, bar)
    totals = _Totals(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    return Evaluation(domain, spec, engine, seed, horizon, *totals)


class _Game(NamedTuple):
    """What all batches of an evaluation share."""

    domain: Domain
    policy: Policy
    engine: str
    seed: int
    horizon: int


def _here(game: _Game, chunks: list[tuple[int, int]], threads: int, bar: Bar) -> list[_Totals]:
    """All batches, on the threads of this process."""
    stop = threading.Event()
    return _map(lambda chunk: _batch(game, chunk, stop), chunks, threads, bar.update, stop)


def _away(workers: Workers, game: _Game, what: str, chunks: list[tuple[int, int]], bar: Bar) -> list[_Totals]:
    """The same on the workers of :func:`harness.cluster`."""
    found: dict[tuple[int, int], _Totals] = {}
    played = executor.each(workers, _batch, chunks, game, name=lambda chunk: f"episodes from {chunk[0]:,} on {what}")
    for chunk, part in played:
        found[chunk] = part
        bar.update(chunk[1])
    return [found[chunk] for chunk in chunks]


def _batch(game: _Game, chunk: tuple[int, int], stop: threading.Event | None = None) -> _Totals:
    """The episodes (first, count); those until ``stop`` is set."""
    records = simulate(game.domain, game.policy, game.engine, game.seed, *chunk, game.horizon)
    going_on = itertools.takewhile(lambda _: stop is None or not stop.is_set(), records)
    return _totals(going_on, chunk[1], game.domain.discount)


def _batch_size(policy: Policy, engine: str, episodes: int) -> int:
    most = whole(policy, "batch_size", _JULIA_BATCH if engine == "julia" else _BATCH)
    return most if engine == "julia" else min(most, max(_LEAST, -(-episodes // _BATCHES)))


def check_played(
    *, seed: int, horizon: int, episodes: int | None = None, first: int | None = None, episode: int | None = None
) -> None:
    """Check which episodes are to be played; those that are None were not asked for.

    Raises:
        HarnessError: a number is none, or out of range.
    """
    check_whole("seed", seed, 0, 2**64 - 1)
    for name, value, low, high in (
        ("horizon", horizon, 1, MOST),
        ("episodes", episodes, 1, MOST),
        ("first", first, 0, _LAST),
        ("episode", episode, 0, _LAST),
    ):
        if value is not None:
            check_whole(name, value, low, high)


class _Totals(NamedTuple):
    returns: NDArray[np.float64]
    discounted: NDArray[np.float64]
    steps: NDArray[np.int32]
    terminated: NDArray[np.bool_]


def _totals(records: Iterable[StepRecord], count: int, discount: float) -> _Totals:
    totals = _Totals(np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.bool_))
    weight = 1.0
    for record in records:
        if record.actions is not None:
            _add(totals.returns, totals.discounted, totals.steps, record.rewards, record.active, weight)
            weight *= discount
        totals.terminated[:] = record.batch.done
    return totals


@compiled
def _add(
    returns: NDArray[np.float64],
    discounted: NDArray[np.float64],
    steps: NDArray[np.int32],
    rewards: NDArray[np.float64],
    active: NDArray[np.bool_],
    weight: float,
) -> None:
    for e in range(len(returns)):
        if active[e]:
            returns[e] += rewards[e]
            discounted[e] += weight * rewards[e]
            steps[e] += 1


def _map(
    run: Callable[[tuple[int, int]], _Totals],
    chunks: list[tuple[int, int]],
    threads: int,
    progress: Callable[[int], object],
    stop: threading.Event,
) -> list[_Totals]:
    """Results of the chunks in order. Ctrl-C sets ``stop``, which ends the chunks under way at their next step."""
    if threads == 1:
        results = []
        for chunk in chunks:
            results.append(run(chunk))
            progress(chunk[1])
        return results
    pool = ThreadPoolExecutor(threads)
    futures: dict[Future[_Totals], tuple[int, int]] = {}
    try:  # from the first chunk on: Ctrl-C may come while others are not under way yet
        futures |= {pool.submit(run, chunk): chunk for chunk in chunks}
        pending = set(futures)
        while pending:
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in finished:
                future.result()
                progress(futures[future][1])
    except BaseException:
        stop.set()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
    return [future.result() for future in futures]
