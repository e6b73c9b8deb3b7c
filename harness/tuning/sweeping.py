"""The return over one number of a policy (the paper's Figure 5)."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness import engine as engines
from harness import host, locking, registry
from harness import policy as policies
from harness.errors import HarnessError, quoted
from harness.model.domain import Domain
from harness.play import executor
from harness.play.evaluation import EPISODES, HORIZON, Score
from harness.progress import Bar, Progress
from harness.tuning import budgets, journal
from harness.tuning.method import MOST_EPISODES, MOST_STEPS, check_number
from harness.tuning.objective import Episodes
from harness.tuning.outcome import brief
from harness.tuning.rows import SWEEP, Rows
from harness.tuning.tunable import Tunable, Vector, index_of, tunable

POINTS = 51
_A_DECADE = 3
MOST_POINTS = 10_000
"""The most values of a sweep."""

_DECIMALS = 10  # so that a grid of hundredths has the numbers that people write: 0.84, not 0.8400000000000001


@locking.alone
def sweep(
    domain: Domain | str,
    policy: str | Tunable,
    values: Sequence[float] | None = None,
    *,
    parameter: str | None = None,
    start: float | None = None,
    stop: float | None = None,
    points: int | None = None,
    log: bool = False,
    episodes: int | None = None,
    seed: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    workers: int | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    progress: Progress = False,
) -> pd.DataFrame:
    """Score a policy at many values of one of its numbers, on the same random numbers throughout.

    Args:
        domain: a domain or its name. Scores are of the true reward, whatever the domain's shaping.
        policy: a policy string such as ``belief``, or an object of the Tunable protocol; a planner is swept over
            its budget (``pomcp``: simulations; ``despot``: scenarios or trials), and its rows say the ``milliseconds``
            an action.
        values: of the number; by default ``points`` equal steps from ``start`` to ``stop``.
        parameter: which number; may be left out where there is only one.
        start: first value (default: the number's lower bound).
        stop: last value (default: its upper bound).
        points: how many values, both ends included; by default 51, and three a decade where the steps are of ratio.
        log: steps of equal ratio.
        episodes: at each value; by default 10,000, and 100 of a planner.
        seed: all values meet the same initial states and the same random numbers.
        horizon: steps after which an episode is truncated.
        engine: ``tables``, ``julia`` or ``auto``.
        workers: threads of the tables engine.
        out: a folder for ``sweep.json`` and ``sweep.csv``, which has every row as soon as it is known.
        resume: go on with the sweep in ``out``, which must have been started with these same arguments.
        progress: True for a bar on a terminal, or a function that is called with the number of points finished since
            its last call.

    Returns:
        One row a value: ``policy`` (its string), the number under its own name, and the fields of a Score. Each row is
        what :func:`harness.evaluate` gives for that policy and seed.

    Raises:
        HarnessError: an argument is wrong, or the folder holds another sweep or a damaged one; nothing is run before
            all has been checked.
    """
    domain = (registry.load(domain) if isinstance(domain, str) else domain).shaped("none")
    engine = engines.choose(engine, domain)
    planner = budgets.of_planner(policy, domain)
    subject: Tunable = tunable(policy, domain) if planner is None else planner
    k = index_of(subject, parameter)
    values = _values(subject, k, values, start, stop, points, log)
    if episodes is None:
        episodes = EPISODES if planner is None else planner.max_episodes
    check_number("episodes", episodes, True, 1, MOST_EPISODES)
    check_number("horizon", horizon, True, 1, MOST_STEPS)
    check_number("seed", seed, True, 0, 2**64 - 1)
    if resume and out is None:
        raise HarnessError("resume needs the folder of the sweep: out")
    parameters = {
        "domain": domain.name,
        "policy": subject.text(subject.start),
        "parameter": subject.names[k],
        "values": values,
        "episodes": episodes,
        "seed": seed,
        "horizon": horizon,
        "model_hash": domain.model_hash,
    }
    config = {"run": parameters, "versions": host.versions("numpy", "numba"), "engine": engine}
    timed = () if planner is None else (budgets.COLUMN,)
    kept = Rows(subject.names[k], None if out is None else Path(out), timed)
    kept.begin(config, resume)
    thetas = [_with(subject.start, k, x) for x in values]
    known = sum(
        kept.has(i, subject.text(theta), x, episodes) for i, (theta, x) in enumerate(zip(thetas, values, strict=True))
    )
    played = Episodes(domain, subject, seed, horizon, "return", engine, workers, range=0)
    away = executor.current() if engine == "tables" else None
    at = _score if planner is None else _timed
    scores = executor.ordered(away, at, thetas[known:], played, episodes, name=lambda theta: brief(subject.text(theta)))
    with Bar(progress, len(values), desc=f"sweep of {subject.names[k]}", unit="point") as bar:
        bar.update(known)
        for theta, x, (score, more) in zip(thetas[known:], values[known:], scores, strict=True):
            kept.add(subject.text(theta), x, score, *more)
            bar.update()
    return kept.table()


def resume(
    folder: str | Path, domain: Domain | str | None = None, policy: str | Tunable | None = None, **execution: Any
) -> pd.DataFrame:
    """Go on with the sweep in a folder, with the parameters that it was started with.

    Args:
        folder: of the sweep.
        domain: needed where the sweep was of a domain of one's own; otherwise its name is in the folder.
        policy: needed likewise where the sweep was of an object or of one named by its path.
        execution: ``engine``, ``workers`` and ``progress`` of :func:`sweep`, which change no number.

    Raises:
        HarnessError: there is no sweep, it is damaged, of another version of the domain, or of another policy.
    """
    stored = journal.read_parameters(Path(folder), SWEEP)
    stored.pop("model_hash")
    named = stored.pop("domain")
    if policy is None:
        policies.check_from_data(stored["policy"])
    else:
        stored["policy"] = policy
    loaded = registry.load_from_data(named) if domain is None else domain
    return sweep(loaded, **stored, out=folder, resume=True, **execution)


def _with(theta: Vector, k: int, x: float) -> Vector:
    changed = theta.copy()
    changed[k] = x
    return changed


def _score(played: Episodes, episodes: int, theta: Vector) -> tuple[Score, list[float]]:
    """The score at a point, and no further cells."""
    return played.play(theta, episodes, played.seed).score, []


def _timed(played: Episodes, episodes: int, theta: Vector) -> tuple[Score, list[float]]:
    """The same of a planner, and the milliseconds that an action took."""
    played.play(played.subject.lower, 1, played.seed)  # what compiles at its first use is none of the first row's time
    begun = time.process_time()
    result = played.play(theta, episodes, played.seed)
    return result.score, [budgets.milliseconds(time.process_time() - begun, result)]


def _values(
    subject: Tunable,
    k: int,
    values: Sequence[float] | None,
    start: float | None,
    stop: float | None,
    points: int | None,
    log: bool,
) -> list[float]:
    """The values of number ``k`` as given or evenly spaced, checked."""
    low, high = float(subject.lower[k]), float(subject.upper[k])
    if values is None:
        ends = low if start is None else _number("start", start), high if stop is None else _number("stop", stop)
        _check_range(subject.names[k], ends, low, high)
        values = _grid(*ends, points, log)
        if isinstance(subject, budgets.Budgeted):  # whole ones, each once
            values = sorted({float(round(x)) for x in values})
    if not 0 < len(values) <= MOST_POINTS:
        raise HarnessError(f"a sweep needs values, {MOST_POINTS:,} at most, not {len(values):,}")
    values = [_number("a value of a sweep", x) for x in values]
    _check_range(subject.names[k], values, low, high)
    return values


def _check_range(name: str, values: Sequence[float], low: float, high: float) -> None:
    if wrong := [x for x in values if not low <= x <= high]:
        raise HarnessError(f"{name} lies between {low:g} and {high:g}; {wrong[0]:g} is out of range")


def _number(name: str, x: float) -> float:
    try:
        return float(x)
    except (TypeError, ValueError, OverflowError):
        raise HarnessError(f"{name} must be a number, not {quoted(x)}") from None


def _grid(start: float, stop: float, points: int | None, log: bool) -> list[float]:
    if not start < stop:
        raise HarnessError(f"a sweep goes upward: from {start:g} to {stop:g} there is nothing")
    if log and start <= 0:
        raise HarnessError(f"steps of equal ratio begin above 0, not at {start:g}; say where (--from)")
    if points is None:
        points = max(2, 1 + round(_A_DECADE * math.log10(stop / start))) if log else POINTS
    if not 2 <= points <= MOST_POINTS:
        raise HarnessError(f"a sweep has 2 points or more, {MOST_POINTS:,} at most, not {quoted(points)}")
    spaced = np.geomspace if log else np.linspace
    return [round(float(x), _DECIMALS) for x in spaced(start, stop, points)]
