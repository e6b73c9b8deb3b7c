"""The paper's two parametrized heuristics for RockSample (Algorithms 2 and 3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.batch import Batch
from harness.domain import Domain
from harness.tables import compiled

ACCURACY_DEFAULT = 0.93
BELIEF_DEFAULT = 0.84


class _Map(NamedTuple):
    """What the heuristics know of a RockSample domain: cells, rocks, and which action is which."""

    cells: NDArray[np.int16]  # (V, 2) x and y of each visible value
    rocks: NDArray[np.int16]  # (K, 2)
    accuracy: NDArray[np.float64]  # (V, K) probability that a reading is right (eq. 3)
    up: int
    right: int
    down: int
    left: int
    sample: int
    check: int  # action of check(1); check(i) follows in order
    good: int  # observation of a good rock


def _map_of(domain: Domain) -> _Map:
    rocks = np.array(domain.layout["rocks"], dtype=np.int16)
    cells = domain.visible_values
    distance = np.linalg.norm(cells[:, None, :].astype(float) - rocks[None, :, :], axis=2)
    return _Map(
        cells=cells,
        rocks=rocks,
        accuracy=0.5 + 0.5 * 2.0 ** (-distance / domain.layout["half_efficiency_distance"]),
        up=domain.action("up()"),
        right=domain.action("right()"),
        down=domain.action("down()"),
        left=domain.action("left()"),
        sample=domain.action("sample()"),
        check=domain.action("check(1)"),
        good=domain.observations.index("good"),
    )


class AccuracyPolicy:
    """Algorithm 2: go for the nearest rock that can be read with more than a threshold's accuracy.

    Candidates are the rocks neither sampled nor rejected whose sensor accuracy exceeds the threshold; the nearest
    (Manhattan distance, ties by number) is checked once: good, it is walked to and sampled; bad, rejected. Without
    candidates the robot moves right.
    """

    uses_belief = False

    def __init__(self, domain: Domain, threshold: float = ACCURACY_DEFAULT) -> None:
        """``threshold``: λ in [0.5, 1]."""
        self.threshold = threshold
        self._map = _map_of(domain)

    def reset(self, batch: Batch) -> None:
        """Forget all readings."""
        self._rocks = np.zeros((batch.size, len(self._map.rocks)), dtype=np.int8)
        self._checked = np.full(batch.size, -1, dtype=np.int16)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        _accuracy_act(
            self._map, self.threshold, batch.visible, batch.observation, batch.done, self._rocks, self._checked, actions
        )
        return actions


class BeliefPolicy:
    """Algorithm 3: check the nearest rock until the belief decides, then sample it or pass it by.

    Of the rocks not sampled whose belief is not below 1 − γ, the nearest (Manhattan distance, ties by number) is
    walked to and sampled when its belief exceeds γ, else checked. Without such rocks the robot moves right.
    """

    def __init__(self, domain: Domain, threshold: float = BELIEF_DEFAULT) -> None:
        """``threshold``: γ in [0.5, 1]."""
        self.threshold = threshold
        self._map = _map_of(domain)

    def reset(self, batch: Batch) -> None:
        """No rock has been sampled yet."""
        self._sampled = np.zeros((batch.size, len(self._map.rocks)), dtype=np.bool_)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        columns = batch.domain.feature_columns
        _belief_act(
            self._map, self.threshold, columns, batch.visible, batch.marginals, batch.done, self._sampled, actions
        )
        return actions


@compiled
def _distance(m: _Map, v: int, rock: int) -> int:
    return abs(m.cells[v, 0] - m.rocks[rock, 0]) + abs(m.cells[v, 1] - m.rocks[rock, 1])


@compiled
def _toward(m: _Map, v: int, rock: int) -> int:
    """The move toward a rock, column first, then row; sample() on it."""
    if m.cells[v, 0] < m.rocks[rock, 0]:
        return m.right
    if m.cells[v, 0] > m.rocks[rock, 0]:
        return m.left
    if m.cells[v, 1] < m.rocks[rock, 1]:
        return m.up
    if m.cells[v, 1] > m.rocks[rock, 1]:
        return m.down
    return m.sample


_OPEN, _GOOD, _DISMISSED = 0, 1, 2  # what Algorithm 2 holds of a rock: unread, read good, read bad or sampled


@compiled
def _accuracy_act(
    m: _Map,
    threshold: float,
    visible: NDArray[np.int32],
    observation: NDArray[np.int32],
    done: NDArray[np.bool_],
    rocks: NDArray[np.int8],
    checked: NDArray[np.int16],
    actions: NDArray[np.int32],
) -> None:
    for e in range(len(visible)):
        if done[e]:
            continue
        if checked[e] >= 0:
            rocks[e, checked[e]] = _GOOD if observation[e] == m.good else _DISMISSED
            checked[e] = -1
        v = visible[e]
        nearest = -1
        for i in range(len(m.rocks)):
            candidate = rocks[e, i] != _DISMISSED and m.accuracy[v, i] > threshold
            if candidate and (nearest < 0 or _distance(m, v, i) < _distance(m, v, nearest)):
                nearest = i
        if nearest < 0:
            actions[e] = m.right
        elif rocks[e, nearest] == _OPEN:
            actions[e] = m.check + nearest
            checked[e] = nearest
        else:
            actions[e] = _toward(m, v, nearest)
            if actions[e] == m.sample:
                rocks[e, nearest] = _DISMISSED


@compiled
def _belief_act(
    m: _Map,
    threshold: float,
    columns: NDArray[np.int64],
    visible: NDArray[np.int32],
    marginals: NDArray[np.float64],
    done: NDArray[np.bool_],
    sampled: NDArray[np.bool_],
    actions: NDArray[np.int32],
) -> None:
    for e in range(len(visible)):
        if done[e]:
            continue
        v = visible[e]
        nearest = -1
        for i in range(len(m.rocks)):
            candidate = not sampled[e, i] and marginals[e, columns[i]] >= 1.0 - threshold
            if candidate and (nearest < 0 or _distance(m, v, i) < _distance(m, v, nearest)):
                nearest = i
        if nearest < 0:
            actions[e] = m.right
        elif marginals[e, columns[nearest]] > threshold:
            actions[e] = _toward(m, v, nearest)
            if actions[e] == m.sample:
                sampled[e, nearest] = True
        else:
            actions[e] = m.check + nearest
