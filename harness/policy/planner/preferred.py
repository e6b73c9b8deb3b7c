"""Preferred actions of RockSample, after the knowledge that Silver and Veness (2010) give POMCP of the domain.

They are a rule over what has been read, like the heuristics of :mod:`harness.policy.heuristic`: how the domain moves is
not said here. A domain names its rule by the kind of its layout; where there is none, all legal actions are preferred.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.tables import inlined
from harness.policy.heuristic import rock_map

TAKEN = -10_000  # the tally of a rock that has been sampled
_MOST_READINGS, _DECIDED = 5, 2


class Preferences(NamedTuple):
    """The rule's map, by visible value (V of them) and rock (K); V is 0 where the domain has no rule."""

    here: NDArray[np.int16]
    """(V,) the rock there, −1 for none."""
    closer: NDArray[np.int32]
    """(V, K) bits of the moves that take the robot nearer to the rock."""
    weight: NDArray[np.int16]
    """(V, K) what a reading counts: 1, and enough to decide where it is sure."""
    right: int
    sample: int
    check: int
    """Action of check(1); check(i) follows in order."""
    good: int

    def __deepcopy__(self, memo: object) -> Preferences:
        """Itself: nobody writes to it."""
        return self


def names_preferred(domain: Domain) -> bool:
    """Whether there is a rule for the domain: it is about what to check, so not where all rocks are read unasked."""
    return bool(domain.layout["kind"] == "rocksample") and not domain.sensors


def preferences_of(domain: Domain, wanted: bool = True) -> Preferences:
    """The domain's rule; an empty one where it has none or none is wanted."""
    if not wanted or not names_preferred(domain):
        nothing = np.zeros((0, 0))
        return Preferences(
            np.zeros(0, dtype=np.int16), nothing.astype(np.int32), nothing.astype(np.int16), 0, 0, 0, 0
        )  # fmt: skip
    rocks = rock_map(domain)
    away = np.array(domain.layout["rocks"]) - domain.visible_values[:, None, :].astype(np.int64)
    bits = [1 << domain.action(name) for name in ("right()", "left()", "up()", "down()")]
    dx, dy = away[..., 0], away[..., 1]
    closer = sum(np.where(sign, bit, 0) for sign, bit in zip((dx > 0, dx < 0, dy > 0, dy < 0), bits, strict=True))
    on = rocks.distance == 0
    return Preferences(
        np.where(on.any(axis=1), on.argmax(axis=1), -1).astype(np.int16),
        np.asarray(closer, dtype=np.int32),
        np.where(rocks.accuracy == 1.0, _DECIDED, 1).astype(np.int16),
        rocks.right,
        rocks.sample,
        rocks.check,
        domain.observations.index("good"),
    )


@inlined
def note(
    here: NDArray[np.int16],
    weight: NDArray[np.int16],
    sample: int,
    check: int,
    good: int,
    v: int,
    a: int,
    o: int,
    tally: NDArray[np.int16],
    readings: NDArray[np.int16],
) -> None:
    """Keep count after action ``a`` at ``v`` brought observation ``o``: good less bad readings (K,), and how many."""
    if a >= check:
        tally[a - check] += weight[v, a - check] if o == good else -weight[v, a - check]
        readings[a - check] += 1
    elif a == sample and here[v] >= 0:
        tally[here[v]] = TAKEN


@inlined
def preferred(
    here: NDArray[np.int16],
    closer: NDArray[np.int32],
    right: int,
    sample: int,
    check: int,
    v: int,
    tally: NDArray[np.int16],
    readings: NDArray[np.int16],
    options: NDArray[np.int32],
) -> int:
    """Write the preferred actions to ``options`` (A,) and say how many.

    On a rock with more good than bad readings: sample. Otherwise the moves nearer to any rock that has no more bad
    readings than good ones, and to read any rock that has been read fewer than five times and is not decided; if no
    rock is left, right.
    """
    count, ways = 0, 0
    if here[v] >= 0 and tally[here[v]] > 0:
        options[0] = sample
        count = 1
    else:
        left = False
        for k in range(len(tally)):
            if tally[k] >= 0:
                left = True
                ways |= closer[v, k]
            if -_DECIDED < tally[k] < _DECIDED and readings[k] < _MOST_READINGS:
                options[count] = check + k
                count += 1
        if left:
            for a in range(sample):
                if ways >> a & 1:
                    options[count] = a
                    count += 1
        else:
            options[0] = right
            count = 1
    return count
