"""Plays a policy graph of the solver (:mod:`harness.solver.graph`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.model.domain import Domain
from harness.model.tables import compiled
from harness.policy.base import fitting
from harness.solver.solution import Solution


class _Nodes(NamedTuple):
    action: NDArray[np.int32]
    first: NDArray[np.int32]
    edge_visible: NDArray[np.int32]
    edge_reading: NDArray[np.int32]
    edge_node: NDArray[np.int32]
    fallback: NDArray[np.int32]

    def __deepcopy__(self, memo: object) -> _Nodes:
        """Itself: nobody writes to it, so copies of a policy share it."""
        return self


class PolicyGraph:
    """Acts by the node that the readings so far led to; off the graph, by the visible value alone.

    From its root on it earns, in expectation, at least the lower bound that it was stored with; off the graph what its
    fallback earns whatever is hidden.
    """

    uses_belief = False
    memory = ("_at",)

    def __init__(self, domain: Domain, solution: Solution) -> None:
        """``solution``: as stored by ``harness solve``."""
        arrays = solution.arrays
        self._nodes = _Nodes(*(np.ascontiguousarray(arrays[name], dtype=np.int32) for name in _Nodes._fields))
        self.record = solution.record

    def reset(self, batch: Batch) -> None:
        """All episodes begin at the root."""
        self._at = np.full(batch.size, 0 if self._nodes.action[0] >= 0 else -1)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        _act(self._nodes, batch.step, batch.visible, batch.observation, batch.done, fitting(batch, self._at), actions)
        return actions


@compiled
def _act(
    n: _Nodes,
    step: int,
    visible: NDArray[np.int32],
    observation: NDArray[np.int32],
    done: NDArray[np.bool_],
    at: NDArray[np.int64],
    actions: NDArray[np.int32],
) -> None:
    first, edge_visible, edge_reading, edge_node = n.first, n.edge_visible, n.edge_reading, n.edge_node
    for e in range(len(visible)):
        if done[e]:
            continue
        if step > 0 and at[e] >= 0:
            found = -1
            for j in range(first[at[e]], first[at[e] + 1]):
                if edge_visible[j] == visible[e] and edge_reading[j] == observation[e]:
                    found = edge_node[j]
            at[e] = found
        actions[e] = n.action[at[e]] if at[e] >= 0 else n.fallback[visible[e]]
