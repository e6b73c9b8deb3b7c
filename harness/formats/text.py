"""The bytes of a model file, packed or not, and numbers in it."""

from __future__ import annotations

import gzip
import math
import zlib
from pathlib import Path

from harness.errors import HarnessError, quoted
from harness.formats import limits
from harness.model.validation import LARGEST_REWARD


def read(path: Path) -> bytes:
    """The contents of a file, unpacked if its name ends in ``.gz``; what is over the limit is not unpacked further.

    Raises:
        HarnessError: it cannot be read, is damaged, or is longer than :data:`.limits.LARGEST_TEXT`.
    """
    try:
        with (gzip.open if path.suffix == ".gz" else open)(path, "rb") as file:
            text = file.read(limits.LARGEST_TEXT + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise HarnessError(f"{quoted(path)} is no whole gzip file; unpack it, or fetch it again") from None
    except FileNotFoundError:
        raise HarnessError(f"{quoted(path)}: no such file") from None
    except (OSError, ValueError) as error:
        raise HarnessError(f"cannot read {quoted(path)}: {getattr(error, 'strerror', None) or error}") from None
    limits.check(f"{quoted(path)}: bytes", len(text), limits.LARGEST_TEXT, "make the model smaller")
    return bytes(text)


def number(word: str, where: str) -> float:
    """A number in a file.

    Raises:
        HarnessError: the word is none, or not within 1e30 of 0.
    """
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not -LARGEST_REWARD <= value <= LARGEST_REWARD or "_" in word:
        raise HarnessError(f"{where}: {quoted(word)} is not a number; a number is needed here")
    return value
