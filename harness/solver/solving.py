"""Solving a domain to proven bounds, without Julia: ``harness.solve``."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from harness import cards, host, registry
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.solver import anytime
from harness.solver.graph import policy_arrays
from harness.solver.search import N_NODES, TRIALS
from harness.solver.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAP = 0.01
"""Between the bounds, in units of reward, at which solving ends."""
MEMORY = 2.0
"""GB that the solver's arrays may take."""
SOLVER = "product grid and trials (harness)"

_LARGEST_FACTOR = 12

Watch = Callable[[float, float, float], object]
"""Called with seconds, lower and upper bound, about once a second."""


@dataclass(frozen=True)
class Solved:
    """Bounds of a domain's optimal value (discounted, infinite horizon), and a policy that earns the lower one."""

    domain: Domain
    lower: float
    upper: float
    history: pd.DataFrame
    """A row about every second: ``seconds``, ``lower``, ``upper``, ``nodes``, ``trials``, ``cells`` (of the grid),
    ``megabytes``."""
    solution: Solution
    """The policy as it is stored; :class:`harness.policy.graph.PolicyGraph` plays it."""
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
            "nodes of the policy": f"{len(self.solution.arrays['action']):,}",
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
    watch: Watch = lambda seconds, lower, upper: None,
) -> Solved:
    """Find bounds of the value at the start (discounted, infinite horizon), and a policy that earns the lower one.

    Args:
        domain: a domain or its name; the true reward counts, whatever its shaping.
        gap: end when the bounds are this close, in units of reward.
        seconds: end after about so long; by default only the gap and the memory end it.
        memory: GB that the solver's arrays may take.
        watch: called with seconds, lower and upper bound as the work goes on.

    Ctrl-C ends it early: what has been found by then is the result.

    Raises:
        HarnessError: an argument is out of range, or the domain is not of the kind that this solver takes: a discount
            below 1, one visible value to start in, hidden factors of at most 12 values.
    """
    domain = (registry.load(domain) if isinstance(domain, str) else domain).shaped("none")
    for name, value in (("gap", gap), ("seconds", seconds), ("memory", memory)):
        if value is not None and not 0 < value < float("inf"):
            raise HarnessError(f"{name} must be a number above 0, not {value}")
    _check_solvable(domain, memory)
    begun, rows, stopped = time.monotonic(), [], ""
    course = None
    try:
        course = anytime.begin(domain)
        for latest in anytime.blocks(course, gap, int(memory * 1e9)):
            course = latest
            rows.append(_row(course, time.monotonic() - begun))
            watch(rows[-1]["seconds"], course.lower, course.upper)
            if seconds is not None and rows[-1]["seconds"] >= seconds:
                stopped = f"after the {seconds:g} seconds asked for"
                break
    except KeyboardInterrupt:
        if course is None:
            raise
        stopped = "by Ctrl-C"
    if not stopped:
        stopped = "at the gap asked for" if course.upper - course.lower <= gap else "where memory or rounding ends it"
    rows.append(_row(course, time.monotonic() - begun))
    return Solved(domain, course.lower, course.upper, pd.DataFrame(rows), _solution(course, rows[-1], stopped), stopped)


def _check_solvable(domain: Domain, memory: float) -> None:
    if max(domain.factor_sizes, default=1) > _LARGEST_FACTOR:
        raise HarnessError(
            f"{domain.name} has a hidden factor of {max(domain.factor_sizes)} values, and this solver takes "
            f"{_LARGEST_FACTOR} at most; solve it in Julia (--solver sarsop)"
        )
    least = 4 * domain.n_visible * domain.n_joint  # the coarsest grid: certainty about every factor
    if least > memory * 1e9:
        raise HarnessError(
            f"{domain.name} needs {least / 1e9:,.1f} GB for the coarsest grid, more than the {memory:g} GB allowed "
            "(--memory)"
        )


def _row(course: anytime.Course, seconds: float) -> dict[str, Any]:
    return {
        "seconds": seconds,
        "lower": course.lower,
        "upper": course.upper,
        "nodes": int(course.graph.counts[N_NODES]),
        "trials": int(course.graph.counts[TRIALS]),
        "cells": course.rows,
        "megabytes": course.memory / 1e6,
    }


def _solution(course: anytime.Course, last: dict[str, Any], stopped: str) -> Solution:
    record = {
        "solver": SOLVER,
        **{name: last[name] for name in ("lower", "upper", "seconds", "nodes", "trials", "cells")},
        "peak_megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000,
        "versions": host.versions("numpy", "numba"),
        "stopped": stopped,
    }
    return Solution(record, policy_arrays(course))
