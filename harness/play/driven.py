"""A policy that somebody else's simulator asks for its actions, such as one of POMDPs.jl."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import policy as policies
from harness import registry
from harness.engine.batch import Batch, read_only
from harness.errors import PolicyError, check_whole
from harness.model.domain import Domain
from harness.policy import Policy
from harness.policy.base import checked, fresh


class Driven:
    """Plays a batch of episodes that another simulator steps: it says what is seen, the policy says what to do."""

    def __init__(self, domain: Domain | str, policy: Policy | str, seed: int = 0) -> None:
        """``seed``: of the policy's own random choices.

        Raises:
            HarnessError: the domain or the policy is unknown.
        """
        check_whole("seed", seed, 0, 2**64 - 1)
        self.domain = registry.load(domain) if isinstance(domain, str) else domain
        self.name, self._policy = policies.named(policy, self.domain)
        self._seed = seed
        self._playing: Policy | None = None

    def act(self, step: int, visible: Any, observation: Any, marginals: Any) -> NDArray[np.int32]:
        """Action indices (E,) for E episodes that have taken ``step`` steps; at step 0 new episodes begin.

        Args:
            step: of all episodes.
            visible: (E,) indices of the visible part.
            observation: (E,) indices of the last observation, −1 before the first.
            marginals: (E, N) belief, as in :class:`~harness.engine.batch.Batch`.

        Raises:
            PolicyError: the arrays do not fit the domain, no episode was begun, or the policy's actions are none.
        """
        batch = self._batch(step, visible, observation, marginals)
        if step == 0:
            self._playing = fresh(self._policy)
            self._playing.reset(batch)
        if self._playing is None:
            raise PolicyError("no episodes have begun: the first call must be of step 0")
        return checked(self._playing.act(batch), batch)

    def _batch(self, step: int, visible: Any, observation: Any, marginals: Any) -> Batch:
        indices = [np.array(given, dtype=np.int32) for given in (visible, observation)]
        belief = np.array(marginals, dtype=np.float64, order="C")
        size, d = len(indices[0]), self.domain
        for name, array, low, high in (
            ("visible", indices[0], 0, d.n_visible),
            ("observation", indices[1], -1, d.n_observations),
        ):
            if array.shape != (size,) or array.min(initial=0) < low or array.max(initial=0) >= high:
                raise PolicyError(f"{name} must be one index an episode, from {low} to {high - 1}")
        if belief.shape != (size, d.n_marginals):
            raise PolicyError(f"marginals must have the shape ({size}, {d.n_marginals}), not {belief.shape}")
        seen, last = (read_only(array) for array in indices)
        done = read_only(np.zeros(size, dtype=np.bool_))
        return Batch(d, seen, last, read_only(belief), done, self._seed, 0, step)
