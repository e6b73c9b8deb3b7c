"""A policy asked by situation, not by episode: what it remembers is put before it, and read back after it acts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch, read_only
from harness.errors import PolicyError
from harness.expectation.situations import Layer, reading_of, visible_of
from harness.model.domain import Domain
from harness.policy import Policy
from harness.policy.base import checked, fresh, memory_words, recall, to_words


class NotExact(PolicyError):
    """A policy's expected return cannot be computed, but it can be sampled."""


class _Situations(Batch):
    """A batch whose rows are situations: it has no episodes, hence no random numbers."""

    def __init__(self, domain: Domain, seen: NDArray[np.int64], marginals: NDArray[np.float64], step: int) -> None:
        rows = len(seen)
        self.domain, self.step = domain, step
        self.visible, self.observation = read_only(visible_of(seen)), read_only(reading_of(seen))
        self.marginals, self.done = read_only(marginals), read_only(np.zeros(rows, dtype=np.bool_))

    def __getattr__(self, name: str) -> Any:
        """``seed`` and ``first``, which situations have not."""
        if name in ("seed", "first"):
            raise NotExact("it draws random numbers, so that what it earns can only be sampled")
        raise AttributeError(name)


class Actor:
    """Plays a policy that says what it remembers (``memory``, see :class:`harness.policy.base.Policy`)."""

    def __init__(self, domain: Domain, policy: Policy) -> None:
        """A copy of the policy plays.

        Raises:
            NotExact: the policy does not say what it remembers.
        """
        names = getattr(policy, "memory", None)
        if names is None:
            raise NotExact("it does not say what it remembers (memory), so that what it earns can only be sampled")
        self._domain, self._policy, self._names = domain, fresh(policy), tuple(names)
        self._sees_belief = getattr(policy, "uses_belief", True)

    def begin(self, layer: Layer) -> Layer:
        """The first layer, with what the policy remembers at its start."""
        self._policy.reset(self._batch(layer.key, 0))
        self._like = [getattr(self._policy, name) for name in self._names]
        return Layer(np.hstack([*map(to_words, self._like), layer.key]), layer.mass)

    def act(self, key: NDArray[np.int64], step: int) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """The actions (S,), and which factors' beliefs the policy may yet look at (S, K); memory moves on in place.

        Raises:
            NotExact: it draws random numbers.
            PolicyError: its actions are none.
        """
        policy = self._policy
        column = recall([(policy, *each) for each in zip(self._names, self._like, strict=True)], key)
        batch = self._batch(key, step)
        actions = checked(policy.act(batch), batch)
        watched = self._watched(batch)
        if self._names:
            key[:, :column] = memory_words((policy, name) for name in self._names)
        return actions, watched

    def _watched(self, batch: Batch) -> NDArray[np.bool_]:
        if hasattr(self._policy, "outlook"):
            return np.asarray(self._policy.outlook(batch))
        return np.full((batch.size, len(batch.domain.factors)), self._sees_belief)

    def _batch(self, key: NDArray[np.int64], step: int) -> _Situations:
        n = self._domain.n_marginals
        marginals = np.ascontiguousarray(key[:, key.shape[1] - n :]).view(np.float64)
        seen = key[:, key.shape[1] - n - 1]
        return _Situations(self._domain, seen, marginals if self._sees_belief else np.zeros((len(key), 0)), step)
