"""Which of the points that a run has visited is returned: the best on episodes that none of them has met.

A method may end worse than it began. The value of a point in the history does not say so: each is a mean over
few episodes, another iteration's over others, and the highest is a lucky one. So the start and what was visited play
validation episodes, all the same ones, and the best there is the result.

All visited points on all validation episodes would cost as much as the tuning. Most of them are far from the best, and
few episodes show that, so three in four go after each look (successive halving, Karnin et al. 2013, by fours): 256
points on 1/64 of the episodes, 64 on 1/16, 16 on 1/4, the last few and the start on all. Each look costs about as much
as four points on all episodes: some 20 in all for the largest pool, where the paper's ascent plays up to 200.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.tuning.constants import DECIMALS
from harness.tuning.method import Ask
from harness.tuning.objective import Objective
from harness.tuning.tunable import Tunable, Vector

POOL = 256
"""The most points that are compared; half of them at most are iterates, evenly over the run."""

SHRINK = 4
"""One in so many is left after a look."""

SCREEN = 100
"""The fewest episodes of a look, where there are as many."""


def rounded(subject: Tunable, theta: Vector) -> Vector:
    """Points (…, d) rounded to :data:`harness.tuning.constants.DECIMALS`, within the bounds."""
    return np.clip(np.round(theta, DECIMALS), subject.lower, subject.upper)


def candidates(subject: Tunable, history: pd.DataFrame, ended: Vector) -> Vector:
    """(n, d) the different points of a run, rounded: at most :data:`POOL`, in the order in which they win ties.

    First the start, as it was given; then where the method ended (d,), its other iterates from the last to the first,
    and the points that it asked for, the highest value first.
    """
    names = list(subject.names)
    iterates = history.drop_duplicates("iteration")[[f"theta_{name}" for name in names]].to_numpy()[::-1]
    every = -(-len(iterates) // (POOL // 2))
    asked = history.sort_values("value", ascending=False, kind="stable")[names].to_numpy()
    points = rounded(subject, np.vstack([subject.start, ended, iterates[::every], asked]))
    _, first = np.unique(points, axis=0, return_index=True)
    points[0] = subject.start
    return points[np.sort(first)[:POOL]]


def choose(played: Objective, points: Vector, episodes: int) -> int:
    """Index of the best of the points (n, d) on ``episodes`` episodes; a tie goes to the one that comes first.

    The first one, the start, is in every look, so that a tie with it is seen.
    """
    kept = np.arange(len(points))
    for looks_left in range(_looks(len(points)), 0, -1):
        means = _means(played, points[kept], max(episodes // SHRINK**looks_left, min(SCREEN, episodes)))
        best = np.argsort(-means, kind="stable")[: -(-len(kept) // SHRINK)]
        kept = np.union1d(kept[best], [0])
    return int(kept[_means(played, points[kept], episodes).argmax()])


def _looks(count: int) -> int:
    """Looks at so many points before :data:`SHRINK` of them or fewer are left, the start not counted."""
    looks = 0
    while count > SHRINK:
        count, looks = -(-count // SHRINK), looks + 1
    return looks


def _means(played: Objective, points: Vector, episodes: int) -> NDArray[np.float64]:
    means: NDArray[np.float64] = played(Ask(points, np.zeros(len(points), dtype=np.int64), episodes)).mean(axis=1)
    return means
