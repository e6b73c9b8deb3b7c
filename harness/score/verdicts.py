"""Whether a value of ours reproduces a published one."""

from __future__ import annotations

import math
from typing import NamedTuple

SURE = 2.0
"""Combined standard errors from which on a difference is called one."""
TELLING = 0.05
"""What share of the published value :data:`SURE` errors may be at most, so that agreement says something: published
methods on RockSample(7, 8) lie this close together."""

REPRODUCED, NOT_REPRODUCED, UNDECIDED = "reproduced", "not reproduced", "undecided"
ATTAINABLE, UNATTAINABLE = "attainable", "not attainable"
OTHER_RULES, NOT_RUN = "other rules", "not run"
VERDICTS = (REPRODUCED, NOT_REPRODUCED, UNDECIDED, ATTAINABLE, UNATTAINABLE, OTHER_RULES, NOT_RUN)
"""What can become of a published figure; the first three where ours stands beside it, the next two where only the
optimum does."""


class Compared(NamedTuple):
    """A value of ours beside a published one."""

    verdict: str
    """One of the first three of :data:`VERDICTS`; ``undecided``: they agree, but within too wide an error to tell."""
    gap: float
    """Ours less the published value."""
    error: float
    """Of the gap: both standard errors combined; one that was not published counts as none."""


def compared(value: str, error: float, ours: float, ours_error: float) -> Compared:
    """Judge a value of ours by a published one.

    Args:
        value: as published; half a unit of its last decimal is allowed for rounding.
        error: its standard error, NaN where none was published.
        ours: our value.
        ours_error: its standard error; NaN or 0 where it is exact.
    """
    gap = ours - float(value)
    combined = math.hypot(*(0.0 if math.isnan(each) else each for each in (error, ours_error)))
    return Compared(_verdict(gap, combined, value), gap, combined)


def _verdict(gap: float, combined: float, value: str) -> str:
    if abs(gap) > SURE * combined + rounding(value):
        return NOT_REPRODUCED
    return UNDECIDED if SURE * combined > TELLING * abs(float(value)) else REPRODUCED


def within(value: str, error: float, high: float) -> str:
    """Judge a published return by an upper bound of the optimum: whether a method, whichever it is, can have earned it.

    ``value`` and ``error`` are those of :func:`compared`, ``high`` the bound.
    """
    least = float(value) - SURE * (0.0 if math.isnan(error) else error) - rounding(value)
    return ATTAINABLE if least <= high else UNATTAINABLE


def rounding(value: str) -> float:
    """Half a unit of the last decimal of a number in print."""
    return 0.5 * 10.0 ** -len(value.partition(".")[2])
