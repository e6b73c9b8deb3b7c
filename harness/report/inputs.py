"""What a report is made of, recognised by what is in the files."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness.comparison import COLUMNS
from harness.errors import HarnessError
from harness.evaluation import Score
from harness.ge import results
from harness.ge.folder import RunFolder
from harness.ge.runs import folders_of
from harness.tuning import journal

EXPECTED = (
    "a comparison table (harness compare … --format csv or json, --out FILE), a folder of harness evolve, tune or "
    "sweep, or a sweep.csv"
)


@dataclass(frozen=True)
class Table:
    """A comparison table of one domain."""

    name: str
    """Of the file that it comes from, as in all inputs."""
    frame: pd.DataFrame


@dataclass(frozen=True)
class Run:
    """One run of evolution, finished or not."""

    name: str
    config: Mapping[str, Any]
    history: pd.DataFrame
    best: Mapping[str, Any] | None
    """What ``best.json`` says; None while the run has not finished."""
    program: str
    """The best program so far, in the end the winner; empty where there is none yet."""
    finalists: pd.DataFrame | None

    @property
    def seed(self) -> int:
        """Of the run."""
        return int(self.config["parameters"]["seed"])


@dataclass(frozen=True)
class Runs:
    """Independent runs of evolution that differ in their seeds."""

    name: str
    runs: Sequence[Run]


@dataclass(frozen=True)
class Tuning:
    """A run of tuning, finished or not."""

    name: str
    config: Mapping[str, Any]
    history: pd.DataFrame
    result: Mapping[str, Any] | None
    """What ``result.json`` says; None while the run has not finished."""


@dataclass(frozen=True)
class Sweep:
    """The return over one number of a policy."""

    name: str
    frame: pd.DataFrame


Input = Table | Run | Runs | Tuning | Sweep


def read(path: Path) -> list[Input]:
    """What lies at a path; a comparison of several domains is one table for each.

    Raises:
        HarnessError: there is nothing, nothing known, or something damaged; the message names it.
    """
    name = path.resolve().name
    if path.is_dir():
        return [_folder(path, name)]
    if not path.exists():
        raise HarnessError(f"{path}: no such file or folder; expected {EXPECTED}")
    frame = _frame(path)
    if set(COLUMNS) <= set(frame.columns):
        frame = _numeric(frame, path, ["mean", "sem", "discounted_mean", "discounted_sem", "episodes", "seed"])
        return [Table(name, part.reset_index(drop=True)) for _, part in frame.groupby("domain", sort=False)]
    if list(frame.columns[:1]) == ["policy"] and list(frame.columns[2:]) == list(Score._fields):
        return [Sweep(name, _numeric(frame, path, list(frame.columns[1:])))]
    raise _unknown(path)


def _unknown(path: Path) -> HarnessError:
    return HarnessError(f"{path}: nothing to report on; expected {EXPECTED}")


def _folder(path: Path, name: str) -> Input:
    if folders := folders_of(path):
        return Runs(name, [_run(folder.path, folder.path.name) for folder in folders])
    if (path / "sweep.csv").exists():
        (sweep,) = read(path / "sweep.csv")
        if isinstance(sweep, Sweep):
            return Sweep(name, sweep.frame)
    if not (path / journal.CONFIG).exists():
        raise _unknown(path)
    config = _json(path / journal.CONFIG)
    if "run" in config:
        return _tuning(path, name, config)
    return _run(path, name)


def _run(path: Path, name: str) -> Run:
    config = RunFolder(path).config()
    best = _json(path / "best.json", ["program", "fitness", "validation", "score"])
    text = path / "best.txt"
    return Run(
        name,
        config,
        _history(path, ["generation", "best", "test", "test_sem"], list(results.COLUMNS)),
        best or None,
        "\n".join(best["program"]) if best else text.read_text(encoding="utf-8").rstrip() if text.exists() else "",
        _csv(path / "finalists.csv") if (path / "finalists.csv").exists() else None,
    )


def _tuning(path: Path, name: str, config: Mapping[str, Any]) -> Tuning:
    journal.read_parameters(path)  # checks that they are as they were written
    result = _json(path / journal.RESULT, ["stopped", "policy", "theta", "training", "fresh"])
    return Tuning(name, config, _history(path, ["iteration", "value", "sem"]), result or None)


def _history(path: Path, needed: Sequence[str], columns: Sequence[str] = ()) -> pd.DataFrame:
    """The rows written so far: of a run under way the last line may be half there."""
    file = path / journal.HISTORY
    if not file.exists():
        return pd.DataFrame(columns=list(columns or needed), dtype=float)
    text = _text(file)
    frame = _parsed(text[: text.rfind("\n") + 1], file)
    if not set(needed) <= set(frame.columns):
        raise HarnessError(f"{file}: this is not the history of a run (no {', '.join(needed)})")
    return _numeric(frame, file, list(frame.columns))


def _frame(path: Path) -> pd.DataFrame:
    """A table from CSV or JSON, whichever it is."""
    text = _text(path)
    if not text.lstrip().startswith(("[", "{")):
        return _parsed(text, path)
    try:
        rows = json.loads(text)
    except ValueError as error:
        raise HarnessError(f"{path}: not readable as JSON ({error}); expected {EXPECTED}") from None
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise _unknown(path)
    return pd.DataFrame(rows)


def _csv(path: Path) -> pd.DataFrame:
    return _parsed(_text(path), path)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise HarnessError(f"{path}: no text file; expected {EXPECTED}") from None


def _parsed(text: str, path: Path) -> pd.DataFrame:
    texts = {"reference": str, "policy": str}  # a published "21.39" stays as it was written
    try:
        frame = pd.read_csv(io.StringIO(text), dtype=texts)
    except ValueError as error:  # pandas' own errors are ValueErrors
        reason = str(error).strip().splitlines()[-1]
        raise HarnessError(f"{path}: not readable as CSV ({reason}); expected {EXPECTED}") from None
    if frame.empty:
        raise HarnessError(f"{path}: there are no rows in it; expected {EXPECTED}")
    return frame


def _numeric(frame: pd.DataFrame, path: Path, columns: Sequence[str]) -> pd.DataFrame:
    try:
        return frame.assign(**{name: pd.to_numeric(frame[name]) for name in columns})
    except (ValueError, TypeError) as error:
        raise HarnessError(f"{path}: a number was expected ({error}); write the file again") from None


def _json(path: Path, needed: Sequence[str] = ()) -> dict[str, Any]:
    """A JSON object; empty where there is no file."""
    if not path.exists():
        return {}
    try:
        record = json.loads(_text(path))
    except ValueError as error:
        raise HarnessError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(record, dict) or not set(needed) <= record.keys():
        raise HarnessError(f"{path}: this is not the file of a run (it needs {', '.join(needed) or 'an object'})")
    return record
