"""The folder of a sweep: its parameters, and every row so far. Killed at any moment, it is whole."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from harness import files
from harness.errors import HarnessError
from harness.play.evaluation import Score
from harness.tuning import journal

SWEEP, ROWS = "sweep.json", "sweep.csv"


class Rows:
    """Rows of a sweep in the order of its values, in memory and, where there is a folder, in its ``sweep.csv``."""

    def __init__(self, name: str, folder: Path | None = None, more: Sequence[str] = ()) -> None:
        """``name``: of the number swept; ``more``: further columns of numbers."""
        self.folder = folder
        self.columns = ["policy", name, *Score._fields, *more]
        self._rows: list[list[Any]] = []

    def begin(self, config: Mapping[str, Any], resume: bool) -> None:
        """Open the folder for a new sweep, or for one to be resumed.

        Raises:
            HarnessError: a new sweep finds another one there; a resumed one finds none, or one with other parameters,
                or a damaged one. Nothing has been changed then.
        """
        if self.folder is None:
            return
        journal.open_folder(self.folder, SWEEP, ROWS, config, resume)
        if resume:
            self._rows = self._read(self.folder / ROWS, len(config["run"]["values"]))

    def has(self, i: int, policy: str, x: float, episodes: int) -> bool:
        """Whether the i-th row is known already; checked against what it must be of."""
        if i >= len(self._rows):
            return False
        if self._rows[i][:3] != [policy, x, episodes]:
            raise self._damaged(f"row {i + 1} is not of {policy.partition(chr(10))[0]}")
        return True

    def add(self, policy: str, x: float, score: Score, *more: float) -> None:
        """The next row."""
        self._rows.append([policy, x, *score, *more])
        if self.folder is not None:
            files.replace_text(self.folder / ROWS, self.table().to_csv(index=False, lineterminator="\n"))

    def table(self) -> pd.DataFrame:
        """All rows."""
        return pd.DataFrame(self._rows, columns=self.columns)

    def _read(self, path: Path, most: int) -> list[list[Any]]:
        if not path.exists():  # stopped before the first row
            return []
        try:
            text = path.read_text(encoding="utf-8")
            header, *rows = csv.reader(io.StringIO(text), strict=True)
            read: list[list[Any]] = [[row[0], float(row[1]), int(row[2]), *(float(x) for x in row[3:])] for row in rows]
        except (OSError, ValueError, IndexError, csv.Error):
            raise self._damaged("it cannot be read as a sweep") from None
        whole = all(len(row) == len(self.columns) and all(math.isfinite(x) for x in row[1:]) for row in read)
        if header != self.columns or not whole or len(read) > most or not text.endswith("\n"):
            raise self._damaged("its rows are not those of the sweep")
        return read

    def _damaged(self, how: str) -> HarnessError:
        path = (self.folder or Path()) / ROWS
        return HarnessError(f"{path} is damaged, or of another version of the packages: {how}; start anew elsewhere")
