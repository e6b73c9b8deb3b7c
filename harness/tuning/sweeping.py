"""The return over one number of a policy (the paper's Figure 5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from harness import engine as engines
from harness import registry
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.play.evaluation import EPISODES, HORIZON, Score, evaluate
from harness.progress import Bar, Progress
from harness.tuning.tunable import Tunable, index_of, tunable

POINTS = 51
_DECIMALS = 10  # so that a grid of hundredths has the numbers that people write: 0.84, not 0.8400000000000001


def sweep(
    domain: Domain | str,
    policy: str | Tunable,
    values: Sequence[float] | None = None,
    *,
    parameter: str | None = None,
    start: float | None = None,
    stop: float | None = None,
    points: int = POINTS,
    episodes: int = EPISODES,
    seed: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    workers: int | None = None,
    progress: Progress = False,
) -> pd.DataFrame:
    """Score a policy at many values of one of its numbers, on the same random numbers throughout.

    Args:
        domain: a domain or its name. Scores are of the true reward, whatever the domain's shaping.
        policy: a policy string such as ``belief``, or an object of the Tunable protocol.
        values: of the number; by default ``points`` equal steps from ``start`` to ``stop``.
        parameter: which number; may be left out where there is only one.
        start: first value (default: the number's lower bound).
        stop: last value (default: its upper bound).
        points: how many values, both ends included.
        episodes: at each value.
        seed: all values meet the same initial states and the same random numbers.
        horizon: steps after which an episode is truncated.
        engine: ``tables``, ``julia`` or ``auto``.
        workers: threads of the tables engine.
        progress: True for a bar on a terminal, or a function that is called with the number of points finished since
            its last call.

    Returns:
        One row a value: ``policy`` (its string), the number under its own name, and the fields of a Score. Each row is
        what :func:`harness.evaluate` gives for that policy and seed.

    Raises:
        HarnessError: an argument is wrong; nothing is run before all have been checked.
    """
    domain = (registry.load(domain) if isinstance(domain, str) else domain).shaped("none")
    engine = engines.choose(engine, domain)
    subject = tunable(policy, domain)
    k = index_of(subject, parameter)
    low, high = float(subject.lower[k]), float(subject.upper[k])
    if values is None:
        values = _grid(low if start is None else start, high if stop is None else stop, points)
    if len(values) == 0:
        raise HarnessError("a sweep needs values")
    wrong = [x for x in (values[0], values[-1], *values) if not low <= x <= high]
    if wrong:  # the ends first: they are what the user gave
        raise HarnessError(f"{subject.names[k]} lies between {low:g} and {high:g}; {wrong[0]:g} is out of range")
    rows = []
    played: dict[str, Any] = {
        "episodes": episodes,
        "seed": seed,
        "horizon": horizon,
        "engine": engine,
        "workers": workers,
    }
    with Bar(progress, len(values), desc=f"sweep of {subject.names[k]}", unit="point") as bar:
        for x in values:
            theta = subject.start.copy()
            theta[k] = x
            score = evaluate(domain, subject.policy(theta), **played).score
            rows.append({"policy": subject.text(theta), subject.names[k]: float(x), **score._asdict()})
            bar.update()
    return pd.DataFrame(rows, columns=["policy", subject.names[k], *Score._fields])


def _grid(start: float, stop: float, points: int) -> list[float]:
    if points < 2:
        raise HarnessError(f"a sweep has 2 points or more, not {points}")
    if not start < stop:
        raise HarnessError(f"a sweep goes upward: from {start:g} to {stop:g} there is nothing")
    return [round(float(x), _DECIMALS) for x in np.linspace(start, stop, points)]
