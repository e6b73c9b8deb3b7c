"""The RockSample heuristics with gates in place of their comparisons.

Their rules are those of :mod:`harness.policy.heuristic` and :mod:`harness.policy.thresholds`, decision by decision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.expectation.situations import SEEN
from harness.expectation.smooth.duals import Rows, emit, gate, ratio, room, times, weigh
from harness.model.tables import compiled, inlined
from harness.policy.heuristic import DISMISSED, GOOD, OPEN, AccuracyPolicy, BeliefPolicy, RockMap
from harness.policy.thresholds import ThresholdsPolicy


class SoftBelief:
    """:class:`harness.policy.heuristic.BeliefPolicy`: both comparisons with γ are gates.

    It remembers which rocks it has sampled.
    """

    constants = 1

    def __init__(self, policy: BeliefPolicy, columns: NDArray[np.int64]) -> None:
        """``columns``: of the rocks' beliefs in the marginals."""
        self._map, self._threshold, self._columns = policy.map, policy.threshold, columns
        self.memory = np.zeros(len(columns), dtype=np.int64)
        self.most = 2 * len(columns) + 1

    def act(self, key: NDArray[np.int64], mass: NDArray[np.float64], temperature: float) -> tuple[Rows, int]:
        """Room with what may be done, and how many rows of it are written."""
        rows = room(self.most * len(key), len(self.memory), mass.shape[1])
        order = np.argsort(self._map.distance, axis=1, kind="stable")
        return rows, _belief(self._map, order, self._threshold, self._columns, key, mass, temperature, rows)

    def watched(self, rows: Rows) -> NDArray[np.bool_]:
        """(B, K) beliefs over rocks that have been sampled are not looked at again."""
        return rows.memory == 0


class SoftAccuracy:
    """:class:`harness.policy.heuristic.AccuracyPolicy`: the comparison of λ with the sensor's accuracy is a gate.

    It remembers what it holds of every rock, and which it has just checked.
    """

    constants = 1

    def __init__(self, policy: AccuracyPolicy, columns: NDArray[np.int64]) -> None:
        """``columns``: of the rocks' beliefs in the marginals."""
        self._map, self._threshold = policy.map, policy.threshold
        self.memory = np.append(np.full(len(columns), OPEN, dtype=np.int64), -1)
        self.most = len(columns) + 1

    def act(self, key: NDArray[np.int64], mass: NDArray[np.float64], temperature: float) -> tuple[Rows, int]:
        """Room with what may be done, and how many rows of it are written."""
        rows = room(self.most * len(key), len(self.memory), mass.shape[1])
        order = np.argsort(self._map.distance, axis=1, kind="stable")
        return rows, _accuracy(self._map, order, self._threshold, key, mass, temperature, rows)

    def watched(self, rows: Rows) -> NDArray[np.bool_]:
        """(B, K) it looks at no belief."""
        return np.zeros((len(rows.action), len(self.memory) - 1), dtype=np.bool_)


class SoftThresholds:
    """:class:`harness.policy.thresholds.ThresholdsPolicy`: accept, reject, ahead and aside are gates, wait weighs.

    Whether a rock is open, and whether it is believed good, are gates of their own. The target is the open rock of
    greatest worth: softly, any of them, in proportion to the probability that it is open and no other one is open and
    worth more, where the logarithms of the worths are compared by gates too. So the return is smooth in ``wait``.
    """

    constants = 5

    def __init__(self, policy: ThresholdsPolicy, columns: NDArray[np.int64]) -> None:
        """``columns``: of the rocks' beliefs in the marginals."""
        self._map, self._columns = policy.map, columns
        self._thresholds = np.array(list(policy.thresholds.values()))
        self.memory = np.zeros(0, dtype=np.int64)
        self.most = 3 * len(columns) + 1

    def act(self, key: NDArray[np.int64], mass: NDArray[np.float64], temperature: float) -> tuple[Rows, int]:
        """Room with what may be done, and how many rows of it are written."""
        rows = room(self.most * len(key), 0, mass.shape[1])
        return rows, _thresholds(self._map, self._thresholds, self._columns, key, mass, temperature, rows)

    def watched(self, rows: Rows) -> NDArray[np.bool_]:
        """(B, K) it looks at every belief."""
        return np.ones((len(rows.action), len(self._columns)), dtype=np.bool_)


@compiled
def _belief(
    m: RockMap,
    order: NDArray[np.int64],
    threshold: float,
    columns: NDArray[np.int64],
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    temperature: float,
    rows: Rows,
) -> int:
    toward, right, sample, check = m.toward, m.right, m.sample, m.check
    rocks, count = len(columns), 0
    marginals = key.view(np.float64)[:, rocks + 1 :]
    left, chosen, way = np.empty(mass.shape[1]), np.empty(mass.shape[1]), np.empty(mass.shape[1])
    for e in range(len(key)):
        v, first, memory = key[e, rocks] // SEEN, count, key[e, :rocks].copy()
        left[:] = mass[e]
        for i in order[v]:
            if memory[i]:
                continue
            b = marginals[e, columns[i]]
            candidate, slope = gate(b - (1.0 - threshold), temperature)
            weigh(chosen, left, candidate, slope, 0)
            passed, slope = gate(1.0 - threshold - b, temperature)
            weigh(left, left, passed, -slope, 0)
            doubted, slope = gate(threshold - b, temperature)
            weigh(way, chosen, doubted, slope, 0)
            count = emit(rows, first, count, e, check + i, memory, way)
            believed, slope = gate(b - threshold, temperature)
            weigh(way, chosen, believed, -slope, 0)
            memory[i] = toward[v, i] == sample
            count = emit(rows, first, count, e, toward[v, i], memory, way)
            memory[i] = 0
        count = emit(rows, first, count, e, right, memory, left)
    return count


@compiled
def _accuracy(
    m: RockMap,
    order: NDArray[np.int64],
    threshold: float,
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    temperature: float,
    rows: Rows,
) -> int:
    toward, accuracy, right, sample, check, good = m.toward, m.accuracy, m.right, m.sample, m.check, m.good
    rocks, count = order.shape[1], 0
    left, chosen = np.empty(mass.shape[1]), np.empty(mass.shape[1])
    for e in range(len(key)):
        v, reading, first = key[e, rocks + 1] // SEEN, key[e, rocks + 1] % SEEN - 1, count
        memory = key[e, : rocks + 1].copy()
        if memory[rocks] >= 0:
            memory[memory[rocks]] = GOOD if good[reading, memory[rocks]] else DISMISSED
            memory[rocks] = -1
        left[:] = mass[e]
        for i in order[v]:
            held = memory[i]
            if held == DISMISSED:
                continue
            candidate, slope = gate(accuracy[v, i] - threshold, temperature)
            weigh(chosen, left, candidate, -slope, 0)
            passed, slope = gate(threshold - accuracy[v, i], temperature)
            weigh(left, left, passed, slope, 0)
            if held == OPEN:
                memory[rocks] = i
                count = emit(rows, first, count, e, check + i, memory, chosen)
                memory[rocks] = -1
            else:
                if toward[v, i] == sample:
                    memory[i] = DISMISSED
                count = emit(rows, first, count, e, toward[v, i], memory, chosen)
                memory[i] = held
        count = emit(rows, first, count, e, right, memory, left)
    return count


_ACCEPT, _REJECT, _AHEAD, _ASIDE, _WAIT = range(5)
_SMALLEST = 1e-9  # of what a logarithm is taken of
_TIE = 1e-6  # of logarithms of worth: what a rock of a lower number is ahead by


@compiled
def _thresholds(
    m: RockMap,
    theta: NDArray[np.float64],
    columns: NDArray[np.int64],
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    temperature: float,
    rows: Rows,
) -> int:
    distance, ahead, toward, accuracy, right, check = m.distance, m.ahead, m.toward, m.accuracy, m.right, m.check
    rocks, width, count = len(columns), mass.shape[1], 0
    marginals, memory = key.view(np.float64)[:, 1:], np.empty(0, dtype=np.int64)
    none, reached, way = np.empty(width), np.empty(width), np.empty(width)
    state, target = np.empty((rocks, 2, width)), np.empty((rocks, 2, width))
    log_worth = np.empty((rocks, 2))
    wait = max(theta[_WAIT], _SMALLEST)
    for e in range(len(key)):
        v, first = key[e, 0] // SEEN, count
        none[:] = 0.0
        none[0] = 1.0
        for i in range(rocks):
            b = marginals[e, columns[i]]
            _rock(state[i], none, b, theta, temperature)
            steps = 1.0 + distance[v, i]
            patience = np.log(max(b, _SMALLEST)) + ahead[v, i] * np.log(wait) - i * _TIE
            log_worth[i, 0] = patience - np.log(steps)
            log_worth[i, 1] = patience - np.log(1.0 + b * steps)
        times(reached, mass[e], none)
        count = emit(rows, first, count, e, right, memory, reached)
        none[:] = -none  # from here on: that some rock is open
        none[0] += 1.0
        _targets(target, state, log_worth, ahead[v], wait, temperature, none, way)
        for i in range(rocks):
            times(reached, mass[e], target[i, 0])
            count = emit(rows, first, count, e, toward[v, i], memory, reached)
            times(reached, mass[e], target[i, 1])
            which = _AHEAD if ahead[v, i] > 0 else _ASIDE
            near, slope = gate(accuracy[v, i] - theta[which], temperature)
            weigh(way, reached, near, -slope, which)
            count = emit(rows, first, count, e, check + i, memory, way)
            far, slope = gate(theta[which] - accuracy[v, i], temperature)
            weigh(way, reached, far, slope, which)
            count = emit(rows, first, count, e, toward[v, i], memory, way)
    return count


@inlined
def _rock(
    state: NDArray[np.float64], none: NDArray[np.float64], b: float, theta: NDArray[np.float64], temperature: float
) -> None:
    """(2, 1 + d) duals of a rock's being open and believed good, open and not; ``none`` times that of being neither."""
    opened, slope = gate(b - theta[_REJECT], temperature)
    state[:] = 0.0
    state[:, 0], state[:, 1 + _REJECT] = opened, -slope
    shut, slope = gate(theta[_REJECT] - b, temperature)
    weigh(none, none, shut, slope, _REJECT)
    believed, slope = gate(b - theta[_ACCEPT], temperature)
    weigh(state[0], state[0], believed, -slope, _ACCEPT)
    doubted, slope = gate(theta[_ACCEPT] - b, temperature)
    weigh(state[1], state[1], doubted, slope, _ACCEPT)


@inlined
def _targets(
    target: NDArray[np.float64],
    state: NDArray[np.float64],
    log_worth: NDArray[np.float64],
    ahead: NDArray[np.int64],
    wait: float,
    temperature: float,
    some: NDArray[np.float64],
    way: NDArray[np.float64],
) -> None:
    """(K, 2, 1 + d) duals of each rock's being the target, in each of its states; their sum is ``some``."""
    rocks, total = len(state), np.zeros(len(some))
    for i in range(rocks):
        for s in range(2):
            target[i, s] = state[i, s]
            if state[i, s, 0] == 0.0:
                continue
            for j in range(rocks):
                if j == i:
                    continue
                way[:] = 0.0
                way[0] = 1.0  # that rock j is not open and worth more
                for r in range(2):
                    if state[j, r, 0] > 0.0:
                        more, slope = gate(log_worth[j, r] - log_worth[i, s], temperature)
                        for c in range(len(way)):
                            way[c] -= state[j, r, c] * more
                        way[1 + _WAIT] -= state[j, r, 0] * slope * (ahead[j] - ahead[i]) / wait
                times(target[i, s], target[i, s], way)
            total += target[i, s]
    for i in range(rocks):
        for s in range(2):
            if total[0] > 0.0:
                ratio(target[i, s], target[i, s], total)
                times(target[i, s], target[i, s], some)
