"""What a report is made of, recognised by what is in the files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness.errors import HarnessError, quoted
from harness.ge import entries, improvements, results
from harness.ge.folder import RunFolder
from harness.ge.parameters import from_record
from harness.ge.runs import folders_of
from harness.play.evaluation import Score
from harness.report import records
from harness.score.table import COLUMNS, DIFFERENCES, SHARES
from harness.tuning import budgets, journal
from harness.tuning.outcome import Gain


@dataclass(frozen=True)
class Table:
    """A comparison table of one domain."""

    name: str
    """Of the file that it comes from, as in all inputs."""
    frame: pd.DataFrame


@dataclass(frozen=True)
class Domains:
    """A comparison table of several domains, of which each has a :class:`Table` too."""

    name: str
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
    improvements: Sequence[Mapping[str, Any]]
    """How it came about (:mod:`harness.ge.improvements`)."""
    front: pd.DataFrame | None = None
    """The best of so many statements or fewer (:mod:`harness.ge.front`)."""
    acts: pd.DataFrame | None = None
    """How often the lines of the winner and of its simplified twin act (:func:`harness.ge.simplifying.acts`)."""

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


Input = Domains | Table | Run | Runs | Tuning | Sweep


def read(path: Path) -> list[Input]:
    """What lies at a path; a comparison of several domains is one table of them all, and one for each.

    Raises:
        HarnessError: there is nothing, nothing known, or something damaged; the message names it.
    """
    name = path.resolve().name
    if path.is_dir():
        return [_folder(path, name)]
    if not path.exists():
        raise HarnessError(f"{path}: no such file or folder; expected {records.EXPECTED}")
    frame = records.table(path)
    if set(COLUMNS) <= set(frame.columns):
        tables = [Table(name, part.reset_index(drop=True)) for part in _comparisons(frame, path)]
        return [*([Domains(name, pd.concat([t.frame for t in tables]))] if len(tables) > 1 else []), *tables]
    if _is_sweep(frame):
        return [Sweep(name, _sweep(frame, path))]
    raise records.unknown(path)


def _comparisons(frame: pd.DataFrame, path: Path) -> list[pd.DataFrame]:
    for name in ("domain", "policy", "kind"):
        records.check_texts(frame[name], path, name)
    compared = [name for name in DIFFERENCES[1:] if name in frame]
    frame = records.numeric(
        frame,
        path,
        ["episodes", "seed", *Score._fields[1:], *SHARES, *compared],
        complete=["domain_version", "horizon"],
    )
    records.numeric(
        frame[frame["kind"] == "policy"], path, [], complete=["episodes", "seed", "mean", "discounted_mean"]
    )
    for reference in frame["reference"]:
        if isinstance(reference, dict):
            error = {"error": None, **reference}["error"]  # None: none was published
            records.check_numbers(reference, path, ["discounted_mean"])
            records.check_numbers({"error": 0.0 if error is None else error}, path, ["error"])
            reference["error"] = error
    frame = frame.astype({"domain_version": int, "horizon": int})
    return [part for _, part in frame.groupby("domain", sort=False)]


def _is_sweep(frame: pd.DataFrame) -> bool:
    known = [list(Score._fields), [*Score._fields, budgets.COLUMN]]
    return list(frame.columns[:1]) == ["policy"] and list(frame.columns[2:]) in known


def _sweep(frame: pd.DataFrame, path: Path) -> pd.DataFrame:
    records.check_texts(frame["policy"], path, "policy")
    return records.numeric(frame, path, [], complete=[str(name) for name in frame.columns[1:]])


def _folder(path: Path, name: str) -> Input:
    if folders := folders_of(path):
        return Runs(name, [_run(folder.path, folder.path.name) for folder in folders])
    sweep = path / "sweep.csv"
    if sweep.exists():
        frame = records.table(sweep)
        if not _is_sweep(frame):
            raise records.unknown(sweep)
        return Sweep(name, _sweep(frame, sweep))
    if not (path / journal.CONFIG).exists():
        raise records.unknown(path)
    return _tuning(path, name) if "run" in records.record(path / journal.CONFIG) else _run(path, name)


def _run(path: Path, name: str) -> Run:
    config = _config(path)
    best = _best(path / "best.json")
    text = path / "best.txt"
    return Run(
        name,
        config,
        _history(path, ["generation", "best", "test", "test_sem"], list(results.COLUMNS)),
        best,
        "\n".join(best["program"]) if best else records.text(text).rstrip() if text.exists() else "",
        _programs(path / "finalists.csv", ["fitness", "validation", "validation_sem", "length"], ["program"]),
        entries.read(improvements.KIND, path),
        _programs(path / "front.csv", ["length", "validation", "validation_sem"], ["program"]),
        _programs(path / "acts.csv", ["acts"], ["program", "line"]),
    )


def _config(path: Path) -> dict[str, Any]:
    file, config = path / journal.CONFIG, RunFolder(path).config()
    records.check_texts((config[name] for name in ("domain", "model_hash")), file, "domain, model_hash")
    if not isinstance(config["parameters"], dict):
        raise HarnessError(f"{file}: parameters must be an object, not {quoted(config['parameters'])}")
    try:
        return {**config, "parameters": from_record(config["parameters"]).__dict__}
    except HarnessError as error:
        raise HarnessError(f"{file}: {error}") from None


def _best(path: Path) -> dict[str, Any] | None:
    best = records.record(path, ["program", "fitness", "validation", "score"])
    if not best:
        return None
    if not isinstance(best["program"], list):
        raise HarnessError(f"{path}: program must be a list of lines; write the file again")
    records.check_texts(best["program"], path, "a line of the program")
    tuned_at_the_end = best["fitness"] is None  # a program that no generation has seen
    records.check_numbers(best, path, ["validation"] if tuned_at_the_end else ["fitness", "validation"])
    records.check_score(best["score"], path)
    return best


def _programs(path: Path, numbers: Sequence[str], texts: Sequence[str]) -> pd.DataFrame | None:
    """A table of programs, or of their lines; None where the run has not come to it, or is of an older version."""
    if not path.exists():
        return None
    frame = records.numeric(records.table(path), path, [], complete=numbers)
    for name in texts:
        if name not in frame:
            raise HarnessError(f"{path}: there is no column {name}; write the file again")
        records.check_texts(frame[name], path, name)
    return frame


def _tuning(path: Path, name: str) -> Tuning:
    run = journal.read_parameters(path)  # checks that they are as they were written
    config = records.record(path / journal.CONFIG)
    result = records.record(path / journal.RESULT, ["stopped", "policy", "training", "fresh"])
    if result:
        records.check_texts([result["stopped"], result["policy"]], path / journal.RESULT, "stopped, policy")
        for score in ("training", "fresh"):
            records.check_score(result[score], path / journal.RESULT)
        _check_places(result, path / journal.RESULT)
    return Tuning(name, {**config, "run": run}, _history(path, ["iteration", "value", "sem"]), result or None)


def _check_places(result: Mapping[str, Any], path: Path) -> None:
    """Check start, end and gain, and the numbers; a result of an older version has none of the first three."""
    if "gain" not in result:
        return
    for name in ("start", "ended", "gain"):
        if not isinstance(result.get(name), dict):
            raise HarnessError(f"{path}: {name} must be an object; write the file again")
    records.check_numbers(result["gain"], path, Gain._fields)
    for place in (result["start"], result["ended"]):
        records.check_texts([place.get("policy")], path, "policy")
        records.check_score(place.get("fresh"), path)
    for place in (result, result["start"]):
        if not isinstance(place.get("theta"), dict):
            raise HarnessError(f"{path}: theta must be an object; write the file again")
        records.check_numbers(place["theta"], path, place["theta"])


def _history(path: Path, needed: Sequence[str], columns: Sequence[str] = ()) -> pd.DataFrame:
    """The rows written so far: of a run under way the last line may be half there."""
    file = path / journal.HISTORY
    text = records.text(file) if file.exists() else ""
    text = text[: text.rfind("\n") + 1]
    if text.count("\n") < 2:
        return pd.DataFrame(columns=list(columns or needed), dtype=float)
    frame = records.parsed(text, file)
    columns = [*needed[1:], *(str(name) for name in frame if name not in needed)]  # a generation may lack a score
    return records.numeric(frame, file, columns, complete=needed[:1])
