"""How large a model file and what it defines may be: a few bytes can ask for more memory than there is."""

from __future__ import annotations

from harness.errors import HarnessError

LARGEST_TEXT = 2**27
"""Bytes of a model file, unpacked: 128 MiB."""
LARGEST_FACTOR = 2**15 - 1
"""Values of a hidden factor, of which a flat model's states are one: the tables count them in 16 bits."""
LARGEST_COUNT = 2**20
"""Visible values, actions, observations, and states to begin in."""
LARGEST_ROWS = 2**24
"""Rows of the tables: visible values × actions × values of the factor that a step touches."""
LARGEST_OUTCOMES = 2**24
"""Ways that steps can go, all together; a row of 32,767 states that is ``uniform`` has as many."""
LARGEST_READINGS = 2**25
"""Numbers in the different distributions of the observation."""
LARGEST_RULES = 2**23
"""Rules of one function, which the paths through a decision diagram can multiply."""


def check(what: str, count: int, most: int, mend: str) -> None:
    """Refuse a count that is over its limit.

    Raises:
        HarnessError: it is; ``what`` says of what, with file and line, ``mend`` what can be done.
    """
    if count > most:
        raise HarnessError(f"{what}: {count:,} are too many, {most:,} are the most; {mend}")
