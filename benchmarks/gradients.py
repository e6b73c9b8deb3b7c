"""Ways uphill from the same starts, at equal environment steps, on RockSample(7, 8).

    python -m benchmarks.gradients [SEEDS [MILLION_STEPS]]

Every run is cut when it has taken so many steps; a situation that autodiff expands counts as one. Shown is the exact
return, by hard thresholds, where each run stands then: the mean over the seeds, and in brackets the lowest. A number
behind autodiff is the most situations that it expands in a step, 1,000 without.
"""

from __future__ import annotations

import contextlib
import sys

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

import harness
from harness.engine import rng
from harness.expectation.smooth.forward import forward
from harness.model.domain import Domain
from harness.play.evaluation import evaluate
from harness.tuning.choosing import rounded
from harness.tuning.journal import Journal
from harness.tuning.method import Ask, configure
from harness.tuning.objective import measured
from harness.tuning.run import METHODS, climb
from harness.tuning.tunable import Tunable, tunable

STARTS = {
    "belief:0.6": "return",
    "belief:0.92": "return",
    "thresholds:accept=0.6,reject=0.45,ahead=0.6,aside=0.9,wait=0.5": "discounted",
}
SETTINGS: dict[str, dict[str, float]] = {
    "gradient": {"episodes": 1000},
    "spsa": {"episodes": 1000},
    "score": {"episodes": 100, "pairs": 10},
    "cmaes": {"episodes": 500},
    "autodiff": {"situations": 1000},
    "autodiff, 150": {"situations": 150},
}


class Spent(Exception):
    """All steps are."""


class Counted:
    """Answers until its steps are spent."""

    def __init__(self, domain: Domain, subject: Tunable, seed: int, measure: str, steps: int) -> None:
        self.domain, self.subject, self.seed, self.measure, self.left = domain, subject, seed, measure, steps

    def __call__(self, ask: Ask) -> NDArray[np.float64]:
        played = [
            evaluate(self.domain, policy, episodes=ask.episodes, seed=self.seed, first=int(first), engine="tables")
            for policy, first in zip(map(self.subject.policy, ask.points), ask.first, strict=True)
        ]
        self._spend(sum(int(each.steps.sum()) for each in played))
        return np.stack([measured(each, self.measure) for each in played])

    def smooth(self, ask: Ask) -> NDArray[np.float64]:
        assert ask.soft is not None
        draws, policy = rng.generator(self.seed, rng.TUNER, int(ask.first[0])), self.subject.policy(ask.points[0])
        found = forward(self.domain, policy, ask.soft.temperature, 50, ask.soft.situations, draws)
        self._spend(found.situations)
        if self.measure == "return":
            return np.append(found.value, found.gradient)
        return np.append(found.discounted, found.discounted_gradient)

    def _spend(self, steps: int) -> None:
        self.left -= steps
        if self.left < 0:
            raise Spent


def ended(domain: Domain, start: str, method: str, seed: int, steps: int) -> float:
    """Exact return where a method stands after so many steps, or at its end if that is earlier."""
    subject, measure = tunable(start, domain), STARTS[start]
    kind = METHODS[method.partition(",")[0]]
    search = configure(kind, subject, seed, SETTINGS[method] | {"iterations": 10_000})
    with contextlib.suppress(Spent):
        climb(search, Counted(domain, subject, rng.TRAINING + seed, measure, steps), Journal(subject.names))
    found = harness.exact(domain, subject.policy(rounded(subject, search.theta)))
    return (found.mean if measure == "return" else found.discounted).middle


def main(seeds: int = 3, millions: float = 2) -> None:
    domain, rows = harness.load("rocksample-7x8"), []
    for start, measure in STARTS.items():
        subject = tunable(start, domain)
        exact = harness.exact(domain, subject.policy(subject.start))
        row = [start, f"{(exact.mean if measure == 'return' else exact.discounted).middle:.2f}"]
        for method in SETTINGS:
            found = [ended(domain, start, method, seed, int(millions * 1e6)) for seed in range(seeds)]
            row.append(f"{np.mean(found):.2f} ({min(found):.2f})")
            print(row[0], method, np.round(found, 3).tolist(), file=sys.stderr, flush=True)
        rows.append(row)
    print(f"exact returns after {millions:g} million steps; of thresholds the discounted one; {seeds} seeds\n")
    print(tabulate(rows, ["start", "there", *SETTINGS], disable_numparse=True))


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((int, float), sys.argv[1:], strict=False)))
