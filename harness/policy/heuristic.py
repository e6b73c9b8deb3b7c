"""The paper's two parametrized heuristics for RockSample (Algorithms 2 and 3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.tables import compiled
from harness.policy.base import fitting

ACCURACY_DEFAULT = 0.93
BELIEF_DEFAULT = 0.84


class RockMap(NamedTuple):
    """What the heuristics know of a RockSample domain, by visible value (V of them) and rock (K)."""

    distance: NDArray[np.int64]
    """(V, K) Manhattan distance."""
    ahead: NDArray[np.int64]
    """(V, K) columns that the rock lies nearer the exit; 0 for none."""
    toward: NDArray[np.int32]
    """(V, K) the move toward the rock, column first, then row; sample() on it."""
    accuracy: NDArray[np.float64]
    """(V, K) probability that a reading is right (eq. 3; by a sensor that errs everywhere, less)."""
    right: int
    sample: int
    check: int
    """Action of check(1), after which check(i) follows in order; −1 where every step reads all rocks unasked."""
    good: NDArray[np.bool_]
    """(O, K) whether an observation, which is of the rock, says that it is good."""

    def __deepcopy__(self, memo: object) -> RockMap:
        """Itself: nobody writes to a map, so copies of a policy share it."""
        return self

    def of(self, domain: Domain) -> RockMap:
        """Itself, if it is as large as a map of the domain: compiled code looks no more.

        Raises:
            PolicyError: it is a map of another domain.
        """
        if (*self.distance.shape, len(self.good)) != (domain.n_visible, len(domain.factors), domain.n_observations):
            raise PolicyError(f"the policy was made for other rocks than those of {domain.name}: make it anew")
        return self


def rock_map(domain: Domain) -> RockMap:
    """The map of a RockSample domain."""
    layout = domain.layout
    away = np.array(layout["rocks"]) - domain.visible_values[:, None, :].astype(np.int64)  # (V, K, 2)
    dx, dy = away[..., 0], away[..., 1]
    steps = [domain.action(name) for name in ("right()", "left()", "up()", "down()")]
    return RockMap(
        distance=np.abs(dx) + np.abs(dy),
        ahead=np.maximum(dx, 0),
        toward=np.select([dx > 0, dx < 0, dy > 0, dy < 0], steps, domain.action("sample()")).astype(np.int32),
        accuracy=0.5
        + (layout.get("best_accuracy", 1.0) - 0.5) * 2.0 ** (-np.hypot(dx, dy) / layout["half_efficiency_distance"]),
        right=domain.action("right()"),
        sample=domain.action("sample()"),
        check=-1 if domain.sensors else domain.action("check(1)"),
        good=_says_good(domain),
    )


def _says_good(domain: Domain) -> NDArray[np.bool_]:
    if not domain.sensors:
        return np.array([[observation == "good"] * len(domain.factors) for observation in domain.observations])
    return domain.labels_of(np.arange(domain.n_observations)) == [s.labels.index("good") for s in domain.sensors]


class AccuracyPolicy:
    """Algorithm 2: go for the nearest rock that can be read with more than a threshold's accuracy.

    Candidates are the rocks neither sampled nor rejected whose sensor accuracy exceeds the threshold; the nearest
    (Manhattan distance, ties by number) is checked once: good, it is walked to and sampled; bad, rejected. Without
    candidates the robot moves right.

    Where every step reads all rocks unasked there is nothing to check: each reading of a candidate counts as one, the
    last one decides, and one that has not been read yet is walked to.
    """

    uses_belief = False
    memory = ("_rocks", "_checked")

    def __init__(self, domain: Domain, threshold: float = ACCURACY_DEFAULT) -> None:
        """``threshold``: λ in [0.5, 1]."""
        self.threshold = threshold
        self.map = rock_map(domain)

    def reset(self, batch: Batch) -> None:
        """Forget all readings."""
        self._rocks = np.zeros((batch.size, self.map.distance.shape[1]), dtype=np.int8)
        self._checked = np.full(batch.size, -1, dtype=np.int16)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        _accuracy_act(
            self.map.of(batch.domain),
            self.threshold,
            batch.visible,
            batch.observation,
            batch.done,
            fitting(batch, self._rocks),
            fitting(batch, self._checked),
            actions,
        )
        return actions


class BeliefPolicy:
    """Algorithm 3: check the nearest rock until the belief decides, then sample it or pass it by.

    Of the rocks not sampled whose belief is not below 1 − γ, the nearest (Manhattan distance, ties by number) is
    walked to and sampled when its belief exceeds γ, else checked. Without such rocks the robot moves right.

    Where every step reads all rocks unasked, one that would be checked is walked to, as readings from near are better;
    on its cell itself it is left alone until the belief decides.
    """

    memory = ("_sampled",)

    def __init__(self, domain: Domain, threshold: float = BELIEF_DEFAULT) -> None:
        """``threshold``: γ in [0.5, 1]."""
        self.threshold = threshold
        self.map = rock_map(domain)

    def reset(self, batch: Batch) -> None:
        """No rock has been sampled yet."""
        self._sampled = np.zeros((batch.size, self.map.distance.shape[1]), dtype=np.bool_)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        columns = batch.domain.feature_columns
        _belief_act(
            self.map.of(batch.domain),
            self.threshold,
            columns,
            batch.visible,
            batch.tracked(),
            batch.done,
            fitting(batch, self._sampled),
            actions,
        )
        return actions


OPEN, GOOD, DISMISSED = 0, 1, 2  # what Algorithm 2 holds of a rock: unread, read good, read bad or sampled


@compiled
def _accuracy_act(
    m: RockMap,
    threshold: float,
    visible: NDArray[np.int32],
    observation: NDArray[np.int32],
    done: NDArray[np.bool_],
    rocks: NDArray[np.int8],
    checked: NDArray[np.int16],
    actions: NDArray[np.int32],
) -> None:
    distance, toward, accuracy = m.distance, m.toward, m.accuracy
    right, sample, check, good = m.right, m.sample, m.check, m.good
    for e in range(len(visible)):
        if done[e]:
            continue
        v, o = visible[e], observation[e]
        if checked[e] >= 0:
            rocks[e, checked[e]] = GOOD if good[o, checked[e]] else DISMISSED
            checked[e] = -1
        if check < 0 and o >= 0:
            for i in range(distance.shape[1]):
                if rocks[e, i] != DISMISSED and accuracy[v, i] > threshold:
                    rocks[e, i] = GOOD if good[o, i] else DISMISSED
        nearest = -1
        for i in range(distance.shape[1]):
            candidate = rocks[e, i] != DISMISSED and accuracy[v, i] > threshold
            if check < 0 and rocks[e, i] == OPEN and distance[v, i] == 0:
                candidate = False
            if candidate and (nearest < 0 or distance[v, i] < distance[v, nearest]):
                nearest = i
        if nearest < 0:
            actions[e] = right
        elif rocks[e, nearest] == OPEN and check >= 0:
            actions[e] = check + nearest
            checked[e] = nearest
        else:
            actions[e] = toward[v, nearest]
            if actions[e] == sample:
                rocks[e, nearest] = DISMISSED


@compiled
def _belief_act(
    m: RockMap,
    threshold: float,
    columns: NDArray[np.int64],
    visible: NDArray[np.int32],
    marginals: NDArray[np.float64],
    done: NDArray[np.bool_],
    sampled: NDArray[np.bool_],
    actions: NDArray[np.int32],
) -> None:
    distance, toward, right, sample, check = m.distance, m.toward, m.right, m.sample, m.check
    for e in range(len(visible)):
        if done[e]:
            continue
        v = visible[e]
        nearest = -1
        for i in range(distance.shape[1]):
            candidate = not sampled[e, i] and marginals[e, columns[i]] >= 1.0 - threshold
            if check < 0 and distance[v, i] == 0 and marginals[e, columns[i]] <= threshold:
                candidate = False
            if candidate and (nearest < 0 or distance[v, i] < distance[v, nearest]):
                nearest = i
        if nearest < 0:
            actions[e] = right
        elif check < 0 or marginals[e, columns[nearest]] > threshold:
            actions[e] = toward[v, nearest]
            if actions[e] == sample:
                sampled[e, nearest] = True
        else:
            actions[e] = check + nearest
