"""The errors that a user can mend: shown as one sentence, without a traceback, with exit status 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class HarnessError(ValueError):
    """Something that the user gave (a name, a file, an option) is wrong; the message says what, and how to mend it."""


class SnapshotError(HarnessError):
    """A snapshot or policy file is damaged, foreign or belongs to another model."""


class PolicyError(HarnessError):
    """A policy is unknown, has a parameter out of range, or returned something that is no action."""


class JuliaError(HarnessError):
    """Julia is not set up, or a Julia call failed."""


def nearest(word: str, known: Iterable[str]) -> str:
    """End of an error message: ``; did you mean 'x'?`` where a known word is close, else nothing."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""
