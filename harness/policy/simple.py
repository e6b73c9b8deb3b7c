"""The baselines that need no thought: random, random-legal and exit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.model.domain import Domain
from harness.policy.base import Stateless, constant


class RandomPolicy(Stateless):
    """Uniform over all actions."""

    uses_belief = False

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """Draw one action an episode."""
        return (batch.uniform() * batch.domain.n_actions).astype(np.int32)


class RandomLegalPolicy(Stateless):
    """Uniform over the legal actions: all but the moves that cost the illegal-move penalty.

    Where legality hangs on something hidden (BorderCross with a hidden robot), only actions that are legal in every
    state the belief holds possible count as legal.
    """

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """Draw one legal action an episode."""
        legal = batch.legal()
        count = legal.sum(axis=1)
        pick = np.minimum((batch.uniform() * count).astype(np.int64), np.maximum(count - 1, 0))
        chosen: NDArray[np.int32] = (legal.cumsum(axis=1) > pick[:, None]).argmax(axis=1).astype(np.int32)
        return chosen


class ExitPolicy(Stateless):
    """RockSample: always right."""

    uses_belief = False

    def __init__(self, domain: Domain) -> None:
        """The policy for a RockSample domain."""
        self._right = domain.action("right()")

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """Right, for every episode."""
        return constant(batch.size, self._right)
