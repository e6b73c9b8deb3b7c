"""Runs on workers that do not see this machine's files: a run goes there for some seconds at a time, and comes back.

What travels is the folder of the run. It holds all that a run needs to go on, and a run that goes on ends with the same
numbers; so the worker of a slice may be any, and may be killed: the slice is played again. Only this process writes to
the folders, whole files as ever.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness import files, locking
from harness.ge.folder import RunFolder
from harness.ge.results import Evolution
from harness.ge.search import Setup, run
from harness.play import executor
from harness.play.executor import Workers
from harness.progress import Bar

SLICE = 5.0
"""Seconds of a slice: it begins by evaluating its checkpoint's generation again, which shall weigh little."""

_LEAST = 2  # new generations of a slice, however long they take
_LAST = ("history.csv", "checkpoint.npz", "finalists.csv", "best.txt", "best.json")  # to be written in this order

Files = dict[str, bytes]
"""The contents of a run's folder by name."""


def play(workers: Workers, setups: Sequence[Setup], folders: Sequence[RunFolder], bar: Bar) -> list[Evolution]:
    """All runs to their ends; what is in their folders is never older than a few seconds of their work."""
    found: dict[int, Evolution] = {}
    with contextlib.ExitStack() as locks:
        for folder in folders:
            locks.enter_context(locking.alone_in(folder.path))
        waiting = deque((k, _read(folder.path)) for k, folder in enumerate(folders))
        bar.update(sum(folder.rows_written() for folder in folders))
        for (k, before), (after, result) in executor.each(
            workers, _slice, waiting, setups, name=lambda item: f"the run in {folders[item[0]].path}", alike=False
        ):
            rows = folders[k].rows_written()
            _write(folders[k].path, {name: text for name, text in after.items() if before.get(name) != text})
            bar.update(folders[k].rows_written() - rows)
            if result is None:
                waiting.append((k, after))
            else:
                found[k] = result
    return [found[k] for k in range(len(folders))]


def _slice(setups: Sequence[Setup], item: tuple[int, Files]) -> tuple[Files, Evolution | None]:
    """On a worker: a run for some seconds; its files then, and what came out if it has ended."""
    k, carried = item
    with tempfile.TemporaryDirectory(prefix="harness-") as place:
        folder = RunFolder(Path(place))
        _write(folder.path, carried)
        try:
            return _result(folder, run(setups[k], folder, _Clock(folder.rows_written())))
        except _Pause:
            return _result(folder, None)


def _result(folder: RunFolder, result: Evolution | None) -> tuple[Files, Evolution | None]:
    return _read(folder.path), result


class _Pause(Exception):
    """The slice is over."""


class _Clock:
    """Watches a run, and ends its slice."""

    def __init__(self, known: int) -> None:
        self._left, self._until = known + _LEAST, time.monotonic() + SLICE

    def __call__(self, row: Mapping[str, Any]) -> None:
        self._left -= 1
        if self._left <= 0 and time.monotonic() > self._until:
            raise _Pause


def _read(folder: Path) -> Files:
    paths = (path for path in folder.iterdir() if path.is_file() and path.name != locking.LOCK)
    return {path.name: path.read_bytes() for path in paths}


def _write(folder: Path, contents: Files) -> None:
    for name in sorted(contents, key=lambda name: _LAST.index(name) if name in _LAST else -1):
        with files.replacing(folder / name) as file:
            file.write(contents[name])
