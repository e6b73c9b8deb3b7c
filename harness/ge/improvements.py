"""How a run's best program came about: the best of a generation wherever its score on fresh episodes was a new highest.

All generations are scored on the same fresh episodes, so the scores can be compared; each being the highest so far, it
is a little lucky. They choose nothing. The file is ``improvements.json``; an entry's ``test`` is its mean return there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.ge.entries import Entries, Kind
from harness.program import Program

KIND = Kind("improvements.json", "improvements", {"generation": int, "test": float})


class Improvements(Entries):
    """The file in a run's folder, and what will be in it."""

    def __init__(self, folder: Path | None, rows: Sequence[Mapping[str, Any]] = ()) -> None:
        """Those among the generations that a run has in its history, ``rows``.

        Raises:
            HarnessError: the file is damaged.
        """
        super().__init__(KIND, folder, len(rows))
        self._highest = max((row["test"] for row in rows if not math.isnan(row["test"])), default=-math.inf)

    def see(self, row: Mapping[str, Any], program: Program) -> None:
        """A new row of the history, and the best program of its generation."""
        if row["test"] > self._highest:
            self._highest = row["test"]
            kept = {"generation": row["generation"], "test": row["test"], "program": program.text.splitlines()}
            self.found.append(kept)
