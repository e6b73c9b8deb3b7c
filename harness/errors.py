"""The errors that a user can mend: shown as one sentence, without a traceback, with exit status 2.

What a message echoes of the user's own text goes through :func:`quoted`; :func:`sentence` sees to the whole of it.
"""

from __future__ import annotations

import numbers
import os
from collections.abc import Iterable

LONGEST_QUOTE = 60
"""Characters of the input that a message repeats at most."""

LONGEST_SENTENCE = 299
"""Characters of a whole message at most."""


class HarnessError(ValueError):
    """Something that the user gave (a name, a file, an option) is wrong; the message says what, and how to mend it."""

    def __str__(self) -> str:
        """The message, as :func:`sentence` makes it."""
        return sentence(super().__str__())


class SnapshotError(HarnessError):
    """A snapshot or policy file is damaged, foreign or belongs to another model."""


class PolicyError(HarnessError):
    """A policy is unknown, has a parameter out of range, or returned something that is no action."""


class JuliaError(HarnessError):
    """Julia is not set up, or a Julia call failed."""


def quoted(value: object) -> str:
    """The user's own text or value as a message quotes it: short, printable, on one line; a text in quotation marks.

    Of a long text the beginning is kept, of a long path (a :class:`~pathlib.Path`) the end.
    """
    if isinstance(value, os.PathLike):
        text = printable(str(value)[-LONGEST_QUOTE - 1 :])
        return f"'{text}'" if len(text) <= LONGEST_QUOTE else f"'… {text[2 - LONGEST_QUOTE :]}'"
    if isinstance(value, str):
        return f"'{short(value)}'"
    try:
        return short(repr(value))
    except (ValueError, RecursionError):  # a number of thousands of digits, an endless nesting
        return f"a huge {type(value).__name__}"


def short(text: str) -> str:
    """The user's own text as a message repeats it without quotation marks."""
    text = printable(text[: LONGEST_QUOTE + 1])
    return text if len(text) <= LONGEST_QUOTE else f"{text[: LONGEST_QUOTE - 2]} …"


def sentence(text: str) -> str:
    """A message that is printable, on one line and short: of a long one the middle is left out, where lists stand."""
    text = printable(text)
    if len(text) <= LONGEST_SENTENCE:
        return text
    tail = LONGEST_SENTENCE // 3
    return f"{text[: LONGEST_SENTENCE - tail - 3]} … {text[-tail:]}"


def printable(text: str) -> str:
    r"""The text with line breaks, escape sequences and other characters that do not print as ``\n``, ``\x1b``, …."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def check_whole(name: str, value: object, low: int, high: int) -> None:
    """Check a whole number that a user gave; one of NumPy's is one too.

    Raises:
        HarnessError: it is none, or not in [low, high].
    """
    if not isinstance(value, numbers.Integral) or isinstance(value, bool) or not low <= int(value) <= high:
        raise HarnessError(f"{name} must be a whole number from {low:,} to {high:,}, not {quoted(value)}")


def nearest(word: str, known: Iterable[str]) -> str:
    """End of an error message: ``; did you mean 'x'?`` where a known word is close, else nothing."""
    import difflib  # here, where it is needed: commands that go well start without it

    close = difflib.get_close_matches(word[:LONGEST_QUOTE], list(known), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""
