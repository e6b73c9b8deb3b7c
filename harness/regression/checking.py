"""The score check and its update: from a file of scores to verdicts, and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from harness import files, locking
from harness.errors import HarnessError
from harness.play import executor
from harness.progress import Bar, Progress
from harness.regression import scoring, stored
from harness.regression.judging import Outcome, ScoreCheck, judge
from harness.regression.rows import AnyScore, Row
from harness.regression.scoring import Measurement, Task
from harness.regression.stored import ScoreFile
from harness.score.table import EXACT

_T = TypeVar("_T")


@dataclass(frozen=True)
class Move:
    """What an update did to a row's stored score."""

    before: AnyScore | None
    after: AnyScore | None
    """None: the row is no longer listed, its score was dropped."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a check; ``check`` holds the rows finished by then, judged as part of the whole list."""

    def __init__(self, check: ScoreCheck) -> None:
        """``check``: as :func:`check_scores` would return it, with fewer outcomes."""
        super().__init__()
        self.check = check


def check_scores(
    path: str | Path = "scores.toml",
    *,
    exact: bool = False,
    seed: int | None = None,
    engine: str | None = None,
    allow_code: bool = False,
    progress: Progress = False,
) -> ScoreCheck:
    """Score the rows of a file again and compare with the scores stored there.

    Args:
        path: the file.
        exact: fail a row unless every episode, or the computed return, comes out as stored.
        seed: other episodes than those stored, which makes the comparison statistical.
        engine: ``tables``, ``julia`` or ``auto``, instead of what the rows say.
        allow_code: read and run the files that the rows name as domains and policies.
        progress: True for a bar on a terminal when the check takes longer than two seconds, or a function that is
            called with the number of rows finished since its last call.

    Raises:
        HarnessError: the file or an argument is wrong; nothing is played before all rows have been checked.
        Interrupted: Ctrl-C was pressed.
    """
    if exact and seed is not None:
        raise HarnessError("an exact check plays the episodes that are stored; leave out either --exact or --seed")
    file = _read(files.named(path))
    tasks = _tasks(file, allow_code, seed=seed, engine=engine)
    measurements: list[Measurement] = []

    def outcomes() -> tuple[Outcome, ...]:
        judged = judge(measurements, file.limits, len(tasks), exact)
        return tuple(dataclasses.replace(o, line=line) for o, line in zip(judged, file.lines, strict=False))

    try:
        for measurement in _shown(_each(_measure, tasks, file), len(tasks), "check", progress):
            measurements.append(measurement)  # noqa: PERF402  one by one, for Ctrl-C
    except KeyboardInterrupt:
        raise Interrupted(ScoreCheck(file.path, file.limits, outcomes())) from None
    return ScoreCheck(file.path, file.limits, outcomes() + _vanished(file))


def _each(function: Callable[..., _T], tasks: list[Task], file: ScoreFile) -> Iterator[_T]:
    """What a function makes of every row, in their order; a row is a task of :func:`harness.cluster`."""
    workers = None if any(task.row.engine == "julia" for task in tasks) else executor.current()
    numbers = range(len(tasks))
    return executor.ordered(workers, function, numbers, tasks, file, name=lambda k: _name(tasks[k]), alike=False)


def _name(task: Task) -> str:
    return f"{task.row.policy} on {task.row.domain}"


def _measure(tasks: list[Task], file: ScoreFile, k: int) -> Measurement:
    task = tasks[k]
    key = task.row.key
    if key in file.damaged:
        return Measurement(task.row, None, fault=("damaged", f"{file.damaged[key]}; run harness check --update"))
    return scoring.measure(task, file.stored.get(key))


def update_scores(
    path: str | Path = "scores.toml", *, allow_code: bool = False, progress: Progress = False
) -> list[Move]:
    """Score the rows of a file and store the scores in it; rows whose episodes all come out as stored stay untouched.

    The file is replaced in one go at the end; after an error or Ctrl-C it is as before.

    Returns:
        What became of each row, in order, then the stored scores that were dropped because their row has vanished.

    Raises:
        HarnessError: the file is wrong or another process updates it, or a score is no finite number.
    """
    with locking.alone_on(Path(path)):
        return _update(Path(path), allow_code, progress)


def _update(path: Path, allow_code: bool, progress: Progress) -> list[Move]:
    file = _read(path)
    tasks = _tasks(file, allow_code)
    moves = list(_shown(_each(_renew, tasks, file), len(tasks), "update", progress))
    listed = {row.key for row in file.rows}
    dropped = [Move(score, None) for key, score in file.stored.items() if key not in listed]
    stored.write(file.path, [move.after for move in moves if move.after is not None])
    return moves + dropped


def _renew(tasks: list[Task], file: ScoreFile, k: int) -> Move:
    task = tasks[k]
    before = file.stored.get(task.row.key) if task.row.key not in file.damaged else None
    return Move(before, scoring.renew(task, before, file.limits))


def _read(path: Path) -> ScoreFile:
    file = stored.read(path)
    if not file.rows and not file.stored_lines:
        raise HarnessError(f"{path}: lists nothing to score; add [[score]] tables")
    return file


def _tasks(file: ScoreFile, allow_code: bool, seed: int | None = None, engine: str | None = None) -> list[Task]:
    tasks = []
    for row, line in zip(file.rows, file.lines, strict=True):
        if row.how != EXACT:  # those play nothing
            row = dataclasses.replace(row, seed=row.seed if seed is None else seed, engine=engine or row.engine)
        tasks.append(_task(file.path, line, row, allow_code))
    return tasks


def _task(path: Path, line: int, row: Row, allow_code: bool) -> Task:
    try:
        return scoring.task(row, allow_code)
    except HarnessError as error:
        raise HarnessError(f"{path}:{line}: {error}") from None


def _shown(results: Iterable[_T], total: int, what: str, progress: Progress) -> Iterator[_T]:
    with Bar(progress, total, desc=what, unit="row", delay=2) as bar:
        for result in results:
            yield result
            bar.update()


def _vanished(file: ScoreFile) -> tuple[Outcome, ...]:
    listed = {row.key for row in file.rows}
    reason = "a score is stored for it, but it is no longer listed; put it back, or run harness check --update"
    return tuple(
        Outcome(Row(key[0], key[1], horizon=max(key[2], 1), how=key[3]), "vanished", "", reason=reason, line=line)
        for key, line in file.stored_lines.items()
        if key not in listed
    )
