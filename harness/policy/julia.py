"""Policies and solvers of POMDPs.jl, named by the Julia file that ends in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness import bridge
from harness.engine.batch import Batch
from harness.errors import PolicyError, quoted
from harness.model.domain import Domain

SUFFIX = ".jl"
PLANNED = 1000
"""Episodes that a comparison gives to a policy that plans, unless told otherwise."""
_BATCH, _PLANNED_BATCH = 4096, 64  # episodes; Ctrl-C, progress and the memory of copies ask for few
_COPIES = 1 << 30  # bytes that the copies of a batch may take


class JuliaPolicy:
    """A POMDPs.jl policy. One call into Julia a step; each episode has its own copy, belief and numbers there."""

    engine = "julia"
    """The only engine that it plays on."""

    def __init__(self, domain: Domain, path: Path) -> None:
        """The policy, the solver or the function that the last expression of the file gives, for this domain.

        Raises:
            PolicyError: there is no such file.
            JuliaError: Julia is not set up, or the file is wrong; the message names its line.
        """
        if not path.is_file():
            raise PolicyError(f"{quoted(path)}: no such file")
        self._planned = bridge.planned(domain, path)
        self.details = self._planned.about
        quick, copy_size = self._planned.quick, self._planned.copy_size
        self.max_episodes = 100_000_000 if quick else PLANNED
        self.batch_size = max(1, min(_BATCH if quick else _PLANNED_BATCH, _COPIES // max(1, copy_size)))

    def clone(self) -> JuliaPolicy:
        """Another one for another batch; the solved policy is shared, Julia copies what it must."""
        made = object.__new__(JuliaPolicy)
        made.__dict__.update(self.__dict__)
        return made

    def reset(self, batch: Batch) -> None:
        """New copies, beliefs and random numbers."""
        self._actions = np.zeros(batch.size, dtype=np.int32)
        self._numbers = np.zeros(batch.size)
        self._act = bridge.players(
            self._planned,
            {
                "visible": batch.visible,
                "observation": batch.observation,
                "marginals": batch.marginals,
                "done": batch.done,
                "numbers": self._numbers,
                "actions": self._actions,
            },
        )

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """What Julia's ``action(policy, belief)`` gives."""
        self._numbers[:] = batch.uniform()
        self._act()
        return self._actions
