"""Solving a domain in Julia."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

from tqdm import tqdm

from harness import bridge, host
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.solver.solution import Solution

TIMED = ("sarsop", "native-sarsop")


def solve(domain: Domain, solver: str, limits: Mapping[str, float]) -> Solution:
    """Solve a domain with ``qmdp``, ``sarsop``, ``native-sarsop`` or ``mdp`` (the fully observed bound).

    Args:
        domain: what to solve.
        solver: which solver, or a Julia file that ends in a solver or a policy of POMDPs.jl.
        limits: ``timeout`` (seconds) and ``precision`` of the SARSOP solvers; their defaults are 600 and 0.001.

    Ctrl-C stops ``sarsop`` early: what it has by then is the result, and its record holds the bounds reached.

    Raises:
        HarnessError: a limit does not belong to the solver.
        JuliaError: Julia is not set up, or the solver failed.
    """
    if limits and solver not in TIMED:
        raise HarnessError(f"{next(iter(limits))} is a limit of {' and '.join(TIMED)}; {Path(solver).name} has none")
    with tqdm(desc=f"{solver} on {domain.name}", bar_format="{desc} {elapsed} {postfix}", disable=None) as bar:
        interrupted = threading.Event()

        def report(seconds: float, lower: float, upper: float) -> bool:
            bar.set_postfix_str(f"lower {lower:.3f} upper {upper:.3f}")
            return not interrupted.is_set()

        with _ctrl_c_sets(interrupted if solver == "sarsop" else None):
            record, arrays = bridge.solve(domain, solver, limits, report)
    if interrupted.is_set():
        record["stopped"] = "by Ctrl-C"
    return Solution(record, arrays)


@contextlib.contextmanager
def _ctrl_c_sets(event: threading.Event | None) -> Iterator[None]:
    """Within, the first Ctrl-C sets the event instead of interrupting; None leaves Ctrl-C alone."""
    if event is None:
        yield
        return
    bridge.julia()  # starting Julia sets handlers of its own: first that, then ours
    with host.ctrl_c_sets(event):
        yield
