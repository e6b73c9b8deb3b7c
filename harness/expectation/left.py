"""What situations that were not expanded can still earn: at most with all observed, at least by the worst luck."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import joint
from harness.expectation.situations import Layer, visible_of
from harness.model.domain import Domain
from harness.model.tables import Tables, compiled

_MOST = 20_000_000
"""Values of a state and step together that are worth a table; above it the hidden part is taken as at its best."""
_CHUNK = 4_096  # situations whose joint beliefs are made at a time


class Prospects:
    """Bounds of what can be earned from a step on, for one discount."""

    def __init__(self, domain: Domain, horizon: int, discount: float) -> None:
        """Nothing is computed before it is asked for."""
        self._domain, self._horizon, self._discount = domain, horizon, discount
        self._most: NDArray[np.float64] | None = None
        self._least: NDArray[np.float64] | None = None

    def of(self, layer: Layer, step: int) -> tuple[float, float]:
        """Least and most that the situations of a layer earn after ``step`` steps, weighted by their mass."""
        domain = self._domain
        if self._most is None or self._least is None:
            self._least = _worst(domain.tables, self._horizon, self._discount)
            self._most = (
                _observed(domain.tables, _values(domain), self._horizon, self._discount)
                if domain.n_visible * domain.n_joint * self._horizon <= _MOST
                else -_worst(_negated(domain.tables), self._horizon, self._discount)[..., None]
            )
        words = layer.key.shape[1] - domain.n_marginals
        visible = visible_of(layer.key[:, words - 1])
        left = self._horizon - step
        most = 0.0
        for first in range(0, len(visible), _CHUNK):
            part = slice(first, first + _CHUNK)
            values = self._most[left, visible[part]]
            if values.shape[1] > 1:
                marginals = np.ascontiguousarray(layer.key[part, words:]).view(np.float64)
                values = values * joint(domain, marginals)
            most += float((layer.mass[part] * values.sum(axis=1)).sum())
        weight = self._discount**step
        return weight * float((layer.mass * self._least[left, visible]).sum()), weight * most


def _negated(t: Tables) -> Tables:
    outcomes = t.outcomes.copy()
    outcomes["reward"] *= -1
    return t._replace(outcomes=outcomes)


def _values(domain: Domain) -> NDArray[np.int64]:
    """(H, K) the values of the factors in every joint value, the last factor varying fastest."""
    if not domain.factors:
        return np.zeros((1, 0), dtype=np.int64)
    return np.stack(np.unravel_index(np.arange(domain.n_joint), domain.factor_sizes), axis=1).astype(np.int64)


@compiled
def _worst(t: Tables, horizon: int, discount: float) -> NDArray[np.float64]:
    """(T + 1, V) with so many steps left, the least that the worst action and the worst luck earn; 0 by stopping."""
    V, A = len(t.terminal), t.n_actions
    value = np.zeros((horizon + 1, V))
    for left in range(1, horizon + 1):
        for v in range(V):
            least = 0.0
            for a in range(A):
                row, k = t.choices[v * A + a].first_row, t.choices[v * A + a].factor
                n = 1 if k < 0 else t.factor_offset[k + 1] - t.factor_offset[k]
                if row >= 0:
                    for j in range(t.rows[row].first, t.rows[row + n - 1].last):
                        least = min(least, t.outcomes[j].reward + discount * value[left - 1, t.outcomes[j].visible])
            value[left, v] = least
    return value


@compiled
def _observed(t: Tables, values: NDArray[np.int64], horizon: int, discount: float) -> NDArray[np.float64]:
    """(T + 1, V, H) with so many steps left, the most that can be earned when everything is observed; 0 by stopping."""
    V, A, H = len(t.terminal), t.n_actions, len(values)
    stride = np.ones(values.shape[1], dtype=np.int64)
    for k in range(values.shape[1] - 2, -1, -1):
        stride[k] = stride[k + 1] * (t.factor_offset[k + 2] - t.factor_offset[k + 1])
    value = np.zeros((horizon + 1, V, H))
    for left in range(1, horizon + 1):
        for v in range(V):
            for a in range(A):
                row, k = t.choices[v * A + a].first_row, t.choices[v * A + a].factor
                if row < 0:
                    continue
                for h in range(H):
                    here = row if k < 0 else row + values[h, k]
                    total = 0.0
                    for j in range(t.rows[here].first, t.rows[here].last):
                        after = h if k < 0 else h + (t.outcomes[j].value - values[h, k]) * stride[k]
                        later = 0.0 if t.outcomes[j].ends else value[left - 1, t.outcomes[j].visible, after]
                        total += t.outcomes[j].probability * (t.outcomes[j].reward + discount * later)
                    value[left, v, h] = max(value[left, v, h], total)
    return value
