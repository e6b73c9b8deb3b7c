"""Engines step batches of episodes. One contract, two implementations that give the same episodes bit for bit."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from harness import bridge
from harness.errors import HarnessError, nearest, quoted
from harness.model.domain import Domain

ENGINES = ("tables", "julia")
"""Names of the engines; ``auto`` stands for one of them."""


class Engine(Protocol):
    """A batch of E episodes in lockstep.

    An engine has no randomness of its own: it turns one uniform number an episode and step into a next state and an
    observation. The state is the inverse CDF at u over the next states in index order; what is left of u, its place
    within that state's share, is uniform again and gives the observation in the same way; where sensors read unasked,
    what that leaves gives the label of the first, and so on.

    After its end (a terminal state) an episode keeps its last values and is paid 0; nothing is ever reset inside
    :meth:`step`. Ending at the horizon (truncation) is the caller's business.

    The public arrays below, and the rewards returned, are the engine's own and are overwritten by every :meth:`step`.
    """

    domain: Domain
    visible: NDArray[np.int32]
    """(E,) index of the visible part of the state."""
    observation: NDArray[np.int32]
    """(E,) index of the last observation, −1 when there is none yet."""
    marginals: NDArray[np.float64]
    """(E, N) belief over the hidden factors; (E, 0) when not tracked."""
    done: NDArray[np.bool_]
    """(E,) whether a terminal state has been reached."""

    def reset(self, u: NDArray[np.float64]) -> None:
        """Start all episodes. ``u``: (E,) in [0, 1), for the initial states and the first readings."""

    def step(self, actions: NDArray[np.int32], u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Apply one action an episode; rewards (E,). ``u``: (E,) in [0, 1), for next states and observations.

        The action −1 (:data:`harness.model.tables.STOP`) leaves an episode as it is and pays 0.
        """


def choose(name: str, domain: Domain) -> str:
    """The engine meant by ``auto``, ``tables`` or ``julia``; a domain from a model file has tables only.

    Raises:
        HarnessError: the name is unknown, or ``julia`` was asked for a domain that has no definition there.
        JuliaError: ``julia`` was asked for and is not set up.
    """
    if name == "auto":
        return "julia" if domain.in_julia and bridge.is_set_up() else "tables"
    if name not in ENGINES:
        raise HarnessError(f"no engine {quoted(name)}{nearest(name, ENGINES)} (known: auto, {', '.join(ENGINES)})")
    if name == "julia":
        if not domain.in_julia:
            raise HarnessError(f"{domain.name} is not defined in Julia; take --engine tables")
        bridge.require_set_up()
    return name


def make(name: str, domain: Domain, size: int, track_belief: bool) -> Engine:
    """A new engine called ``name`` (one of :data:`ENGINES`) for ``size`` episodes."""
    if name == "julia":
        from harness.engine.julia import JuliaEngine

        return JuliaEngine(domain, size, track_belief)
    from harness.engine.tables import TablesEngine

    return TablesEngine(domain, size, track_belief)
