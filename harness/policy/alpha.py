"""Alpha-vector policies, solved in Julia and stored with the package or in a file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.policy.base import Stateless
from harness.solver.solution import Solution

TIE = 1e-9
"""Values this close (relative to the larger of 1 and the best) count as equal, and the first vector wins: matrix
products differ in their last bits between machines and batch sizes, and no decision may hang on that."""


class _Vectors(dict[int, tuple[NDArray[np.intp], NDArray[np.float64]]]):
    """By visible value: numbers of its alpha vectors (n,), and these (H, n). Megabytes that nobody writes to."""

    def __deepcopy__(self, memo: object) -> _Vectors:
        """Itself: copies of a policy share them."""
        return self


class AlphaVectorPolicy(Stateless):
    """Acts by the alpha vector of the present visible value that promises most under the joint belief.

    Episodes are grouped by visible value, so that each group is one matrix product.
    """

    def __init__(self, domain: Domain, solution: Solution) -> None:
        """``solution``: as stored by ``harness solve``."""
        visible = solution.arrays["visible"]
        values = solution.arrays["values"].astype(np.float64)
        self._actions = solution.arrays["actions"]
        self._vectors = _Vectors(
            (int(v), (rows := np.flatnonzero(visible == v), values[rows].T)) for v in np.unique(visible)
        )
        self.record = solution.record

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """The best action under each episode's belief."""
        actions = np.zeros(batch.size, dtype=np.int32)
        alive = ~batch.done
        actions[alive] = self._actions[self.choose(batch)[alive]]
        return actions

    def choose(self, batch: Batch) -> NDArray[np.intp]:
        """(E,) index of the alpha vector that each episode acts by; 0 for ended ones."""
        chosen = np.zeros(batch.size, dtype=np.intp)
        alive = np.flatnonzero(~batch.done)
        order = alive[np.argsort(batch.visible[alive], kind="stable")]
        edges = np.flatnonzero(np.diff(batch.visible[order])) + 1
        for group in np.split(order, edges) if len(order) else []:
            rows, vectors = self._of(int(batch.visible[group[0]]))
            chosen[group] = rows[_first_best(batch.joint(group) @ vectors)]
        return chosen

    def _of(self, v: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        if v not in self._vectors:
            raise PolicyError(f"the policy has no alpha vector for visible value {v}; solve it again (harness solve)")
        return self._vectors[v]


def _first_best(values: NDArray[np.float64]) -> NDArray[np.intp]:
    best = values.max(axis=1, keepdims=True)
    first: NDArray[np.intp] = (values >= best - TIE * np.maximum(1.0, np.abs(best))).argmax(axis=1)
    return first
