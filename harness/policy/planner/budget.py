"""How long a planner thinks before an action: ``1000`` simulations, or ``time=100ms``; and its other settings."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from harness.errors import PolicyError, nearest, quoted

MOST = 1_000_000
"""Simulations an action at most: a step then takes seconds an episode, in which no Ctrl-C is heard."""
_TIME = re.compile(r"([1-9][0-9]{0,4})ms")


@dataclass(frozen=True)
class Budget:
    """What is spent on one action of one episode."""

    count: int
    """Simulations (POMCP) or trials (DESPOT)."""
    milliseconds: int | None = None
    """With a time it ends after that, whatever the count: what comes out then depends on the machine."""

    def portions(self) -> Iterator[int]:
        """Numbers of simulations to do one after the other, until the budget is spent."""
        if self.milliseconds is None:
            yield self.count
            return
        end = time.perf_counter() + self.milliseconds / 1000
        portion, left = 1, self.count
        while left > 0 and (now := time.perf_counter()) < end:
            yield (portion := min(portion, left))
            left -= portion
            took = time.perf_counter() - now
            portion = min(_LARGEST, 2 * portion) if took < (end - now) / 4 else max(1, portion // 2)


_LARGEST = 4096


def milliseconds(text: str) -> int:
    """The number in ``100ms``."""
    if not (found := _TIME.fullmatch(text)):
        raise ValueError("a time as 100ms, from 1ms to 99999ms")
    return int(found[1])


def parse(word: str, text: str, unit: str, known: Mapping[str, Callable[[str], Any]]) -> dict[str, Any]:
    """The settings in ``1000,exploration=10``: a bare number is of ``unit``, ``time=…ms`` the budget as a time.

    ``known``: what reads each other setting; a ValueError of it says what it takes.

    Raises:
        PolicyError: a name is unknown or given twice, or its value means nothing.
    """
    readers = {unit: lambda value: whole(value, MOST), "time": milliseconds, **known}
    found: dict[str, Any] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        if not equals:
            name, value = unit, part
        if name not in readers:
            raise PolicyError(f"{word} has no {quoted(name)}{nearest(name, readers)} (it has: {', '.join(readers)})")
        if name in found:
            raise PolicyError(f"{word}: {name} is given twice")
        try:
            found[name] = readers[name](value)
        except ValueError as takes:
            raise PolicyError(f"{word}: {name} is {takes}, not {quoted(value)}") from None
    return found


def whole(text: str, most: int) -> int:
    """A whole number from 1 to ``most``."""
    if not text.isdecimal() or len(text) > 9 or not 1 <= int(text) <= most:
        raise ValueError(f"a whole number from 1 to {most:,}")
    return int(text)


def number(text: str, most: float) -> float:
    """A number from 0 to ``most``."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= most:
        raise ValueError(f"a number from 0 to {most:,g}")
    return value
