"""When is a mean return worse than a stored one? Welch's test, and what it can catch after Holm's correction.

Pure functions of means, standard errors and counts; nothing here knows a policy or a file.

Both sides of a test have the same number of episodes: the difference of two such means is symmetric when nothing has
changed, so that skewed returns (a rare success, a rare penalty) leave the error rate as stated.
"""

from __future__ import annotations

import math

from scipy.special import ndtri, stdtr, stdtrit

FALSE_ALARM = 0.001
"""Probability, at most, that a check of unchanged code fails, over the whole list."""

MIN_EFFECT = 0.05
"""Return units: a true drop up to this size counts as unchanged."""

DROP = 1.0
"""Return units: the drop that the stored scores are given enough episodes to catch."""

POWER = 0.9999
"""Probability, at least, that a drop of that size is caught, as far as the episodes allow."""


def welch(stored: tuple[float, float, int], new: tuple[float, float, int], min_effect: float = MIN_EFFECT) -> float:
    """One-sided p-value of "the new mean is not lower than the stored one by more than ``min_effect``".

    Welch, B. L. (1947), Biometrika 34, with the minimal effect as the margin of the null hypothesis. Where neither
    side varies (a deterministic policy) there is nothing to estimate: 0 for a larger drop, else 1.

    Args:
        stored: mean, standard error of the mean, number of episodes (2 or more).
        new: the same for the new score.
        min_effect: in return units.
    """
    drop = stored[0] - new[0] - min_effect
    error = math.hypot(stored[1], new[1])
    if error == 0:
        return 0.0 if drop > 0 else 1.0
    return float(stdtr(_freedom(stored[1], stored[2], new[1], new[2]), -drop / error))


def _freedom(sem_a: float, n_a: int, sem_b: float, n_b: int) -> float:
    """Degrees of freedom after Welch and Satterthwaite; ratios, so that tiny errors do not underflow."""
    share = sem_a**2 / (sem_a**2 + sem_b**2)
    return 1 / (share**2 / (n_a - 1) + (1 - share) ** 2 / (n_b - 1))


def smallest_drop(
    sem: float,
    episodes: int,
    family: int,
    *,
    false_alarm: float = FALSE_ALARM,
    min_effect: float = MIN_EFFECT,
    power: float = POWER,
) -> float:
    """Smallest true drop of the mean (return units) that a check catches with probability ``power``.

    Args:
        sem: standard error of each of the two means.
        episodes: behind each of them, 2 or more.
        family: tests in the list; Holm's first and strictest step is what is reckoned with.
        false_alarm: over the whole list.
        min_effect: margin of the null hypothesis, in return units.
        power: the probability.
    """
    critical = -float(stdtrit(2 * (episodes - 1), false_alarm / family))
    return min_effect + (critical + float(ndtri(power))) * math.sqrt(2) * sem


def episodes_needed(
    deviation: float,
    family: int,
    *,
    drop: float = DROP,
    false_alarm: float = FALSE_ALARM,
    min_effect: float = MIN_EFFECT,
    power: float = POWER,
) -> int:
    """Episodes on either side that make :func:`smallest_drop` equal ``drop`` (normal approximation).

    ``deviation`` is the standard deviation of a single return; 0 for a deterministic policy, which needs 1 episode.
    """
    quantiles = float(ndtri(power)) - float(ndtri(false_alarm / family))
    return max(1, math.ceil(2 * (quantiles * deviation / (drop - min_effect)) ** 2))
