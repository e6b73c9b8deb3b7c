"""The true hidden state of an episode, which the player shows at its end; nothing of it ever reaches a policy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng
from harness.engine.tables import TablesEngine
from harness.model.domain import Domain


def hidden(domain: Domain, actions: Sequence[int], seed: int, number: int) -> dict[str, list[str]]:
    """Values of the hidden factors at the ``start`` and at the ``end`` of episode ``number`` of a seed, by their names.

    ``actions``: those that were taken in it. The engine plays them once more, with the same random numbers. The end is
    before the step into a terminal state, where there was one: after it nothing hidden means anything.
    """
    engine = TablesEngine(domain, 1, track_belief=False)
    engine.reset(rng.uniforms(seed, rng.ENGINE, 0, number, 1))
    passed = [_names(domain, engine.values[0])]
    for step, action in enumerate(actions, 1):
        engine.step(np.array([action], dtype=np.int32), rng.uniforms(seed, rng.ENGINE, step, number, 1))
        if not engine.done[0]:
            passed.append(_names(domain, engine.values[0]))
    return {"start": passed[0], "end": passed[-1]}


def _names(domain: Domain, values: NDArray[np.int16]) -> list[str]:
    return [labels[x] for labels, x in zip(domain.factor_labels, values, strict=True)]
