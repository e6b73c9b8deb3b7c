"""Solving a domain in Julia, and making the result small enough to ship."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from harness import bridge
from harness.batch import Batch
from harness.domain import Domain
from harness.errors import HarnessError
from harness.evaluation import evaluate
from harness.policy.alpha import AlphaVectorPolicy, Solution

TIMED = ("sarsop", "native-sarsop")
_KEEP_SEED = 2**31  # far from the seeds that people score with


def solve(domain: Domain, solver: str, limits: Mapping[str, float], keep_used: int | None = None) -> Solution:
    """Solve a domain with ``qmdp``, ``sarsop``, ``native-sarsop`` or ``mdp`` (the fully observed bound).

    Args:
        domain: what to solve.
        solver: which solver.
        limits: ``timeout`` (seconds) and ``precision`` of the SARSOP solvers; their defaults are 600 and 0.001.
        keep_used: keep only the alpha vectors that this many simulated episodes act by.

    Ctrl-C stops ``sarsop`` early: what it has by then is the result, and its record holds the bounds reached.

    Raises:
        HarnessError: a limit does not belong to the solver.
        JuliaError: Julia is not set up, or the solver failed.
    """
    if limits and solver not in TIMED:
        raise HarnessError(f"{next(iter(limits))} is a limit of {' and '.join(TIMED)}; {solver} has none")
    if keep_used and solver == "mdp":
        raise HarnessError("mdp is a bound and has no alpha vectors to keep")
    with tqdm(desc=f"{solver} on {domain.name}", bar_format="{desc} {elapsed} {postfix}", disable=None) as bar:
        interrupted = threading.Event()

        def report(seconds: float, lower: float, upper: float) -> bool:
            bar.set_postfix_str(f"lower {lower:.3f} upper {upper:.3f}")
            return not interrupted.is_set()

        with _ctrl_c_sets(interrupted if solver == "sarsop" else None):
            record, arrays = bridge.solve(domain, solver, limits, report)
    if interrupted.is_set():
        record["stopped"] = "by Ctrl-C"
    solution = Solution(record, arrays)
    return only_used(domain, solution, keep_used) if keep_used else solution


@contextlib.contextmanager
def _ctrl_c_sets(event: threading.Event | None) -> Iterator[None]:
    """Within, the first Ctrl-C sets the event instead of interrupting; None leaves Ctrl-C alone."""
    if event is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    bridge.julia()  # starting Julia sets handlers of its own: first that, then ours

    def stop(*_: object) -> None:
        event.set()
        signal.signal(signal.SIGINT, before)  # the second one interrupts

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def only_used(domain: Domain, solution: Solution, episodes: int) -> Solution:
    """The alpha vectors that simulated episodes act by, and what the record says of it.

    A point-based solver keeps vectors for every belief that it ever backed up; a fraction of them decide anything.
    """
    counting = _Counting(domain, solution)
    evaluate(domain, counting, episodes=episodes, seed=_KEEP_SEED, engine="tables", workers=1)
    kept = counting.used
    for v in np.setdiff1d(solution.arrays["visible"], solution.arrays["visible"][kept]):
        kept |= solution.arrays["visible"] == v  # never visited: keep all, so that the policy is defined there
    record: dict[str, Any] = {**solution.record, "vectors_solved": len(kept), "kept_from_episodes": episodes}
    return Solution(record, {name: array[kept] for name, array in solution.arrays.items()})


class _Counting(AlphaVectorPolicy):
    """Notes which vectors it acts by."""

    def __init__(self, domain: Domain, solution: Solution) -> None:
        super().__init__(domain, solution)
        self.used = np.zeros(len(solution.arrays["actions"]), dtype=np.bool_)

    def choose(self, batch: Batch) -> NDArray[np.intp]:
        chosen = super().choose(batch)
        self.used[chosen[~batch.done]] = True
        return chosen
