"""The folder of a run: its parameters, every answer so far, and the result. Killed at any moment, it is whole.

``history.csv`` has a row for every point that was asked for; the numbers in it read back exactly. A resumed run asks
its method again from the start and takes the answers from there as long as they last, so no other state is kept.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness import files
from harness.errors import HarnessError, quoted
from harness.model import archive
from harness.tuning.method import Ask, Move
from harness.tuning.tunable import Vector

CONFIG, HISTORY, RESULT = "config.json", "history.csv", "result.json"
_COUNTS = ("iteration", "point", "first", "episodes")

Row = list[str]


class Journal:
    """Rows of a run, kept in memory and, where there is a folder, in its ``history.csv``."""

    def __init__(self, names: tuple[str, ...], folder: Path | None = None) -> None:
        """``names``: (d,) of the numbers tuned."""
        self.folder = folder
        self.columns = [
            *_COUNTS,
            *names,
            "value",
            "sem",
            *(f"theta_{name}" for name in names),
            *(f"gradient_{name}" for name in names),
            *(f"velocity_{name}" for name in names),
            "rate",
            "step",
        ]
        self._dimension = len(names)
        self._iterations: list[list[Row]] = []
        self._told = 0

    def begin(self, config: Mapping[str, Any], resume: bool) -> None:
        """Open the folder for a new run, or for one to be resumed.

        Raises:
            HarnessError: a new run finds another one there; a resumed one finds none, or one with other parameters, or
                a damaged one. Nothing has been changed then.
        """
        if self.folder is None:
            return
        open_folder(self.folder, CONFIG, HISTORY, config, resume)
        if resume:
            self._iterations = self._read()

    def answers(self, ask: Ask) -> tuple[Vector, Vector] | None:
        """Values and standard errors, (n,) each, where the next iteration is in the journal already; else None.

        Of a soft ask the values are (1 + d,), the return and its gradient.
        """
        if self._told == len(self._iterations):
            return None
        rows = self._iterations[self._told]
        if len(rows) != len(ask.points):
            raise self._damaged(f"iteration {self._told} has {len(rows)} rows, not {len(ask.points)}")
        at = self.columns.index("value")
        if ask.soft is not None:
            first = self.columns.index("rate") - 2 * self._dimension  # gradients, then velocities
            found = [rows[0][at], *rows[0][first : first + self._dimension]]
            return np.array([float(x) for x in found]), np.zeros(1)
        values, sems = np.array([[float(x) for x in row[at : at + 2]] for row in rows]).T
        return values, sems

    def tell(self, theta: Vector, ask: Ask, values: Vector, sems: Vector, move: Move) -> None:
        """The next iteration, from ``theta``: checked against the journal, or added to it."""
        rows = self._rows(theta, ask, values, sems, move)
        if self._told < len(self._iterations):
            if rows != self._iterations[self._told]:
                raise self._damaged(f"iteration {self._told} is not what the run did there")
        else:
            self._iterations.append(rows)
            if self.folder is not None:
                files.replace_text(self.folder / HISTORY, self._text())
        self._told += 1

    def finish(self, result: Mapping[str, Any]) -> None:
        """Keep the result."""
        if self._told < len(self._iterations):
            raise self._damaged(f"it goes on after iteration {self._told - 1}, where the run stopped")
        if self.folder is not None:
            files.replace_json(self.folder / RESULT, result)

    def table(self) -> pd.DataFrame:
        """All rows; not-a-number where a method has no such thing."""
        rows = [[float(x) for x in row] for iteration in self._iterations for row in iteration]
        return pd.DataFrame(rows, columns=self.columns).astype(dict.fromkeys(_COUNTS, int))

    def _rows(self, theta: Vector, ask: Ask, values: Vector, sems: Vector, move: Move) -> list[Row]:
        none = np.full(self._dimension, math.nan)
        gradient = none if move.gradient is None else move.gradient
        velocity = none if move.velocity is None else move.velocity
        moved = [*theta, *gradient, *velocity, move.rate, move.step]
        return [
            [
                *(str(int(x)) for x in (self._told, i, ask.first[i], ask.episodes)),
                *(repr(float(x)) for x in (*ask.points[i], values[i], sems[i], *moved)),
            ]
            for i in range(len(ask.points))
        ]

    def _text(self) -> str:
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        for rows in self._iterations:
            writer.writerows(rows)
        return out.getvalue()

    def _read(self) -> list[list[Row]]:
        assert self.folder is not None
        path = self.folder / HISTORY
        if not path.exists():  # stopped before the first iteration was over
            return []
        iterations: list[list[Row]] = []
        try:
            header, *rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8")), strict=True))
            if header != self.columns:
                raise ValueError
            for row in rows:
                _ = [float(x) for x in row]
                number = int(row[0])
                if len(row) != len(header) or not len(iterations) - 1 <= number <= len(iterations):
                    raise ValueError
                if number == len(iterations):
                    iterations.append([])
                iterations[number].append(row)
        except (OSError, ValueError, IndexError, csv.Error):
            raise self._damaged("it cannot be read as a history") from None
        return iterations

    def _damaged(self, how: str) -> HarnessError:
        path = (self.folder or Path()) / HISTORY
        return HarnessError(
            f"{path} is damaged, or of another version of the packages: {how}; start anew in another folder"
        )


def open_folder(folder: Path, name: str, rows: str, config: Mapping[str, Any], resume: bool) -> None:
    """Begin a run in a folder, whose file ``name`` keeps its parameters, or check that it holds this one.

    Raises:
        HarnessError: a new run finds another one there, or its file ``rows``; a resumed one finds none, or one with
            other parameters, or a damaged one. Nothing has been changed then.
    """
    if resume:
        check_same(read_parameters(folder, name), config["run"], folder)
    elif (folder / name).exists() or (folder / rows).exists():
        raise HarnessError(f"{folder} already holds a run; go on with --resume {folder}, or name another")
    else:
        files.replace_json(folder / name, {**config, "hash": archive.digest({}, config["run"])})


def read_parameters(folder: Path, name: str = CONFIG) -> dict[str, Any]:
    """The parameters of the run in a folder, the ``run`` in its file ``name``.

    Raises:
        HarnessError: there is no run, or its file is damaged.
    """
    path = folder / name
    if not path.exists():
        raise HarnessError(f"{folder} holds no run to resume (there is no {name}); start one with --out")
    config = files.read_json(path, f"{name} is damaged: start anew in another folder")
    run = config.get("run") if isinstance(config, dict) else None
    if not isinstance(run, dict) or config.get("hash") != archive.digest({}, run):
        raise HarnessError(f"{path} is damaged, or was changed by hand; start anew in another folder")
    return run


def check_same(old: Mapping[str, Any], new: Mapping[str, Any], folder: Path) -> None:
    """Check that the parameters of a run in a folder (``old``) are those given now.

    Raises:
        HarnessError: one differs.
    """
    if missing := [name for name in new if name not in old]:
        raise HarnessError(
            f"the run in {folder} is of an older version of the harness, without {missing[0]}; start anew elsewhere"
        )
    for name in {**old, **new}:
        if old.get(name) != new.get(name) and name == "model_hash":
            raise HarnessError(f"the run in {folder} was made on another version of the domain; start anew elsewhere")
        if old.get(name) != new.get(name):
            raise HarnessError(
                f"the run in {folder} has {name} {quoted(old.get(name))}, not {quoted(new.get(name))}; "
                f"leave {name} out to resume it, or name another folder"
            )
