"""The verdicts: every row measured, all rows judged together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from harness.regression import computing
from harness.regression.rows import AnyScore, Limits, Row, StoredExact, StoredScore
from harness.regression.scoring import Measurement
from harness.regression.statistics import smallest_drop, welch
from harness.score.paired import holm

Verdict = Literal[
    "same", "changed", "not worse", "better", "worse", "differs", "unscored", "incomparable", "damaged", "vanished"
]
PASSED = ("same", "changed", "not worse", "better")
"""Verdicts that leave the exit status 0."""


@dataclass(frozen=True)
class Outcome:
    """The verdict on a row, with what it rests on."""

    row: Row
    verdict: Verdict
    level: str
    """``exact``: every episode came out as stored, or expected returns were computed, if only as an ``interval``;
    ``statistical``: by Welch's test; empty: nothing was compared."""
    stored: AnyScore | None = None
    fresh: AnyScore | None = None
    p: float = 1.0
    """Of the one-sided test for a drop, corrected for the number of rows; 0 or 1 where nothing was sampled."""
    smallest_drop: float | None = None
    """The smallest true drop (return units) that the row's test catches with the power that the limits give.

    None where nothing was compared, and where all returns were equal: any drop of all of them by more than the minimal
    effect is caught then, but nothing is known of how a drop of some of them would spread."""
    reason: str = ""
    """Where nothing was compared: why, and what to do."""
    line: int = 1
    """In the file of scores."""
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether it leaves the exit status 0."""
        return self.verdict in PASSED

    @property
    def change(self) -> float | None:
        """New mean return less the stored one."""
        return self.fresh.mean - self.stored.mean if self.fresh and self.stored else None


@dataclass(frozen=True)
class ScoreCheck:
    """A whole check: the outcomes of a file's rows, and by which limits they were judged."""

    path: Path
    limits: Limits
    outcomes: tuple[Outcome, ...]
    """One a row, in order, then one for every stored score whose row has vanished from the list."""

    @property
    def passed(self) -> bool:
        """Whether no row failed."""
        return all(outcome.passed for outcome in self.outcomes)


def judge(
    measurements: Sequence[Measurement], limits: Limits, family: int | None = None, exact: bool = False
) -> list[Outcome]:
    """Verdicts on rows that have been played.

    Args:
        measurements: the rows.
        limits: error rate over the family, and the minimal effect.
        family: rows in the whole list; by default those given.
        exact: an episode that came out otherwise fails its row.
    """
    total = max(1, len(measurements) if family is None else family)
    drops = holm([_p_value(m, limits.min_effect) for m in measurements], total)
    gains = holm([_p_value(m, limits.min_effect, gain=True) for m in measurements], total)
    return [_outcome(m, p, gain, limits, total, exact) for m, p, gain in zip(measurements, drops, gains, strict=True)]


def _p_value(measurement: Measurement, min_effect: float, gain: bool = False) -> float:
    old, new = measurement.stored, measurement.fresh
    if old is None or new is None:
        return 1.0
    before, after = (new, old) if gain else (old, new)
    if isinstance(before, StoredScore) and isinstance(after, StoredScore):
        return welch(before.summary, after.summary, min_effect)
    assert isinstance(before, StoredExact)
    assert isinstance(after, StoredExact)
    return 0.0 if computing.drop(before, after) > min_effect else 1.0


def _outcome(m: Measurement, p: float, gain: float, limits: Limits, family: int, exact: bool) -> Outcome:
    if m.fault is not None or m.stored is None or m.fresh is None:
        name, reason = m.fault or ("unscored", "")
        return Outcome(m.row, cast(Verdict, name), "", m.stored, reason=reason, seconds=m.seconds)
    verdict = _verdict(m.equal, p <= limits.false_alarm, gain <= limits.false_alarm, exact)
    catches = _catches(m.stored, m.fresh, limits, family)
    return Outcome(m.row, verdict, _level(m.fresh, m.equal), m.stored, m.fresh, p, catches, seconds=m.seconds)


def _level(fresh: AnyScore, equal: bool | None) -> str:
    if isinstance(fresh, StoredExact):
        return fresh.how
    return "exact" if equal else "statistical"


def _catches(stored: AnyScore, fresh: AnyScore, limits: Limits, family: int) -> float | None:
    sem = max(stored.sem, fresh.sem)
    if sem == 0 or not isinstance(stored, StoredScore):
        return None
    return smallest_drop(
        sem,
        stored.reference_episodes,
        family,
        false_alarm=limits.false_alarm,
        min_effect=limits.min_effect,
        power=limits.power,
    )


def _verdict(equal: bool | None, dropped: bool, gained: bool, exact: bool) -> Verdict:
    if equal:
        return "same"
    if dropped:
        return "worse"
    if exact:
        return "differs"
    if gained:
        return "better"
    return "not worse" if equal is None else "changed"
