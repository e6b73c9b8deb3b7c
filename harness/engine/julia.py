"""The live engine: POMDPs.jl steps the batch, in arrays that Python and Julia share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness import bridge
from harness.engine.arrays import EngineArrays
from harness.model.domain import Domain


class JuliaEngine(EngineArrays):
    """See :class:`harness.engine.Engine` for the contract. One call into Julia a step, whatever the batch's size."""

    def __init__(self, domain: Domain, size: int, track_belief: bool) -> None:
        """An engine for ``size`` episodes; without ``track_belief`` the marginals stay (E, 0)."""
        super().__init__(domain, size, track_belief)
        self._u = np.zeros(size)
        self._actions = np.zeros(size, dtype=np.int32)
        self._rewards = np.zeros(size)
        self._reset, self._step = bridge.simulator(
            domain,
            {
                "u": self._u,
                "actions": self._actions,
                "rewards": self._rewards,
                "visible": self.visible,
                "observation": self.observation,
                "done": self.done,
                "marginals": self.marginals,
            },
        )

    def reset(self, u: NDArray[np.float64]) -> None:
        """Start all episodes."""
        self._u[:] = u
        self._reset()

    def step(self, actions: NDArray[np.int32], u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Apply one action an episode; returns the rewards."""
        self._u[:] = u
        self._actions[:] = actions
        self._step()
        return self._rewards
