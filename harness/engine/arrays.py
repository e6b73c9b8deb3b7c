"""The public arrays that every engine has."""

from __future__ import annotations

import numpy as np

from harness.model.domain import Domain


class EngineArrays:
    """What :class:`harness.engine.Engine` promises to show of a batch, before the first reset."""

    def __init__(self, domain: Domain, size: int, track_belief: bool) -> None:
        """Arrays for ``size`` episodes; without ``track_belief`` the marginals stay (E, 0)."""
        self.domain = domain
        self.visible = np.zeros(size, dtype=np.int32)
        self.observation = np.zeros(size, dtype=np.int32)
        self.marginals = np.zeros((size, domain.n_marginals if track_belief else 0))
        self.done = np.zeros(size, dtype=np.bool_)
