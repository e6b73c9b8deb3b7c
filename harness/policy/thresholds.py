"""A readable RockSample policy with five thresholds, beyond the paper's two policies with one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError, nearest, quoted
from harness.model.domain import Domain
from harness.model.tables import compiled
from harness.policy.base import Stateless
from harness.policy.heuristic import RockMap, rock_map

DEFAULTS = {"accept": 0.8, "reject": 0.3, "ahead": 0.97, "aside": 0.6, "wait": 0.9}
"""Tuned on rocksample-7x8 for the discounted return (``harness tune`` by ``cmaes``), rounded within its flat top."""

BOUNDS = {"accept": (0.5, 1.0), "reject": (0.0, 0.5), "ahead": (0.5, 1.0), "aside": (0.5, 1.0), "wait": (0.0, 1.0)}


class ThresholdsPolicy(Stateless):
    """Goes for the rock with the most expected reward a step, reading it on the way as long as it is unsure.

    At every step anew:

    1. Open rocks are those whose belief exceeds ``reject``; none: move right.
    2. The target is the open rock of greatest worth (ties by number): its belief over the steps it takes, which are
       1 + distance (Manhattan) to walk and sample when the belief is at least ``accept``, and otherwise, as it must be
       read first, 1 + belief · (1 + distance); times ``wait`` for every column that the rock lies ahead (nearer the
       exit), because the robot comes by later anyhow.
    3. Belief at least ``accept``: walk to the target (column first, then row) and sample it.
    4. Else read it, if the sensor's accuracy (eq. 3) is at least ``ahead`` for a rock in a column ahead, ``aside``
       for any other; if it is less, walk toward the rock. Where every step reads all rocks unasked, walk in any case;
       on its cell itself a rock is then left alone until its belief is at least ``accept``.

    With ``ahead`` and ``aside`` above 0.98 a rock is read on the spot, where the reading is sure: this wins every good
    rock within the horizon, the most undiscounted; the discounted return wants readings from afar.
    """

    def __init__(self, domain: Domain, **thresholds: float) -> None:
        """``thresholds``: any of :data:`DEFAULTS`, within :data:`BOUNDS`."""
        self.thresholds = DEFAULTS | thresholds
        self.map = rock_map(domain)
        self._patience = self.thresholds["wait"] ** self.map.ahead.astype(np.float64)
        self._needed = np.where(self.map.ahead > 0, self.thresholds["ahead"], self.thresholds["aside"])

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        _act(
            self.map.of(batch.domain),
            self.thresholds["accept"],
            self.thresholds["reject"],
            self._needed,
            self._patience,
            batch.domain.feature_columns,
            batch.visible,
            batch.tracked(),
            batch.done,
            actions,
        )
        return actions


def parse(text: str) -> dict[str, float]:
    """The thresholds in ``accept=0.9,reject=0.2``; what is left out keeps its default. The empty text names none.

    Raises:
        PolicyError: a name is unknown or given twice, or its number is out of range.
    """
    given: dict[str, float] = {}
    for part in text.split(",") if text else []:
        name, _, number = part.partition("=")
        if name not in BOUNDS:
            raise PolicyError(f"thresholds has no {quoted(name)}{nearest(name, BOUNDS)} (it has: {', '.join(BOUNDS)})")
        if name in given:
            raise PolicyError(f"thresholds: {name} is given twice")
        low, high = BOUNDS[name]
        try:
            given[name] = float(number)
        except ValueError:
            raise PolicyError(
                f"thresholds: {name} takes a number between {low:g} and {high:g}, not {quoted(number)}"
            ) from None
        if not low <= given[name] <= high:
            raise PolicyError(
                f"thresholds: {name} lies between {low:g} and {high:g}; {quoted(given[name])} is out of range"
            )
    return given


@compiled
def _act(
    m: RockMap,
    accept: float,
    reject: float,
    needed: NDArray[np.float64],
    patience: NDArray[np.float64],
    columns: NDArray[np.int64],
    visible: NDArray[np.int32],
    marginals: NDArray[np.float64],
    done: NDArray[np.bool_],
    actions: NDArray[np.int32],
) -> None:
    distance, toward, accuracy, right, check = m.distance, m.toward, m.accuracy, m.right, m.check
    for e in range(len(visible)):
        if done[e]:
            continue
        v = visible[e]
        target, most = -1, 0.0
        for i in range(distance.shape[1]):
            belief = marginals[e, columns[i]]
            if belief > reject and (check >= 0 or belief >= accept or distance[v, i] > 0):
                steps = 1.0 + distance[v, i]
                if belief < accept:
                    steps = 1.0 + belief * steps
                worth = belief / steps * patience[v, i]
                if target < 0 or worth > most:
                    target, most = i, worth
        if target < 0:
            actions[e] = right
        elif check < 0 or marginals[e, columns[target]] >= accept or accuracy[v, target] < needed[v, target]:
            actions[e] = toward[v, target]
        else:
            actions[e] = check + target
