"""What could be earned if the hidden part were seen: the upper bound of every scenario."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.indexing import strides
from harness.model.tables import Tables, compiled

MOST_STATES = 20_000_000
"""Values of the table at most: 160 MB."""
_TOLERANCE = 1e-3
_SWEEPS = 5000


def seen_through(domain: Domain) -> NDArray[np.float64]:
    """(V, H) values of the fully observed problem or a little more, by visible value and joint hidden part.

    Value iteration in place, to and fro, from 0 on; what the last sweep may be short of is added (by the contraction,
    the largest rise of a sweep times γ / (1 − γ)), so that it is an upper bound.

    Raises:
        PolicyError: the table would be too large.
    """
    if domain.n_visible * domain.n_joint > MOST_STATES:
        raise PolicyError(
            f"{domain.name} has more than {MOST_STATES:,} states, too many for the table of DESPOT's upper bound; "
            "pomcp needs none"
        )
    value = np.zeros((domain.n_visible, domain.n_joint))
    tables, stride = domain.shaped("none").tables, strides(domain.factor_sizes)
    sizes, discount = np.array(domain.factor_sizes, dtype=np.int64), float(domain.discount)
    for sweep in range(_SWEEPS):
        rise, change = _sweep(tables, stride, sizes, discount, value, sweep % 2 == 1)
        if discount * change <= _TOLERANCE * (1.0 - discount):
            break
    if rise > 0.0:
        value[~tables.terminal] += discount * rise / (1.0 - discount)
    return value


@compiled
def _sweep(
    t: Tables,
    strides: NDArray[np.int64],
    sizes: NDArray[np.int64],
    discount: float,
    value: NDArray[np.float64],
    backward: bool,
) -> tuple[float, float]:
    """One sweep in place; the largest rise, and the largest change."""
    choices, rows, outcomes, n_actions, terminal = t.choices, t.rows, t.outcomes, t.n_actions, t.terminal
    rise, change = 0.0, 0.0
    for i in range(value.shape[0]):
        v = value.shape[0] - 1 - i if backward else i
        for h in range(0 if terminal[v] else value.shape[1]):
            best = -np.inf
            for a in range(n_actions):
                row, k, stride, x = choices[v * n_actions + a].first_row, choices[v * n_actions + a].factor, 0, 0
                if k >= 0:
                    stride = strides[k]
                    x = h // stride % sizes[k]
                total = 0.0
                for j in range(rows[row + x].first, rows[row + x].last):
                    after = 0.0
                    if not outcomes[j].ends:
                        after = value[outcomes[j].visible, h + (outcomes[j].value - x) * stride]
                    total += outcomes[j].probability * (outcomes[j].reward + discount * after)
                best = max(best, total)
            rise, change = max(rise, best - value[v, h]), max(change, abs(best - value[v, h]))
            value[v, h] = best
    return rise, change
