"""One step of a layer of situations: every visible value and reading that can come next, with the belief after it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.expectation.situations import SEEN
from harness.model.indexing import spans
from harness.model.tables import STOP, Records, Sensors, Tables, compiled, inlined, normalize, update_belief


def ways(t: Tables) -> NDArray[np.int64]:
    """(V·A,) of every visible value and action, how many situations a step makes of one at most."""
    sizes = np.append(np.diff(t.factor_offset), 1)  # the last one: no factor
    rows_of = np.where(t.choices["first_row"] < 0, 0, sizes[t.choices["factor"]])
    row, choice = spans(t.choices["first_row"], rows_of)
    j, of_row = spans(t.rows["first"][row], (t.rows["last"] - t.rows["first"])[row])
    choice = choice[of_row]
    apart = t.choices["factor"][choice] < 0  # without a factor each outcome is by itself
    which = np.where(apart, j, t.outcomes["visible"][j])
    can = (t.reading_probability > 0)[t.outcomes["reading"][j]] & ~t.outcomes["ends"][j, None]
    outcome, reading = np.nonzero(can)
    different = np.unique(np.stack([choice[outcome], which[outcome], reading]), axis=1)
    combinations = 1 if t.sensors is None else t.sensors.labels.prod(dtype=np.int64)
    return np.bincount(different[0], minlength=len(t.choices)) * combinations


@compiled
def expand(
    t: Tables,
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    actions: NDArray[np.int32],
    children: NDArray[np.int64],
    weights: NDArray[np.float64],
    parents: NDArray[np.int64],
    rewards: NDArray[np.float64],
    ended: NDArray[np.float64],
) -> int:
    """Write the situations after the step to ``children``, ``weights`` and the rows they come from to ``parents``.

    There must be room for one more than :func:`ways` counts. Those that end, or stop, are left out. Returned is how
    many there are. ``rewards`` and ``ended`` (S,) take what the step of each is paid, and the probability that it ends
    the episode, both times the situation's own probability.
    """
    choices, rows, outcomes, n_actions = t.choices, t.rows, t.outcomes, t.n_actions
    probability, factor_offset = t.reading_probability, t.factor_offset
    words = key.shape[1] - factor_offset[-1]
    marginals, after = key.view(np.float64), children.view(np.float64)
    posterior, spare = np.zeros(max(1, factor_offset[-1])), np.empty(key.shape[1], dtype=np.int64)
    count = 0
    for e in range(len(key)):
        rewards[e] = ended[e] = 0.0
        if actions[e] == STOP:
            continue
        va = key[e, words - 1] // SEEN * n_actions + actions[e]
        k, first_row = choices[va].factor, choices[va].first_row
        first = words + factor_offset[k] if k >= 0 else 0
        n = factor_offset[k + 1] - factor_offset[k] if k >= 0 else 1
        for x in range(n):
            b = marginals[e, first + x] if k >= 0 else 1.0
            if b == 0.0:
                continue
            for j in range(rows[first_row + x].first, rows[first_row + x].last):
                vp, share = outcomes[j].visible, mass[e] * b * outcomes[j].probability
                rewards[e] += share * outcomes[j].reward
                if outcomes[j].ends:
                    ended[e] += share
                elif k < 0 or not _met(rows, outcomes, marginals, e, first, first_row, x, j):
                    for o in range(probability.shape[1]):
                        for c in range(key.shape[1]):
                            children[count, c] = key[e, c]
                        children[count, words - 1] = vp * SEEN + o + 1
                        weight = share * probability[outcomes[j].reading, o]
                        if k >= 0:
                            update_belief(
                                choices, rows, outcomes, probability, va, vp, o, after, count, first, n, posterior
                            )
                            weight = 0.0
                            for y in range(n):
                                weight += posterior[y]
                            weight *= mass[e]
                        if weight > 0.0 and t.sensors is None:
                            weights[count], parents[count] = weight, e
                            count += 1
                        elif weight > 0.0:
                            there = vp * n_actions + actions[e]
                            count = _sense(
                                t.sensors, factor_offset, there, weight, e, children, weights, parents, count, spare,
                                posterior,
                            )  # fmt: skip
    return count


@inlined
def _sense(
    s: Sensors | None,
    factor_offset: NDArray[np.int64],
    there: int,
    weight: float,
    e: int,
    children: NDArray[np.int64],
    weights: NDArray[np.float64],
    parents: NDArray[np.int64],
    count: int,
    before: NDArray[np.int64],
    posterior: NDArray[np.float64],
) -> int:
    """Put in place of the last situation, of which only the step's own observation is known, one for every combination
    of the sensors' labels after ``there`` (next visible value and action); how many there are then."""
    if s is not None:
        words, after, combinations = children.shape[1] - factor_offset[-1], children.view(np.float64), 1
        before[:] = children[count]
        for j in range(len(s.labels)):
            combinations *= s.labels[j]
        own = before[words - 1] - 1  # the visible value is a multiple of SEEN
        seen, own = own // SEEN * SEEN, own % SEEN
        for c in range(combinations):
            children[count] = before
            children[count, words - 1] = seen + own * combinations + c + 1
            share = weight
            for j in range(len(s.factor)):
                row, label = s.row[there, j], c // s.stride[j] % s.labels[j]
                if row < 0:
                    share *= 1.0 if label == 0 else 0.0
                else:
                    first, total = words + factor_offset[s.factor[j]], 0.0
                    n = factor_offset[s.factor[j] + 1] - factor_offset[s.factor[j]]
                    for x in range(n):
                        posterior[x] = after[count, first + x] * s.probability[row + x, label]
                        total += posterior[x]
                    normalize(posterior, n, after, count, first)
                    share *= total
            if share > 0.0:
                weights[count], parents[count] = share, e
                count += 1
    return count


@inlined
def _met(
    rows: Records,
    outcomes: Records,
    marginals: NDArray[np.float64],
    e: int,
    first: int,
    first_row: int,
    x: int,
    j: int,
) -> bool:
    """Whether an outcome before the j-th, of a possible value up to x, shows the same visible value."""
    met = False
    for y in range(x + 1):
        if marginals[e, first + y] > 0.0:
            for i in range(rows[first_row + y].first, min(j, rows[first_row + y].last)):
                if outcomes[i].visible == outcomes[j].visible:
                    met = True
    return met
