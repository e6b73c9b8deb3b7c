"""Is one policy better than another? Differences over the episodes that both have met, and what chance makes of them.

Policies scored under one seed meet the same initial states and the same random numbers, so that most of the scatter of
their returns is common to both and leaves the difference: its error is smaller than those of the two means suggest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from harness.play.evaluation import mean_and_sem


class Paired(NamedTuple):
    """How the returns of one policy differ from those of another in the same episodes."""

    pairs: int
    """Episodes that both have met."""
    difference: float
    """Mean return less the other's, in return units."""
    sem: float
    """Standard error of the difference."""
    improvement: float
    """Probability that an episode earns more than it does by the other policy; ties count half."""
    p_value: float
    """Two-sided, of "both have the same mean"; not adjusted."""


def paired(returns: NDArray[np.float64], others: NDArray[np.float64]) -> Paired:
    """Compare the returns of two policies, entry k of both being of the same episode.

    Args:
        returns: one an episode.
        others: of the policy compared with; where one array is longer, what it has more of is left out.
    """
    count = min(len(returns), len(others))
    gaps = returns[:count] - others[:count]
    difference, sem = mean_and_sem(gaps)
    better = (1 + float(np.sign(gaps).mean())) / 2
    return Paired(count, difference, sem, better, _p_value(difference, sem, count))


def _p_value(difference: float, sem: float, count: int) -> float:
    """Student's paired test. Differences that are all alike have no scatter: then the exact test by their signs."""
    if difference == 0:
        return 1.0
    if not sem > 0:  # nor is there any of a single pair
        return 2.0 ** (1 - count)
    return 2 * float(stdtr(count - 1, -abs(difference) / sem))


def holm(p_values: Sequence[float], family: int | None = None) -> list[float]:
    """P-values corrected for testing ``family`` hypotheses at once, in the order given.

    Rejecting where the corrected value is at most α keeps the probability of any false rejection at most α, whatever
    the dependence between the tests (Holm 1979, Scandinavian Journal of Statistics 6).

    Args:
        p_values: of the tests done so far.
        family: number of tests in all, those not done included; by default as many as there are p-values.
    """
    total = len(p_values) if family is None else family
    corrected = [1.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (total - rank) * p_values[index]))
        corrected[index] = largest
    return corrected
