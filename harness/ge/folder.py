"""The folder of a run: what it was told, what it has found, and from where it can go on.

- ``config.json``: domain, engine, all parameters, versions, git revision, date, and a hash of it and of the grammar
- ``grammar.bnf``: the grammar, as it was
- ``history.csv``: one row a generation
- ``checkpoint.npz``: the population of a generation that is in the history
- ``best.txt``: the best program so far; in the end, the winner
- ``improvements.json``: how it came about (:mod:`harness.ge.improvements`)
- ``hall.json``: the best of every length that any generation has seen (:mod:`harness.ge.hall`)
- ``finalists.csv``: in the end, the programs that were compared once more
- ``front.csv`` and ``front-LENGTH.txt``: in the end, what earns more than all shorter ones (:mod:`harness.ge.front`)
- ``best.json``: in the end, the winner with its scores and all that it came from

All are written atomically, the history before the checkpoint, which keeps a hash of it. So a run that is killed at any
moment goes on from its last checkpoint and ends with the same numbers, and what was changed by hand is noticed.

A folder of many runs has a ``plan.json`` (:class:`Plan`), written before anything else, and a folder for each run.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness import files, host
from harness.errors import HarnessError, SnapshotError
from harness.ge.entries import Entries
from harness.ge.loop import Past, no_past
from harness.ge.mapping import Codons
from harness.model import archive

CHECKPOINT = "checkpoint"
_MEND = "delete it, and the run starts anew from its config.json"
_PUT_BACK = "put back the one that was there when it began"
_KINDS = {"domain": str, "model_hash": str, "grammar": str, "engine": str, "parameters": dict}
_PLAN_KINDS = {"run": dict, "grammar_text": str, "seeds": list}
PREFIX = "seed-"
"""Of the folders of many runs."""


class State(NamedTuple):
    """Where a run stands: the population of a generation, and the history up to it."""

    generation: int
    population: list[Codons]
    rows: list[dict[str, Any]]
    past: Past


class RunFolder:
    """Reads and writes the files of one run."""

    def __init__(self, path: Path) -> None:
        """``path`` need not exist."""
        self.path = path
        self.entries: list[Entries] = []
        """Of a run under way: programs that are kept on the way."""
        self._written = 0  # rows of the history on disk

    def create(self, config: Mapping[str, Any], grammar: str) -> None:
        """Begin a run.

        Raises:
            HarnessError: the folder holds a run already, or cannot be written.
        """
        check_new(self.path)
        files.replace_text(self.path / "grammar.bnf", grammar)
        files.replace_json(self.path / "config.json", _guarded(config, grammar))

    def prolong(self, generations: int) -> None:
        """Let the run be told another number of generations."""
        config = self.config()
        config["parameters"]["generations"] = generations
        files.replace_json(self.path / "config.json", _guarded(config, self.grammar()))

    def config(self) -> dict[str, Any]:
        """What the run was told.

        Raises:
            HarnessError: there is no run, or its config.json or grammar.bnf is damaged.
        """
        path = self.path / "config.json"
        if not path.exists():
            raise HarnessError(f"{self.path} holds no run: there is no config.json in it")
        return _unguarded(files.read_json(path, _PUT_BACK), self.grammar(), _KINDS, path)

    def grammar(self) -> str:
        """The grammar, as it was.

        Raises:
            HarnessError: it cannot be read.
        """
        return files.read_text(self.path / "grammar.bnf", _PUT_BACK)

    def state(self) -> State | None:
        """Where the run stands; None where no checkpoint has been written.

        Raises:
            SnapshotError: the checkpoint is damaged.
            HarnessError: the history is shorter than the checkpoint says, or damaged.
        """
        path = self.path / "checkpoint.npz"
        if not path.exists():
            return None
        record, arrays = archive.read(path, CHECKPOINT, _MEND)
        generation, population, past = record.get("generation"), _population(arrays), _past(arrays)
        if population is None or past is None or not isinstance(generation, int) or generation < 0:
            raise SnapshotError(f"{path}: holds no population; {_MEND}")
        lines = self._history(f"delete {path}, and the run starts anew").splitlines(keepends=True)[: generation + 2]
        if len(lines) < generation + 2:
            raise HarnessError(
                f"{self.path / 'history.csv'} ends before generation {generation}, which the checkpoint is of; "
                f"delete {path}, and the run starts anew"
            )
        if _sha256("".join(lines)) != record.get("history"):
            raise HarnessError(
                f"{self.path / 'history.csv'} is damaged, or was changed by hand; "
                f"delete {path}, and the run starts anew"
            )
        self._written = generation + 1
        rows = [{name: _number(text) for name, text in row.items()} for row in csv.DictReader(lines)]
        return State(generation, population, rows, past)

    def _history(self, mend: str) -> str:
        path = self.path / "history.csv"
        return files.read_text(path, mend) if path.exists() else ""

    def save(self, state: State, best: str | None) -> None:
        """Write the history and then a checkpoint. Nothing to do when that has been done.

        Raises:
            HarnessError: they cannot be written, or the run's folder is no longer there.
        """
        if self._written == len(state.rows):
            return
        self._check_there()
        for entries in self.entries:
            entries.save(len(state.rows))
        history = _csv(state.rows)
        files.replace_text(self.path / "history.csv", history)
        arrays = {
            "codons": np.concatenate(state.population),
            "lengths": np.array([len(codons) for codons in state.population]),
            **state.past._asdict(),
        }
        record = {"generation": state.generation, "history": _sha256(history)}
        archive.write(self.path / "checkpoint.npz", CHECKPOINT, record, arrays)
        self._written = len(state.rows)
        if best is not None:
            files.replace_text(self.path / "best.txt", best)

    def finish(self, best: Mapping[str, Any], finalists: pd.DataFrame, front: pd.DataFrame) -> None:
        """Write the results.

        Raises:
            HarnessError: they cannot be written, or the run's folder is no longer there.
        """
        self._check_there()
        for name, table in (("finalists.csv", finalists), ("front.csv", front)):
            files.replace_text(self.path / name, table.to_csv(index=False, lineterminator="\n"))
        for row in front.itertuples():
            files.replace_text(self.path / f"front-{row.length}.txt", str(row.program))
        files.replace_text(self.path / "best.txt", "\n".join(best["program"]) + "\n")
        files.replace_json(self.path / "best.json", best)

    def _check_there(self) -> None:
        if not (self.path / "config.json").exists():
            raise HarnessError(f"the run's folder {self.path} was removed while it went on; start it anew")

    def rows_written(self) -> int:
        """Generations in the history on disk, for those who watch a run from outside."""
        try:
            return max(0, (self.path / "history.csv").read_bytes().count(b"\n") - 1)
        except OSError:
            return 0


class Plan:
    """The ``plan.json`` of many runs: their seeds, and what each is told. Written first, and whole."""

    def __init__(self, parent: Path) -> None:
        """``parent``: the folder of all runs."""
        self.path = parent / "plan.json"

    def write(self, config: Mapping[str, Any], grammar: str, seeds: Sequence[int]) -> None:
        """Keep the plan: ``config`` is that of a run, but for its seed."""
        plan = {"run": dict(config), "grammar_text": grammar, "seeds": list(seeds)}
        files.replace_json(self.path, _guarded(plan, ""))

    def read(self) -> tuple[dict[str, Any], str, list[int]]:
        """What :meth:`write` was given.

        Raises:
            HarnessError: it is damaged.
        """
        plan = _unguarded(files.read_json(self.path, _PUT_BACK), "", _PLAN_KINDS, self.path)
        kinds = (isinstance(plan["run"].get(name), kind) for name, kind in _KINDS.items())
        if not all(kinds) or not all(type(seed) is int for seed in plan["seeds"]):
            raise HarnessError(f"{self.path}: this is no plan of runs; {_PUT_BACK}")
        return plan["run"], plan["grammar_text"], plan["seeds"]


def check_new(path: Path) -> None:
    """Check that a folder holds no run, and no runs.

    Raises:
        HarnessError: it does.
    """
    if any(path.glob("config.json")) or any(path.glob("plan.json")) or any(path.glob(f"{PREFIX}*/config.json")):
        raise HarnessError(f"{path} holds a run already; go on with --resume {path}, or choose another --out")


def _guarded(record: Mapping[str, Any], grammar: str) -> dict[str, Any]:
    return {**record, "hash": archive.digest({}, [dict(record), grammar])}


def _unguarded(record: Any, grammar: str, kinds: Mapping[str, type], path: Path) -> dict[str, Any]:
    """A record without its hash, once that and the kinds of its values have been checked."""
    if not isinstance(record, dict) or not all(isinstance(record.get(name), kind) for name, kind in kinds.items()):
        raise HarnessError(f"{path}: this is not the {path.name} of an evolutionary run")
    claimed = record.pop("hash", None)
    if claimed != archive.digest({}, [record, grammar]):
        raise HarnessError(
            f"{path}, or the grammar.bnf beside it, is damaged, was changed by hand, or is of an older version; "
            "put back the one that the run began with, or start anew in another folder"
        )
    return record


def _population(arrays: archive.Arrays) -> list[Codons] | None:
    """The population in a checkpoint, None where its arrays cannot hold one."""
    codons, lengths = arrays.get("codons"), arrays.get("lengths")
    if codons is None or codons.dtype != np.int32 or lengths is None or lengths.dtype.kind != "i":
        return None
    if codons.ndim != 1 or lengths.ndim != 1 or len(lengths) == 0 or min(codons.min(initial=0), lengths.min()) < 0:
        return None
    if lengths.max() > len(codons) or lengths.sum() != len(codons):
        return None
    return list(np.split(codons, np.cumsum(lengths)[:-1]))


def _past(arrays: archive.Arrays) -> Past | None:
    """What a checkpoint hands on beside its population, None where its arrays cannot hold that."""
    nothing = no_past(len(arrays.get("lengths", ())))  # of folders of older versions
    born, seen = arrays.get("born", nothing.born), arrays.get("seen", nothing.seen)
    if born.dtype != np.int32 or born.shape != nothing.born.shape or born.min(initial=0) < 0:
        return None
    if seen.dtype != np.float64 or seen.ndim != 2 or seen.shape[1] != nothing.seen.shape[1]:
        return None
    return Past(born, seen) if ((seen >= 0) & (seen <= 1)).all() else None


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    out = io.StringIO()
    table = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return out.getvalue()


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


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
