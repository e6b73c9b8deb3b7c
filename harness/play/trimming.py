"""Making a solved policy small enough to ship: what simulated episodes never act by is left out."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.model.domain import Domain
from harness.play.evaluation import evaluate
from harness.policy.alpha import AlphaVectorPolicy
from harness.solver.solution import Solution

_KEEP_SEED = 2**31  # far from the seeds that people score with


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

    def clone(self) -> _Counting:
        """Another that counts in the same place."""
        return copy.copy(self)

    def choose(self, batch: Batch) -> NDArray[np.intp]:
        chosen = super().choose(batch)
        self.used[chosen[~batch.done]] = True
        return chosen
