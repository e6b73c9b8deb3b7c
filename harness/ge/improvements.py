"""How a run's best program came about: the best of a generation wherever its score on fresh episodes was a new highest.

All generations are scored on the same fresh episodes, so the scores can be compared; each being the highest so far, it
is a little lucky. They choose nothing. The file is ``improvements.json``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness import files
from harness.errors import HarnessError
from harness.program import Program

NAME = "improvements.json"
_MEND = "delete it, nothing else depends on it"
_KINDS = {"generation": int, "test": float, "program": list}


class Improvements:
    """The file in a run's folder, and what will be in it."""

    def __init__(self, folder: Path, rows: Sequence[Mapping[str, Any]] = ()) -> None:
        """Those among the generations that a run has in its history, ``rows``.

        Raises:
            HarnessError: the file is damaged.
        """
        self._folder = folder
        self._entries = [each for each in read(folder) if each["generation"] < len(rows)]
        self._highest = max((row["test"] for row in rows if not math.isnan(row["test"])), default=-math.inf)
        self._written: int | None = None  # entries on disk, if they are these

    def see(self, row: Mapping[str, Any], program: Program) -> None:
        """A new row of the history, and the best program of its generation."""
        if row["test"] > self._highest:
            self._highest = row["test"]
            kept = {"generation": row["generation"], "test": row["test"], "program": program.text.splitlines()}
            self._entries.append(kept)

    def save(self) -> None:
        """Write the file where it has changed.

        Raises:
            HarnessError: it cannot be written.
        """
        if self._written != len(self._entries):
            files.replace_json(self._folder / NAME, self._entries)
            self._written = len(self._entries)


def read(folder: Path) -> list[dict[str, Any]]:
    """The entries in a run's folder: ``generation``, ``test`` (its mean return on the fresh episodes), ``program``
    (its lines); none where there is no file, as in folders of older versions.

    Raises:
        HarnessError: the file is damaged.
    """
    path = folder / NAME
    if not path.exists():
        return []
    found = files.read_json(path, _MEND)
    if not isinstance(found, list) or not all(_is_whole(each) for each in found):
        raise HarnessError(f"{path}: this is no list of improvements; {_MEND}")
    return found


def _is_whole(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and all(type(entry.get(name)) is kind for name, kind in _KINDS.items())
        and all(isinstance(line, str) for line in entry["program"])
        and math.isfinite(entry["test"])
    )
