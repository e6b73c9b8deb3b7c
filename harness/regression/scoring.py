"""Playing a row's episodes, and what its stored score can be."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import engine as engines
from harness import policy as policies
from harness import registry
from harness.errors import HarnessError
from harness.expectation.acting import NotExact
from harness.model import archive
from harness.model.domain import Domain
from harness.play.evaluation import Evaluation, evaluate, mean_and_sem
from harness.policy import Policy
from harness.regression import computing
from harness.regression.rows import AnyScore, Limits, Row, StoredExact, StoredScore
from harness.regression.statistics import episodes_needed
from harness.score.table import EXACT

PLANNED_FAMILY = 100
"""Stored scores get episodes enough for a list of so many rows, so that a new row leaves those of the others alone."""

FIGURES = ("reference_episodes", "mean", "sem", "discounted_mean", "discounted_sem", "steps_mean", "success_rate")
"""What a stored score says of its episodes."""

_LAST_BITS = 1e-9  # NumPy's sums differ between its releases


@dataclass(frozen=True)
class Task:
    """A row with what it names, loaded."""

    row: Row
    domain: Domain
    policy: Policy


@dataclass(frozen=True)
class Measurement:
    """What playing a row gave, before it is judged."""

    row: Row
    stored: AnyScore | None
    fresh: AnyScore | None = None
    """The score of now; None where it could not be compared with the stored one."""
    equal: bool | None = None
    """Whether every episode, or the computed return, came out as stored; None where other episodes were played."""
    fault: tuple[str, str] | None = None
    """Verdict and reason, where there is nothing to compare."""
    seconds: float = 0.0


def task(row: Row, allow_code: bool = False) -> Task:
    """Load what a row names; files only with ``allow_code``.

    Raises:
        HarnessError: the domain, the policy or the engine is unknown or cannot be used.
    """
    domain = registry.load_from_data(row.domain, allow_code).shaped("none")
    policy = policies.make_from_data(row.policy, domain, allow_code)[1]
    if row.how != EXACT:
        row = dataclasses.replace(row, engine=engines.choose(row.engine, domain))
    return Task(row, domain, policy)


def measure(task: Task, stored: AnyScore | None) -> Measurement:
    """Play a row for a comparison with its stored score, or compute it.

    As many episodes as the stored score rests on: its figures must be theirs where they are the same episodes and come
    out the same, and equal numbers on both sides are what the test's error rate relies on.
    """
    row, began = task.row, time.perf_counter()
    if stored is None:
        return Measurement(row, None, fault=("unscored", "no score is stored for it; run harness check --update"))
    if reason := _incomparable(task.domain, stored):
        return Measurement(row, stored, fault=("incomparable", reason))
    if reason := _impossible(task.domain, stored):
        return Measurement(row, stored, fault=("damaged", reason))
    if isinstance(stored, StoredExact):
        return _computed(task, stored)
    fresh = _record(task, _play(task, stored.reference_episodes))
    seconds = time.perf_counter() - began
    if not np.isfinite([fresh.mean, fresh.sem]).all():
        return Measurement(row, stored, fault=("damaged", f"its mean return is now {fresh.mean}"), seconds=seconds)
    same_episodes = _same_episodes(row, stored)
    if not same_episodes or fresh.digest != stored.digest:
        return Measurement(row, stored, fresh, False if same_episodes else None, seconds=seconds)
    if reason := _other_figure(stored, fresh):
        return Measurement(row, stored, fault=("damaged", reason), seconds=seconds)
    return Measurement(row, stored, stored, True, seconds=seconds)


def _computed(task: Task, stored: StoredExact) -> Measurement:
    row, began = task.row, time.perf_counter()
    try:
        fresh, rounding = computing.compute(row, task.domain, task.policy)
    except NotExact as error:
        return Measurement(row, stored, fault=("incomparable", str(error)))
    same = computing.equal(stored, fresh, rounding)
    return Measurement(row, stored, stored if same else fresh, same, seconds=time.perf_counter() - began)


def renew(task: Task, stored: AnyScore | None, limits: Limits) -> AnyScore:
    """The score to store for a row: the stored one itself where every episode still comes out as stored.

    As many episodes as catch a drop of ``limits.drop``, but no fewer than the row's, and at most its ``most``.

    Raises:
        HarnessError: the mean return is no finite number.
    """
    row = task.row
    if row.how == EXACT:
        return _renew_exact(task, stored)
    first = _play(task, row.episodes)
    count = _planned(row, first, limits)
    score = _record(task, first if count == row.episodes else _play(task, count))
    if not np.isfinite(score.mean):
        raise HarnessError(f"{row.policy} on {row.domain} has the mean return {score.mean}, which cannot be stored")
    return stored if isinstance(stored, StoredScore) and _holds(task, stored, score) else score


def _renew_exact(task: Task, stored: AnyScore | None) -> StoredExact:
    try:
        fresh, rounding = computing.compute(task.row, task.domain, task.policy)
    except NotExact as error:
        raise HarnessError(f"{task.row.policy} on {task.row.domain}: {error}") from None
    if isinstance(stored, StoredExact) and not _incomparable(task.domain, stored):
        return stored if computing.equal(stored, fresh, rounding) else fresh
    return fresh


def _planned(row: Row, first: Evaluation, limits: Limits) -> int:
    deviation = float(first.returns.std(ddof=1))
    if not np.isfinite(deviation):
        return row.episodes
    needed = episodes_needed(deviation, PLANNED_FAMILY, **dataclasses.asdict(limits))
    return min(max(needed, row.episodes), row.most)


def _holds(task: Task, stored: StoredScore, score: StoredScore) -> bool:
    """Whether a stored score is a new one but for the engine, and for what NumPy's releases add up differently."""
    comparable = not _incomparable(task.domain, stored) and _same_episodes(task.row, stored)
    return comparable and score.digest == stored.digest and not _other_figure(stored, score)


def _other_figure(stored: StoredScore, fresh: StoredScore) -> str:
    """Which figure of a stored score is not that of its own episodes; empty where all are."""
    for name in FIGURES:
        old, new = getattr(stored, name), getattr(fresh, name)
        if not math.isclose(old, new, rel_tol=_LAST_BITS, abs_tol=_LAST_BITS):
            return f"its stored {name} is {old:g}, but the stored episodes give {new:g}; run harness check --update"
    return ""


def _impossible(domain: Domain, stored: AnyScore) -> str:
    """What no score on the domain can be; empty where all can.

    A return lies between ``horizon`` times the least and the greatest reward, 0 included (an ended episode pays
    nothing), and numbers in an interval of width w have a standard deviation of at most w/2 (Popoviciu).
    """
    rewards = domain.arrays["outcome_reward"][0]  # the true one
    least, most = (stored.horizon * x for x in (min(0.0, float(rewards.min())), max(0.0, float(rewards.max()))))
    bounds = {
        "mean": (least, most),
        "discounted_mean": (least, most),
        "steps_mean": (0.0, stored.horizon),
        "success_rate": (0.0, 1.0 + _LAST_BITS),
    }
    if isinstance(stored, StoredScore):
        widest = (most - least) / 2 / math.sqrt(stored.reference_episodes - 1) * (1 + _LAST_BITS)
        bounds |= {"sem": (0.0, widest), "discounted_sem": (0.0, widest)}
    for name, (low, high) in bounds.items():
        value = getattr(stored, name)
        if not low <= value <= high:
            return (
                f"its stored {name} is {value:g}, and none is below {low:g} or above {high:g} there; "
                "run harness check --update"
            )
    return ""


def _same_episodes(row: Row, stored: StoredScore) -> bool:
    return (row.seed, row.episodes) == (stored.seed, stored.episodes)


def _incomparable(domain: Domain, stored: AnyScore) -> str:
    """Why scores on the domain as it is now cannot be compared with the stored one; empty where they can."""
    mend = "scores on the two are not comparable; run harness check --update"
    if domain.version != stored.domain_version:
        return (
            f"the domain is version {domain.version}, the score was stored on version {stored.domain_version}: {mend}"
        )
    if domain.model_hash != stored.model_hash:
        return (
            f"the domain's model is {domain.model_hash[:12]}, the score was stored on {stored.model_hash[:12]}: {mend}"
        )
    return ""


def _play(task: Task, episodes: int) -> Evaluation:
    row = task.row
    return evaluate(task.domain, task.policy, episodes=episodes, seed=row.seed, horizon=row.horizon, engine=row.engine)


def _record(task: Task, result: Evaluation) -> StoredScore:
    row, domain = task.row, task.domain
    mean, sem = mean_and_sem(result.returns)
    discounted_mean, discounted_sem = mean_and_sem(result.discounted)
    return StoredScore(
        domain=row.domain,
        policy=row.policy,
        horizon=row.horizon,
        domain_version=domain.version,
        model_hash=domain.model_hash,
        engine=result.engine,
        seed=row.seed,
        episodes=row.episodes,
        digest=_digest(result, row.episodes),
        reference_episodes=len(result.returns),
        mean=mean,
        sem=sem,
        discounted_mean=discounted_mean,
        discounted_sem=discounted_sem,
        steps_mean=float(result.steps.mean()),
        success_rate=float(result.terminated.mean()),
    )


def _digest(result: Evaluation, episodes: int) -> str:
    """SHA-256 of the first episodes, value by value (−0 is 0)."""
    arrays: dict[str, NDArray[Any]] = {
        "returns": result.returns[:episodes] + 0.0,
        "discounted": result.discounted[:episodes] + 0.0,
        "steps": result.steps[:episodes],
        "terminated": result.terminated[:episodes],
    }
    return archive.digest(arrays, None)
