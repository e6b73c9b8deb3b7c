"""Files as tables and objects, checked for what a report takes from them."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.errors import HarnessError, quoted, short
from harness.play.evaluation import Score

EXPECTED = (
    "a comparison table (harness compare … --format csv or json, --out FILE), a folder of harness evolve, tune or "
    "sweep, or a sweep.csv"
)
"""What a report can be of, for error messages."""


def unknown(path: Path) -> HarnessError:
    """The error for a file or folder that is none of these."""
    return HarnessError(f"{path}: nothing to report on; expected {EXPECTED}")


def text(path: Path) -> str:
    """The content of a text file.

    Raises:
        HarnessError: it cannot be read, as from all functions here.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise HarnessError(f"{path}: no text file; expected {EXPECTED}") from None


def table(path: Path) -> pd.DataFrame:
    """A table from CSV or from a JSON list of rows, whichever it is."""
    content = text(path)
    if not content.lstrip().startswith(("[", "{")):
        return parsed(content, path)
    try:
        rows = json.loads(content)
    except ValueError as error:
        raise HarnessError(f"{path}: not readable as JSON ({error}); expected {EXPECTED}") from None
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise unknown(path)
    return pd.DataFrame(rows)


def parsed(content: str, path: Path) -> pd.DataFrame:
    """A table from CSV that was in the file ``path``."""
    texts = {"reference": str, "policy": str}  # a published "21.39" stays as it was written
    try:
        frame = pd.read_csv(io.StringIO(content), dtype=texts)
    except ValueError as error:  # pandas' own errors are ValueErrors
        reason = str(error).strip().splitlines()[-1].removeprefix("Error tokenizing data. C error: ")
        raise HarnessError(f"{path}: not readable as CSV ({reason}); expected {EXPECTED}") from None
    if frame.empty:
        raise HarnessError(f"{path}: there are no rows in it; expected {EXPECTED}")
    return frame


def numeric(frame: pd.DataFrame, path: Path, columns: Iterable[str], *, complete: Sequence[str] = ()) -> pd.DataFrame:
    """The table with numbers in these columns; in those that are ``complete`` a finite one in every row.

    Raises:
        HarnessError: a column is missing or holds something else.
    """
    names = [*columns, *complete]
    if missing := [name for name in names if name not in frame]:
        raise HarnessError(f"{path}: there is no column {', '.join(missing)}; write the file again")
    try:
        frame = frame.assign(**{name: pd.to_numeric(frame[name]) for name in names})
    except (ValueError, TypeError, OverflowError) as error:
        raise HarnessError(f"{path}: a number was expected ({short(str(error))}); write the file again") from None
    for name in complete:
        if not np.isfinite(frame[name]).all():
            raise HarnessError(f"{path}: a number is missing, or infinite, in the column {name}; write the file again")
    return frame


def record(path: Path, needed: Sequence[str] = ()) -> dict[str, Any]:
    """A JSON object; empty where there is no file.

    Raises:
        HarnessError: it is something else, or lacks a name that is needed.
    """
    if not path.exists():
        return {}
    try:
        found = json.loads(text(path))
    except ValueError as error:
        raise HarnessError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(found, dict) or not set(needed) <= found.keys():
        raise HarnessError(f"{path}: this is not the file of a run (it needs {', '.join(needed) or 'an object'})")
    return found


_MOST = 1e300  # compared with, not converted to: a whole number may be too long for that


def check_numbers(found: Mapping[str, Any], path: Path, names: Iterable[str]) -> None:
    """Check that there are finite numbers under all names."""
    for name in names:
        value = found.get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not -_MOST < value < _MOST:
            raise HarnessError(f"{path}: {name} must be a number, not {quoted(value)}; write the file again")


def check_score(found: Any, path: Path) -> None:
    """Check that an object has the fields of a Score."""
    if not isinstance(found, dict):
        raise HarnessError(f"{path}: a score must be an object, not {quoted(found)}; write the file again")
    check_numbers(found, path, Score._fields)


def check_texts(values: Iterable[Any], path: Path, what: str) -> None:
    """Check that all values are texts."""
    for value in values:
        if not isinstance(value, str):
            raise HarnessError(f"{path}: {what} must be text, not {quoted(value)}; write the file again")
