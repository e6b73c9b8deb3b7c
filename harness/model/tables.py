"""A domain as arrays, and the compiled verbs on one episode that the engine and the planners share.

The arrays are exported by the Julia package (``julia/src/tables.jl`` documents them one by one); nothing about any
domain is written here. For visible value v and action a, one hidden factor at most is relevant; its value x picks the
row that owns the possible outcomes. Then *sensors* may read hidden factors unasked, each one factor by a distribution
of its own, and what is observed is the step's own observation together with the labels of all sensors. All indices are
0-based.

What an episode touches at a step lies together in three record arrays, and the verbs take these, never the whole
:class:`Tables`: Numba counts references to every field of a tuple that is passed on, which costs more than the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numba.core.options import DefaultOptions
from numpy.typing import NDArray

from harness.model.caching import cache_folder
from harness.model.indexing import strides

_F = TypeVar("_F")
Records = NDArray[Any]


_UNCOUNTED = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def compiled(function: _F) -> _F:
    """Numba, without the GIL, cached on disk. No fast-math: results must be the same everywhere, bit for bit."""
    return _jitted(function)


def inlined(function: _F) -> _F:
    """The same for the small verbs that compiled loops call once an episode."""
    return _jitted(function, forceinline=True)


def lean(function: _F) -> _F:
    """The same where no array is made: references are not counted, which in short functions of many arrays is half the
    time. The option is Numba's own and may go; what it saves goes with it."""
    return _jitted(function, forceinline=True, **_UNCOUNTED)


def _jitted(function: _F, **options: Any) -> _F:
    with cache_folder() as cached:
        jitted: Any = numba.njit(nogil=True, cache=cached, **options)(function)
    return jitted


STOP = -1
"""The action of a policy that has come to its end: the episode stays as it is and is paid nothing more."""

CHOICE = np.dtype([("first_row", np.int32), ("factor", np.int16)], align=True)
"""Of (visible value, action): its first row (−1 where terminal) and its relevant hidden factor (−1 for none)."""
ROW = np.dtype([("first", np.int32), ("last", np.int32), ("legal", np.bool_)], align=True)
"""Of (visible value, action, value of the relevant factor): its outcomes ``first … last − 1``; whether it is legal."""
OUTCOME = np.dtype(
    [
        ("visible", np.int32),
        ("value", np.int16),  # next value of the relevant factor
        ("ends", np.bool_),  # whether the next visible value is terminal
        ("reading", np.int32),  # row of the observation distributions
        ("probability", np.float64),
        ("cdf", np.float64),  # running sum of the probabilities in the row
        ("reward", np.float64),  # of the shaping in use
    ],
    align=True,
)
"""Of one way that a step can go: what is visible next, what becomes of the relevant factor, and what is paid."""


class Sensors(NamedTuple):
    """What is read unasked, after every step: J sensors, each of one hidden factor, independent given the state.

    An observation is a combination of the step's own one and the labels of the sensors, the last running fastest:
    ``own · combinations + Σ label · stride``. A domain that has none has None in place of this, by whose type Numba
    leaves out of compiled code whatever is about sensors.
    """

    factor: NDArray[np.int16]
    """(J,) the factor that it reads"""
    labels: NDArray[np.int32]
    """(J,) how many labels it has"""
    stride: NDArray[np.int64]
    """(J,) of its label in the observation"""
    row: NDArray[np.int32]
    """(V·A, J) of (next visible value, action): its distribution where the factor has value 0, those of the others
    following; −1 where the visible value is terminal, at which all labels are 0"""
    probability: NDArray[np.float64]
    """(distributions, most labels)"""
    cdf: NDArray[np.float64]
    """(distributions, most labels) their running sums"""


class Tables(NamedTuple):
    """The model as arrays. V visible values, A actions, O own observations of steps, K hidden factors, N all their
    values."""

    n_actions: int
    factor_offset: NDArray[np.int64]
    """(K + 1,) position of each factor's values in the concatenated marginals; the last entry is N."""
    choices: Records
    """(V·A,) of :data:`CHOICE`; the entry of (v, a) is v·A + a."""
    rows: Records
    """(rows,) of :data:`ROW`."""
    outcomes: Records
    """(outcomes,) of :data:`OUTCOME`."""
    reading_probability: NDArray[np.float64]
    """(distributions, O) the different observation distributions."""
    reading_cdf: NDArray[np.float64]
    """(distributions, O) their running sums."""
    terminal: NDArray[np.bool_]
    """(V,)"""
    start_visible: NDArray[np.int32]
    start_values: NDArray[np.int16]
    """(starts, K)"""
    start_cdf: NDArray[np.float64]
    start_reading: NDArray[np.int32]
    """(starts,) distribution of the first reading; −1 for none."""
    prior_visible: NDArray[np.int32]
    prior_marginals: NDArray[np.float64]
    """(len(prior_visible), N) belief before the first reading."""
    prior_factor: NDArray[np.int16]
    """Factor that the first reading tells of; −1 for none."""
    prior_reading: NDArray[np.int32]
    """(len(prior_visible), longest factor) distribution of the first reading for each value of that factor."""
    sensors: Sensors | None


def from_arrays(
    arrays: Mapping[str, NDArray[Any]],
    n_actions: int,
    factor_offset: NDArray[np.int64],
    shaping: int,
    sensors: Sequence[tuple[int, int]],
) -> Tables:
    """The exported arrays (``julia/src/tables.jl``) as compiled code takes them, with the reward of a shaping.

    ``sensors``: factor and number of labels of each.
    """
    choices = np.zeros(len(arrays["first_row"]), CHOICE)
    choices["first_row"], choices["factor"] = arrays["first_row"], arrays["factor"]
    rows = np.zeros(len(arrays["legal"]), ROW)
    rows["first"], rows["last"] = arrays["row_outcomes"][:-1], arrays["row_outcomes"][1:]
    rows["legal"] = arrays["legal"]
    outcomes = np.zeros(len(arrays["outcome_visible"]), OUTCOME)
    for name in ("visible", "value", "probability", "cdf"):
        outcomes[name] = arrays[f"outcome_{name}"]
    outcomes["reading"] = arrays["outcome_observation"]
    outcomes["reward"] = arrays["outcome_reward"][shaping]
    outcomes["ends"] = arrays["terminal"][arrays["outcome_visible"]]
    return Tables(
        n_actions,
        factor_offset,
        choices,
        rows,
        outcomes,
        arrays["observation_probability"],
        arrays["observation_cdf"],
        arrays["terminal"],
        arrays["start_visible"],
        arrays["start_values"],
        arrays["start_cdf"],
        arrays["start_observation"],
        arrays["prior_visible"],
        arrays["prior_marginals"],
        arrays["prior_factor"],
        arrays["prior_observation"],
        _sensors(arrays, sensors),
    )


def _sensors(arrays: Mapping[str, NDArray[Any]], sensors: Sequence[tuple[int, int]]) -> Sensors | None:
    if not sensors:
        return None
    factor, labels = np.array(sensors).T
    return Sensors(
        factor.astype(np.int16),
        labels.astype(np.int32),
        strides(labels),
        arrays["sensor_row"],
        arrays["sensor_probability"],
        arrays["sensor_cdf"],
    )


@inlined
def row_of(choices: Records, va: int, values: NDArray[np.int16], e: int) -> int:
    """Row of choice ``va`` for episode ``e``, whose hidden factors have ``values[e]``."""
    row = choices[va].first_row
    k = choices[va].factor
    return row if k < 0 else row + values[e, k]


@inlined
def draw_outcome(rows: Records, outcomes: Records, row: int, u: float) -> tuple[int, float]:
    """Outcome of a row at the uniform number ``u`` (inverse CDF; the last one if rounding leaves none), and what is
    left of ``u``: its place within the outcome's share, uniform again and independent of the outcome."""
    i, last = rows[row].first, rows[row].last - 1
    if i == last:
        return i, u
    below = 0.0
    while i < last and u >= outcomes[i].cdf:
        below = outcomes[i].cdf
        i += 1
    return i, (u - below) / outcomes[i].probability


@inlined
def draw_reading(cdf: NDArray[np.float64], q: int, u: float) -> int:
    """Observation of distribution ``q`` at the uniform number ``u``; −1 for no distribution."""
    if q < 0:
        return -1
    last = cdf.shape[1] - 1
    o = 0
    while o < last and u >= cdf[q, o]:
        o += 1
    while o > 0 and cdf[q, o] == cdf[q, o - 1]:  # rounding left none: the last one with any probability
        o -= 1
    return o


@inlined
def draw_labels(
    s: Sensors | None,
    reading_probability: NDArray[np.float64],
    reading_cdf: NDArray[np.float64],
    q: int,
    o: int,
    u: float,
    va: int,
    values: NDArray[np.int16],
    e: int,
) -> int:
    """The observation of episode ``e``: what the sensors read after ``va`` (next visible value and action), together
    with the step's own observation ``o``, which came of distribution ``q`` at ``u``. What each draw leaves of the
    number goes to the next one."""
    if s is not None:
        left = _left(reading_probability, reading_cdf, q, o, u)
        for j in range(len(s.factor)):
            label, row = 0, s.row[va, j]
            if row >= 0:
                row += values[e, s.factor[j]]
                label = draw_reading(s.cdf, row, left)
                left = _left(s.probability, s.cdf, row, label, left)
            o = o * s.labels[j] + label
    return o


@inlined
def _left(probability: NDArray[np.float64], cdf: NDArray[np.float64], q: int, o: int, u: float) -> float:
    """What is left of ``u`` after it gave observation ``o`` of distribution ``q``."""
    below = cdf[q, o - 1] if o > 0 else 0.0
    return (u - below) / probability[q, o]


@inlined
def draw_start(cdf: NDArray[np.float64], u: float) -> tuple[int, float]:
    """Entry of the initial distribution at the uniform number ``u``, and what is left of ``u``."""
    low, high = 0, len(cdf) - 1
    while low < high:
        middle = (low + high) // 2
        if u < cdf[middle]:
            high = middle
        else:
            low = middle + 1
    below = 0.0 if low == 0 else cdf[low - 1]
    return low, (u - below) / (cdf[low] - below)


@inlined
def normalize(posterior: NDArray[np.float64], n: int, marginals: NDArray[np.float64], e: int, first: int) -> None:
    """Divide by the total and store at ``marginals[e, first:]``; an impossible observation leaves the belief as it was.

    The sums run in index order and a two-valued factor keeps one free number, as in ``julia/src/updater.jl``.
    """
    total = 0.0
    for x in range(n):
        total += posterior[x]
    if total > 0.0:
        for x in range(n):
            marginals[e, first + x] = posterior[x] / total
        if n == 2:
            marginals[e, first] = 1.0 - marginals[e, first + 1]


@inlined
def update_belief(
    choices: Records,
    rows: Records,
    outcomes: Records,
    reading_probability: NDArray[np.float64],
    va: int,
    vp: int,
    o: int,
    marginals: NDArray[np.float64],
    e: int,
    first: int,
    n: int,
    posterior: NDArray[np.float64],
) -> None:
    """Bayes' rule in place after choice ``va`` led episode ``e`` to visible value ``vp`` and observation ``o``.

    ``marginals[e]`` (N,) is the belief over the hidden factors; the relevant factor's n values begin at ``first``.
    ``posterior`` is scratch space as long as a factor. (One way out, no early return: only then does Numba drop the
    counting of references, which takes several times as long as the update.)
    """
    for x in range(n):
        posterior[x] = 0.0
    for x in range(n):
        b = marginals[e, first + x]
        if b > 0.0:
            row = choices[va].first_row + x
            for j in range(rows[row].first, rows[row].last):
                if outcomes[j].visible == vp:
                    likelihood = reading_probability[outcomes[j].reading, o]
                    posterior[outcomes[j].value] += b * outcomes[j].probability * likelihood
    normalize(posterior, n, marginals, e, first)


@inlined
def update_sensed(
    s: Sensors | None,
    factor_offset: NDArray[np.int64],
    va: int,
    o: int,
    marginals: NDArray[np.float64],
    e: int,
    posterior: NDArray[np.float64],
) -> None:
    """Bayes' rule in place for what the sensors read after ``va`` (next visible value and action), one after the
    other; ``o`` is the whole observation. Comes after :func:`update_belief` of the step's own one."""
    if s is not None:
        for j in range(len(s.factor)):
            row, label = s.row[va, j], o // s.stride[j] % s.labels[j]
            if row >= 0:
                first = factor_offset[s.factor[j]]
                n = factor_offset[s.factor[j] + 1] - first
                for x in range(n):
                    posterior[x] = marginals[e, first + x] * s.probability[row + x, label]
                normalize(posterior, n, marginals, e, first)


@inlined
def is_legal(
    choices: Records, rows: Records, factor_offset: NDArray[np.int64], va: int, marginals: NDArray[np.float64], e: int
) -> bool:
    """Whether choice ``va`` costs no illegal-move penalty in any state that the belief holds possible."""
    row, k = choices[va].first_row, choices[va].factor
    legal = row >= 0
    if legal and k < 0:
        legal = rows[row].legal
    elif legal:
        first = factor_offset[k]
        for x in range(factor_offset[k + 1] - first):
            if marginals[e, first + x] > 0.0 and not rows[row + x].legal:
                legal = False
    return legal
