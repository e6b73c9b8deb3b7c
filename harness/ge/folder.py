"""The folder of a run: what it was told, what it has found, and from where it can go on.

- ``config.json``: domain, engine, all parameters, versions, git revision, date
- ``grammar.bnf``: the grammar, as it was
- ``history.csv``: one row a generation
- ``checkpoint.npz``: the population of a generation that is in the history
- ``best.txt``: the best program so far; in the end, the winner
- ``finalists.csv``: in the end, the programs that were compared once more
- ``best.json``: in the end, the winner with its scores and all that it came from

All are written atomically, or appended to and cut back to the checkpoint, so that a run that is killed at any moment
goes on from its last checkpoint and ends with the same numbers.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness import files, host
from harness.errors import HarnessError
from harness.ge.mapping import Codons
from harness.model import archive

CHECKPOINT = "checkpoint"
_MEND = "delete it, and the run starts anew from its config.json"


class State(NamedTuple):
    """Where a run stands: the population of a generation, and the history up to it."""

    generation: int
    population: list[Codons]
    rows: list[dict[str, Any]]


class RunFolder:
    """Reads and writes the files of one run."""

    def __init__(self, path: Path) -> None:
        """``path`` need not exist."""
        self.path = path
        self._written = 0  # rows of the history on disk

    def create(self, config: Mapping[str, Any], grammar: str) -> None:
        """Begin a run.

        Raises:
            HarnessError: the folder holds a run already, or cannot be written.
        """
        if (self.path / "config.json").exists():
            raise HarnessError(
                f"{self.path} holds a run already; go on with --resume {self.path}, or choose another --out"
            )
        files.replace_text(self.path / "grammar.bnf", grammar)
        files.replace_json(self.path / "config.json", config)

    def config(self) -> dict[str, Any]:
        """What the run was told.

        Raises:
            HarnessError: there is no run, or its config.json is damaged.
        """
        path = self.path / "config.json"
        try:
            config = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise HarnessError(f"{self.path} holds no run: there is no config.json in it") from None
        except (OSError, ValueError) as error:
            raise HarnessError(
                f"{path}: not readable ({error}); put back the config.json that the run began with"
            ) from None
        if not isinstance(config, dict) or not {"domain", "parameters", "engine", "model_hash"} <= config.keys():
            raise HarnessError(f"{path}: this is not the config.json of an evolutionary run")
        return config

    def state(self) -> State | None:
        """Where the run stands; None where no checkpoint has been written. Cuts the history back to it.

        Raises:
            SnapshotError: the checkpoint is damaged.
            HarnessError: the history is shorter than the checkpoint says.
        """
        path = self.path / "checkpoint.npz"
        for left in self.path.glob("*.part"):  # by a process that was killed while it wrote
            left.unlink()
        if not path.exists():
            (self.path / "history.csv").unlink(missing_ok=True)
            return None
        record, arrays = archive.read(path, CHECKPOINT, _MEND)
        generation = int(record["generation"])
        population = np.split(arrays["codons"], np.cumsum(arrays["lengths"])[:-1])
        lines = self._history_lines()[: generation + 2]
        if len(lines) < generation + 2:
            raise HarnessError(
                f"{self.path / 'history.csv'} ends before generation {generation}, which the checkpoint is of; "
                f"delete {path}, and the run starts anew"
            )
        files.replace_text(self.path / "history.csv", "".join(lines))
        self._written = generation + 1
        rows = [{name: _number(text) for name, text in row.items()} for row in csv.DictReader(lines)]
        return State(generation, list(population), rows)

    def _history_lines(self) -> list[str]:
        path = self.path / "history.csv"
        return path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []

    def save(self, state: State, best: str | None) -> None:
        """Append what the history lacks, and write a checkpoint. Nothing to do when that has been done."""
        if self._written == len(state.rows):
            return
        with (self.path / "history.csv").open("a", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, list(state.rows[0]), lineterminator="\n")
            if self._written == 0:
                table.writeheader()
            table.writerows(state.rows[self._written :])
        arrays = {
            "codons": np.concatenate(state.population),
            "lengths": np.array([len(codons) for codons in state.population]),
        }
        archive.write(self.path / "checkpoint.npz", CHECKPOINT, {"generation": state.generation}, arrays)
        self._written = len(state.rows)
        if best is not None:
            files.replace_text(self.path / "best.txt", best)

    def finish(self, best: Mapping[str, Any], finalists: pd.DataFrame) -> None:
        """Write the results."""
        files.replace_text(self.path / "finalists.csv", finalists.to_csv(index=False, lineterminator="\n"))
        files.replace_text(self.path / "best.txt", "\n".join(best["program"]) + "\n")
        files.replace_json(self.path / "best.json", best)

    def rows_written(self) -> int:
        """Generations in the history on disk, for those who watch a run from outside."""
        return max(0, len(self._history_lines()) - 1)


def _number(text: str) -> float:
    """As it was before it was written: pandas would not keep every last bit."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def provenance() -> dict[str, Any]:
    """Versions, git revision of the harness's checkout (None in an installed package), and the date."""
    return {
        "versions": host.versions("numpy", "numba"),
        "git": host.revision(),
        "date": datetime.now(timezone.utc).date().isoformat(),
    }
