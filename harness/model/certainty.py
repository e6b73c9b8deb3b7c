"""What is sure of a step before it is taken, whatever is hidden and whatever the draw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import Records, Tables, compiled

UNSURE = -2
"""Stands for a visible value, an observation or a word that only the draw decides."""

SURE = np.dtype(
    [
        ("visible", np.int32),  # where the step surely leads; UNSURE also where it changes or pays what is hidden
        ("observation", np.int32),  # what is surely observed, −1 for nothing
        ("told", np.int32),  # whether that is another observation than "none": 0 or 1
        ("reward", np.float64),  # what is paid where it surely leads somewhere
    ],
    align=True,
)
"""Of (visible value, action), as :data:`harness.model.tables.CHOICE`. Nothing is sure at a terminal value."""


@compiled
def sure(t: Tables, none: int) -> Records:
    """(V·A,) of :data:`SURE`; ``none`` is the observation that tells nothing, −1 where each tells something."""
    found = np.empty(len(t.choices), dtype=SURE)
    only, told = _only(t.reading_cdf), _told(t.reading_cdf, none)
    for va in range(len(found)):
        row, k = t.choices[va].first_row, t.choices[va].factor
        n = 0 if row < 0 else 1 if k < 0 else t.factor_offset[k + 1] - t.factor_offset[k]
        found[va].visible = found[va].observation = found[va].told = UNSURE
        for x in range(n):
            first, last = t.rows[row + x].first, t.rows[row + x].last
            one = last == first + 1 and (k < 0 or t.outcomes[first].value == x)
            for i in range(first, last):
                q = t.outcomes[i].reading
                o, w = (only[q], told[q]) if q >= 0 else (-1, 0)
                if x == 0 and i == first:
                    found[va].visible, found[va].reward = t.outcomes[i].visible, t.outcomes[i].reward
                    found[va].observation, found[va].told = o, w
                one &= found[va].visible == t.outcomes[i].visible and found[va].reward == t.outcomes[i].reward
                if found[va].observation != o:
                    found[va].observation = UNSURE
                if found[va].told != w:
                    found[va].told = UNSURE
            if not one:
                found[va].visible = UNSURE
    return found


@compiled
def _only(cdf: NDArray[np.float64]) -> NDArray[np.int64]:
    """The only observation with any probability, of each distribution; UNSURE where there are several."""
    found = np.full(len(cdf), UNSURE, dtype=np.int64)
    for q in range(len(cdf)):
        count, below = 0, 0.0
        for o in range(cdf.shape[1]):
            if cdf[q, o] != below:
                count += 1
                found[q] = o
            below = cdf[q, o]
        if count != 1:
            found[q] = UNSURE
    return found


@compiled
def _told(cdf: NDArray[np.float64], none: int) -> NDArray[np.int64]:
    """Whether an observation of each distribution is another than "none": 0, 1 or UNSURE."""
    found = np.full(len(cdf), 1, dtype=np.int64)
    for q in range(len(cdf)):
        if none >= 0 and cdf[q, none] != (cdf[q, none - 1] if none > 0 else 0.0):
            last = cdf.shape[1] - 1
            others = cdf[q, none] != cdf[q, last] or (none > 0 and cdf[q, none - 1] != 0.0)
            found[q] = UNSURE if others else 0
    return found
