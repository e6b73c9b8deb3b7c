"""Solving a domain to proven bounds, without Julia: ``harness.solve``."""

from __future__ import annotations

import math
import resource
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from numpy.typing import NDArray

from harness import cards, host, registry
from harness.errors import HarnessError, quoted
from harness.model.domain import Domain
from harness.solver import anytime, checkpoint
from harness.solver.checkpoint import Course
from harness.solver.graph import policy_arrays
from harness.solver.points import course as points
from harness.solver.search import N_NODES, TRIALS
from harness.solver.solution import KIND, Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAP = 0.01
"""Between the bounds, in units of reward, at which solving ends."""
MEMORY = 2.0
"""GB that the solver's arrays may take."""
SOLVER = "product grid and trials (harness)"
POINTS_SOLVER = "alpha vectors and sawtooth, by trials (harness)"

_LARGEST_FACTOR = 12
_SAVING = 30.0
_SHARE = 20
"""Between two writings of the state: so many seconds, and so many times what one takes, at least"""

Watch = Callable[[float, float, float], object]
"""Called with seconds, lower and upper bound, about once a second."""


@dataclass(frozen=True)
class Solved:
    """Bounds of a domain's optimal value (discounted, infinite horizon), and a policy that earns the lower one."""

    domain: Domain
    lower: float
    upper: float
    history: pd.DataFrame
    """A row about every second: ``seconds``, ``lower``, ``upper``, ``nodes``, ``trials``, ``cells`` (of the grid; where
    there is none, alpha ``vectors``), ``megabytes``."""
    solution: Solution
    """The policy as it is stored: a graph, which :class:`harness.policy.graph.PolicyGraph` plays, or alpha vectors, for
    :class:`harness.policy.alpha.AlphaVectorPolicy`."""
    stopped: str
    """Why it ended, as a sentence."""

    @property
    def gap(self) -> float:
        """Upper less lower bound."""
        return self.upper - self.lower

    def plot(self) -> Figure:
        """The bounds over the time, as a matplotlib figure."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6, 4), layout="constrained")  # inches
        axes = figure.subplots()
        for name in ("upper", "lower"):
            axes.step(self.history["seconds"], self.history[name], where="post", label=f"{name} bound")
        axes.set(xscale="log", xlabel="seconds", ylabel="discounted value at the start", title=self.domain.name)
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
        return figure

    def _facts(self) -> dict[str, object]:
        return {
            "lower": f"{self.lower:.4f}",
            "upper": f"{self.upper:.4f}",
            "seconds": f"{self.history['seconds'].iloc[-1]:.1f}",
            **_extent(self.solution),
            "stopped": self.stopped,
        }

    def __repr__(self) -> str:
        """The bounds, on one line."""
        return cards.line("Solved", self.domain.name, self._facts())

    def _repr_html_(self) -> str:
        return cards.card("Solved", self.domain.name, self._facts())


def solve(
    domain: Domain | str,
    *,
    gap: float = GAP,
    seconds: float | None = None,
    memory: float = MEMORY,
    resume: Path | str | None = None,
    watch: Watch = lambda seconds, lower, upper: None,
) -> Solved:
    """Find bounds of the value at the start (discounted, infinite horizon), and a policy that earns the lower one.

    Args:
        domain: a domain or its name; the true reward counts, whatever its shaping.
        gap: end when the bounds are this close, in units of reward.
        seconds: end after about so long; by default only the gap and the memory end it.
        memory: GB that the solver's arrays may take.
        resume: a file that keeps the state of the work: if it is there, the work goes on from it, as if it had never
            ended; it is written every half minute, and at the end.
        watch: called with seconds, lower and upper bound as the work goes on.

    Ctrl-C ends it early, at the end of the present second's work: what has been found by then is the result.

    Raises:
        HarnessError: an argument is out of range, the discount is not below 1, the memory is too little for the
            domain, or the file to resume from is damaged or of another model.

    A domain with hidden factors of at most 12 values and one way to begin is solved on the product grid, any other, and
    one whose sensors read several factors at once, point by point (:mod:`harness.solver.points`), over the joint value
    of all factors.
    """
    domain = (registry.load(domain) if isinstance(domain, str) else domain).shaped("none")
    for name, value in (("gap", gap), ("seconds", seconds), ("memory", memory)):
        if value is not None and not (isinstance(value, (int, float)) and 0 < value < float("inf")):
            raise HarnessError(f"{name} must be a number above 0, not {quoted(value)}")
    _check_solvable(domain, memory)
    started = time.monotonic()
    course, rows = _begin(domain, path := None if resume is None else Path(resume))
    begun, end = started - (rows[-1]["seconds"] if rows else 0.0), started + (seconds or math.inf)
    save_at = time.monotonic() + _SAVING
    interrupted = threading.Event()
    with host.ctrl_c_sets(interrupted):
        for latest in _blocks(course, gap, int(memory * 1e9)):
            course = latest
            rows.append(_row(course, time.monotonic() - begun))
            watch(rows[-1]["seconds"], course.lower, course.upper)
            if path and (now := time.monotonic()) > save_at:
                checkpoint.save(path, course, rows)
                save_at = time.monotonic() + max(_SAVING, _SHARE * (time.monotonic() - now))
            if interrupted.is_set() or time.monotonic() >= end:
                break
    stopped = _reason(course, gap, seconds if time.monotonic() >= end else None, interrupted.is_set())
    rows.append(_row(course, time.monotonic() - begun))
    if path:
        checkpoint.save(path, course, rows)
    solution = _solution(course, rows[-1], stopped)
    return Solved(domain, solution.record["lower"], course.upper, pd.DataFrame(rows), solution, stopped)


def _begin(domain: Domain, path: Path | None) -> tuple[Course, list[dict[str, Any]]]:
    """A course, from the file where there is one, and the rows of its history."""
    fresh: Course = points.begin(domain) if _by_points(domain) else anytime.begin(domain)
    return checkpoint.restore(path, fresh) if path and path.exists() else (fresh, [])


def _reason(course: Course, gap: float, seconds: float | None, interrupted: bool) -> str:
    if course.upper - course.lower <= gap:
        return "at the gap asked for"
    if interrupted:
        return "by Ctrl-C"
    return "where memory or rounding ends it" if seconds is None else f"after the {seconds:g} seconds asked for"


def _by_points(domain: Domain) -> bool:
    """Whether the product grid does not take it: a large factor, sensors, a start that is split by what is seen."""
    split = len(domain.arrays["prior_visible"]) > 1 or (domain.arrays["prior_factor"] >= 0).any()
    return bool(split or domain.sensors) or max(domain.factor_sizes, default=1) > _LARGEST_FACTOR


def _blocks(course: Course, gap: float, memory: int) -> Iterator[Course]:
    if isinstance(course, points.Course):
        return points.blocks(course, (1.0 - points.LEFT) * gap, memory)
    return anytime.blocks(course, gap, memory)


def _extent(solution: Solution) -> dict[str, str]:
    if solution.kind == KIND:
        return {"alpha vectors": f"{len(solution.arrays['actions']):,}"}
    return {"nodes of the policy": f"{len(solution.arrays['action']):,}"}


def _check_solvable(domain: Domain, memory: float) -> None:
    if _by_points(domain):
        least, what = points.least_memory(domain), "what it starts from"
    else:
        least, what = 4 * domain.n_visible * domain.n_joint, "the coarsest grid"  # certainty about every factor
    if least > memory * 1e9:
        raise HarnessError(
            f"{domain.name} needs {least / 1e9:,.1f} GB for {what}, more than the {memory:g} GB allowed (--memory)"
        )


def _row(course: Course, seconds: float) -> dict[str, Any]:
    return {
        "seconds": seconds,
        "lower": course.lower,
        "upper": course.upper,
        **_counts(course),
        "megabytes": course.memory / 1e6,
    }


def _counts(course: Course) -> Mapping[str, int]:
    if isinstance(course, points.Course):
        return course.facts
    counts = course.graph.counts
    return {"nodes": int(counts[N_NODES]), "trials": int(counts[TRIALS]), "cells": course.rows}


def _stored(course: Course) -> tuple[dict[str, NDArray[Any]], float]:
    """The policy's arrays, and by how much less than the course's lower bound they earn at least."""
    return points.rounded(course) if isinstance(course, points.Course) else (policy_arrays(course), 0.0)


def _solution(course: Course, last: dict[str, Any], stopped: str) -> Solution:
    arrays, less = _stored(course)
    record = {
        "solver": POINTS_SOLVER if isinstance(course, points.Course) else SOLVER,
        **{name: value for name, value in last.items() if name != "megabytes"},
        "lower": course.lower - less,
        "peak_megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000,
        "versions": host.versions("numpy", "numba"),
        "stopped": stopped,
    }
    return Solution(record, arrays)
