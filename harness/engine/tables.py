"""The embedded engine: steps the exported tables in compiled loops, without Julia."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.arrays import EngineArrays
from harness.model.domain import Domain
from harness.model.tables import (
    STOP,
    Tables,
    compiled,
    draw_labels,
    draw_outcome,
    draw_reading,
    draw_start,
    normalize,
    row_of,
    update_belief,
    update_sensed,
)


class TablesEngine(EngineArrays):
    """See :class:`harness.engine.Engine` for the contract."""

    def __init__(self, domain: Domain, size: int, track_belief: bool) -> None:
        """An engine for ``size`` episodes; without ``track_belief`` the marginals stay (E, 0)."""
        super().__init__(domain, size, track_belief)
        self.values = np.zeros((size, len(domain.factors)), dtype=np.int16)
        """(E, K) the hidden part."""
        self._scratch = np.zeros(max(domain.factor_sizes, default=1))

    def reset(self, u: NDArray[np.float64]) -> None:
        """Start all episodes."""
        self.restart(np.ones(len(u), dtype=np.bool_), u)

    def restart(self, which: NDArray[np.bool_], u: NDArray[np.float64]) -> None:
        """Start the episodes anew where ``which`` (E,) is True; ``u`` (E,) counts there only."""
        _reset(
            self.domain.tables,
            which,
            u,
            self.visible,
            self.values,
            self.observation,
            self.done,
            self.marginals,
            self._scratch,
        )

    def step(self, actions: NDArray[np.int32], u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Apply one action an episode; returns the rewards."""
        rewards = np.empty(len(actions))
        _step(
            self.domain.tables,
            actions,
            u,
            self.visible,
            self.values,
            self.observation,
            self.done,
            self.marginals,
            self._scratch,
            rewards,
        )
        return rewards


@compiled
def _reset(
    t: Tables,
    which: NDArray[np.bool_],
    u: NDArray[np.float64],
    visible: NDArray[np.int32],
    values: NDArray[np.int16],
    observation: NDArray[np.int32],
    done: NDArray[np.bool_],
    marginals: NDArray[np.float64],
    scratch: NDArray[np.float64],
) -> None:
    start_cdf, start_visible, start_values, start_reading = (
        t.start_cdf,
        t.start_visible,
        t.start_values,
        t.start_reading,
    )
    reading_cdf, terminal = t.reading_cdf, t.terminal
    for e in range(len(visible)):
        if not which[e]:
            continue
        i, left = draw_start(start_cdf, u[e])
        visible[e] = start_visible[i]
        for k in range(values.shape[1]):
            values[e, k] = start_values[i, k]
        observation[e] = draw_reading(reading_cdf, start_reading[i], left)
        done[e] = terminal[visible[e]]
    if marginals.shape[1] > 0:
        start_beliefs(t, which, visible, observation, marginals, scratch)


@compiled
def start_beliefs(
    t: Tables,
    which: NDArray[np.bool_],
    visible: NDArray[np.int32],
    observation: NDArray[np.int32],
    marginals: NDArray[np.float64],
    posterior: NDArray[np.float64],
) -> None:
    """Initial beliefs, given the first readings (−1: none)."""
    factor_offset, probability, reading = t.factor_offset, t.reading_probability, t.prior_reading
    for e in range(len(visible)):
        if not which[e]:
            continue
        i = 0
        while t.prior_visible[i] != visible[e]:
            i += 1
        marginals[e] = t.prior_marginals[i]
        k, o = t.prior_factor[i], observation[e]
        if k < 0 or o < 0:
            continue
        first = factor_offset[k]
        n = factor_offset[k + 1] - first
        for x in range(n):
            posterior[x] = 0.0
            if marginals[e, first + x] > 0.0:
                posterior[x] = marginals[e, first + x] * probability[reading[i, x], o]
        normalize(posterior, n, marginals, e, first)


@compiled
def _step(
    t: Tables,
    actions: NDArray[np.int32],
    u: NDArray[np.float64],
    visible: NDArray[np.int32],
    values: NDArray[np.int16],
    observation: NDArray[np.int32],
    done: NDArray[np.bool_],
    marginals: NDArray[np.float64],
    scratch: NDArray[np.float64],
    rewards: NDArray[np.float64],
) -> None:
    choices, rows, outcomes, n_actions = t.choices, t.rows, t.outcomes, t.n_actions
    reading_cdf, reading_probability, factor_offset = t.reading_cdf, t.reading_probability, t.factor_offset
    track, sensors = marginals.shape[1] > 0, t.sensors
    for e in range(len(visible)):
        rewards[e] = 0.0
        if done[e] or actions[e] == STOP:
            continue
        va = visible[e] * n_actions + actions[e]
        i, left = draw_outcome(rows, outcomes, row_of(choices, va, values, e), u[e])
        o = draw_reading(reading_cdf, outcomes[i].reading, left)
        k = choices[va].factor
        if k >= 0:
            values[e, k] = outcomes[i].value
        rewards[e] = outcomes[i].reward
        visible[e] = outcomes[i].visible
        observation[e] = o
        done[e] = outcomes[i].ends
        if track and k >= 0:
            start = factor_offset[k]
            n = factor_offset[k + 1] - start
            update_belief(
                choices, rows, outcomes, reading_probability, va, visible[e], o, marginals, e, start, n, scratch
            )
        if sensors is not None:
            va, q = visible[e] * n_actions + actions[e], outcomes[i].reading
            o = draw_labels(sensors, reading_probability, reading_cdf, q, o, left, va, values, e)
            observation[e] = o
            if track:
                update_sensed(sensors, factor_offset, va, o, marginals, e, scratch)
