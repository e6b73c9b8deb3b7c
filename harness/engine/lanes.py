"""Episodes that stand at different steps: as each ends, its lane goes on with another.

The engine steps all lanes together; only the random numbers are looked up one by one. Episode k of a seed is therefore
the one that :func:`harness.play.evaluation.evaluate` plays, in whichever lane and after whatever else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng
from harness.engine.batch import Batch, read_only
from harness.engine.philox import uniform
from harness.engine.tables import TablesEngine
from harness.model.domain import Domain
from harness.model.tables import STOP, compiled

_ENGINE = rng.ENGINE


class Lanes:
    """E lanes of the embedded engine with the belief; arrays have a row a lane and are overwritten by every step."""

    def __init__(self, domain: Domain, size: int, horizon: int) -> None:
        """``size`` lanes; an episode is truncated after ``horizon`` steps. :meth:`start` comes first."""
        self.engine = TablesEngine(domain, size, track_belief=True)
        self.size, self.horizon = size, horizon
        self.seed = np.zeros(size, dtype=np.uint64)
        self.number = np.zeros(size, dtype=np.int64)
        """(E,) number of the lane's episode in its seed."""
        self.steps = np.zeros(size, dtype=np.int64)
        """(E,) steps taken in it."""
        self.last = np.full(size, STOP, dtype=np.int32)
        """(E,) the last action; −1 before the first."""
        self.batch = _view(self.engine, slice(None), 0, 0, 0)
        """All lanes; its seed, first and step are no lane's."""
        self._actions = np.zeros(size, dtype=np.int32)
        self._u = np.zeros(size)

    def start(self, which: NDArray[np.bool_], number: NDArray[np.int64]) -> None:
        """Begin episode ``number[e]`` of ``seed[e]`` in the lanes where ``which`` (E,) is True."""
        _start(which, number, self.seed, self.number, self.steps, self.last, self._u)
        self.engine.restart(which, self._u)

    def step(self, actions: NDArray[np.int32], idle: NDArray[np.bool_]) -> NDArray[np.float64]:
        """One action a lane; rewards (E,). Where ``idle`` (E,) is True nothing happens and 0 is paid."""
        _advance(actions, idle, self.seed, self.number, self.steps, self.last, self._actions, self._u)
        return self.engine.step(self._actions, self._u)

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """(E,) whether a terminal state has been reached; a new array."""
        return self.engine.done.copy()

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """(E,) whether the episode was cut at the horizon, no terminal state reached; a new array."""
        return (self.steps >= self.horizon) & ~self.engine.done

    def lane(self, e: int) -> Batch:
        """One lane as policies and drawings see it."""
        return _view(self.engine, slice(e, e + 1), int(self.seed[e]), int(self.number[e]), int(self.steps[e]))

    def some(self, which: NDArray[np.bool_]) -> Batch:
        """Those lanes where ``which`` (E,) is True, as they are now; its seed, first and step are no lane's."""
        return _view(self.engine, which, 0, 0, 0)


def _view(engine: TablesEngine, part: slice | NDArray[np.bool_], seed: int, first: int, step: int) -> Batch:
    return Batch(
        engine.domain,
        read_only(engine.visible[part]),
        read_only(engine.observation[part]),
        read_only(engine.marginals[part]),
        read_only(engine.done[part]),
        seed,
        first,
        step,
    )


@compiled
def _start(
    which: NDArray[np.bool_],
    numbers: NDArray[np.int64],
    seed: NDArray[np.uint64],
    number: NDArray[np.int64],
    steps: NDArray[np.int64],
    last: NDArray[np.int32],
    u: NDArray[np.float64],
) -> None:
    for e in range(len(which)):
        if which[e]:
            number[e], steps[e], last[e] = numbers[e], 0, STOP
            u[e] = uniform(seed[e], _ENGINE, 0, number[e])


@compiled
def _advance(
    given: NDArray[np.int32],
    idle: NDArray[np.bool_],
    seed: NDArray[np.uint64],
    number: NDArray[np.int64],
    steps: NDArray[np.int64],
    last: NDArray[np.int32],
    actions: NDArray[np.int32],
    u: NDArray[np.float64],
) -> None:
    for e in range(len(given)):
        actions[e] = STOP
        if not idle[e]:
            steps[e] += 1
            actions[e] = last[e] = given[e]
            u[e] = uniform(seed[e], _ENGINE, steps[e], number[e])
