"""The policy protocol."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch


@runtime_checkable
class Policy(Protocol):
    """Decides for a whole batch of episodes at a time. Any object with these two methods is a policy.

    A large evaluation is split into batches that run at the same time, each with a shallow copy of the policy:
    what a policy remembers of its episodes must be made anew in :meth:`reset`, as arrays with one row an episode.

    A policy that never looks at the belief may set a class attribute ``uses_belief = False``; the engine then
    leaves the belief out, which is faster. One that takes long over a decision may set ``batch_size`` (episodes a
    batch) and ``max_episodes`` (what a comparison gives it unless told otherwise).
    """

    def reset(self, batch: Batch) -> None:
        """Begin new episodes: ``batch`` shows them before the first step."""

    def act(self, batch: Batch) -> NDArray[Any]:
        """Action indices (E,), whole numbers; those of ended episodes are ignored.

        −1 (:data:`harness.model.tables.STOP`) ends an episode's part in the evaluation where it stands: no more steps,
        no more reward, no success. Whoever returns it must go on returning it for that episode.
        """


class Stateless:
    """A policy that remembers nothing between steps."""

    def reset(self, batch: Batch) -> None:
        """Nothing to forget."""


def constant(size: int, action: int) -> NDArray[np.int32]:
    """The same action for all episodes."""
    return np.full(size, action, dtype=np.int32)
