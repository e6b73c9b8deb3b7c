"""What may follow an action, as a solver needs it: expected rewards, and Bayes' rule as one small matrix a branch.

For visible value v, action a and the factor k that the step touches (n values; n = 1 where it touches none), a *branch*
is a next visible value v' with a reading o. Its matrix M, ``M[x', x] = Pr(v', x', o | v, x, a)``, sends the factor's
belief b to the unnormalised posterior M·b, whose sum is the branch's probability. The other factors stay as they are.
What sensors read is left out, which only makes policies know less: what they earn so is a lower bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.tables import Records, Tables, compiled

BRANCH = np.dtype([("visible", np.int32), ("reading", np.int32), ("ends", np.bool_), ("matrix", np.int64)], align=True)
"""One branch; ``matrix`` is where its (n, n) matrix begins, row by row."""


class Branches(NamedTuple):
    """A domain by branches. V visible values, A actions, K factors, N values of all factors together."""

    discount: float
    n_visible: int
    n_actions: int
    factor_offset: NDArray[np.int64]
    """(K + 1,) as in :class:`harness.model.tables.Tables`."""
    factor: NDArray[np.int16]
    """(V·A,) the factor that a choice touches, −1 for none."""
    first_row: NDArray[np.int32]
    """(V·A,) where the rewards of a choice begin; −1 where the visible value is terminal."""
    reward: NDArray[np.float64]
    """(rows,) expected reward, one entry a value of the factor that the choice touches."""
    first_branch: NDArray[np.int64]
    """(V·A + 1,) the branches of choice va are ``first_branch[va] … first_branch[va + 1] − 1``."""
    branch: Records
    """(branches,) of :data:`BRANCH`."""
    matrix: NDArray[np.float64]
    """All matrices, one after the other."""


def branches_of(domain: Domain) -> Branches:
    """The branches of a domain under its true reward."""
    tables = domain.shaped("none").tables
    reward, first_branch, visible, reading, start, matrix = _branches(tables)
    branch = np.zeros(len(visible), BRANCH)
    branch["visible"], branch["reading"], branch["matrix"] = visible, reading, start
    branch["ends"] = tables.terminal[visible]
    return Branches(
        float(domain.discount),
        domain.n_visible,
        domain.n_actions,
        domain.factor_offset,
        np.ascontiguousarray(tables.choices["factor"]),
        np.ascontiguousarray(tables.choices["first_row"]),
        reward,
        first_branch,
        branch,
        matrix,
    )


@compiled
def _branches(
    t: Tables,
) -> tuple[
    NDArray[np.float64], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.int64], NDArray[np.float64]
]:
    choices, rows, outcomes, reading_probability = t.choices, t.rows, t.outcomes, t.reading_probability
    offset, n_readings = t.factor_offset, t.reading_probability.shape[1]
    reward = np.zeros(len(rows))
    for r in range(len(rows)):
        for j in range(rows[r].first, rows[r].last):
            reward[r] += outcomes[j].probability * outcomes[j].reward
    first_branch = np.zeros(len(choices) + 1, dtype=np.int64)
    visible = [np.int32(0) for _ in range(0)]
    reading = [np.int32(0) for _ in range(0)]
    start = [np.int64(0) for _ in range(0)]
    matrix = [0.0 for _ in range(0)]
    slot = np.full((len(t.terminal), n_readings), -1, dtype=np.int64)  # of this choice: branch of (v', o)
    for va in range(len(choices)):
        k, row = choices[va].factor, choices[va].first_row
        n = 1 if k < 0 else offset[k + 1] - offset[k]
        begin = len(visible)
        for x in range(n if row >= 0 else 0):
            for j in range(rows[row + x].first, rows[row + x].last):
                for o in range(n_readings):
                    q, v = outcomes[j].reading, outcomes[j].visible
                    # Without a reading there is one branch for the visible value, under reading 0.
                    likelihood = reading_probability[q, o] if q >= 0 else (1.0 if o == 0 else 0.0)
                    p = outcomes[j].probability * likelihood
                    if p > 0.0:
                        if slot[v, o] < begin:
                            slot[v, o] = len(visible)
                            visible.append(np.int32(v))
                            reading.append(np.int32(o if q >= 0 else -1))
                            start.append(np.int64(len(matrix)))
                            matrix.extend([0.0] * (n * n))
                        xp = outcomes[j].value if k >= 0 else 0
                        matrix[start[slot[v, o]] + xp * n + x] += p
        first_branch[va + 1] = len(visible)
    return reward, first_branch, np.array(visible), np.array(reading), np.array(start), np.array(matrix)
