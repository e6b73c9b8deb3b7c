"""Finite-state controllers: policies that remember one of N nodes and nothing else."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError, quoted
from harness.policy.base import fitting


class Controller:
    """A deterministic finite-state controller: a node acts, and the reading that follows leads to the next node.

    Hansen, "Solving POMDPs by searching in policy space", UAI 1998, section 3. Every episode begins in node 0.
    """

    uses_belief = False
    memory = ("_at",)

    def __init__(self, actions: ArrayLike, successors: ArrayLike, *, name: str = "controller") -> None:
        """A controller of N nodes.

        Args:
            actions: (N,) the action of each node.
            successors: (N, O) the next node by the reading; or (N, V, O) by what is then visible and the reading.
            name: what tables call it.

        Raises:
            PolicyError: the arrays do not fit each other, or a successor is no node.
        """
        self.name = name
        self.actions = _whole(actions, "actions").astype(np.int32)
        found = _whole(successors, "successors")
        n = len(self.actions) if self.actions.ndim == 1 else 0
        if n == 0 or found.ndim not in (2, 3) or len(found) != n:
            shapes = f"{self.actions.shape} and {found.shape}"
            raise PolicyError(f"a controller has actions (N,) and successors (N, O) or (N, V, O), not {shapes}")
        if found.size and not 0 <= found.min() <= found.max() < n:
            raise PolicyError(f"the nodes are 0 to {n - 1}; the successors are {found.min()} to {found.max()}")
        self.successors = found[:, None] if found.ndim == 2 else found
        """(N, V or 1, O)"""

    def reset(self, batch: Batch) -> None:
        """All episodes begin in node 0.

        Raises:
            PolicyError: the controller was made for another domain.
        """
        domain = batch.domain
        _, visible, readings = self.successors.shape
        if readings != domain.n_observations or visible not in (1, domain.n_visible):
            wanted = f"(N, {domain.n_observations}) or (N, {domain.n_visible}, {domain.n_observations})"
            raise PolicyError(f"successors for {domain.name} have the shape {wanted}")
        if not 0 <= self.actions.min() <= self.actions.max() < domain.n_actions:
            raise PolicyError(f"the actions of {domain.name} are 0 to {domain.n_actions - 1}")
        self._at = np.zeros(batch.size, dtype=np.int64)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """The actions of the nodes that the readings have led to."""
        at = fitting(batch, self._at)
        if batch.step > 0:
            visible = batch.visible if self.successors.shape[1] > 1 else 0
            self._at = at = self.successors[at, visible, batch.observation]
        return self.actions[at]

    def clone(self) -> Controller:
        """A controller with the same arrays, which are not written to."""
        return copy.copy(self)


def _whole(values: ArrayLike, what: str) -> NDArray[np.int64]:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(1, np.nan)
    if not (array == np.floor(array)).all():
        raise PolicyError(f"a controller's {what} must be whole numbers, not {quoted(values)}")
    return array.astype(np.int64)
