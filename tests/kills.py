"""Strikes at everything that writes: SIGKILL at random moments, and disks that fail at a random operation.

    python -m tests.kills --strikes 300         # all cases in turn, until so many strikes have hit
    python -m tests.kills --strikes 20 evolve tune

Each try strikes a command once to three times, goes on with it, and compares what it leaves with what an uninterrupted
run left, bit for bit (but for times). Commands run in forks of this process, which has loaded everything already.
A failing disk must be told in one sentence with exit status 2. `make kills` runs it; a few strikes are in the tests.
"""

from __future__ import annotations

import argparse
import builtins
import contextlib
import csv
import errno
import io
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import harness
from harness.benchmark.budgets import Budget
from harness.cli import main
from harness.reproduction import QUICK, reproduce

TABLES = ["--engine", "tables"]
SEARCH = ["rocksample-7x8", *TABLES, "--population", "20", "--episodes", "20", "--max-init-depth", "20"]
SEARCH += ["--test-episodes", "50", "--validation-episodes", "50", "--score-episodes", "100"]
MANY = [*SEARCH, "--generations", "15", "--runs", "3"]
SCORES = """[[score]]
domain = "rocksample-7x8"
policy = "belief:0.84"
episodes = 500

[[score]]
domain = "rocksample-7x8"
policy = "exit"
episodes = 100
"""
TINY = replace(
    QUICK, episodes=60, gradient_episodes=30, training_episodes=6, test_episodes=20, population=10, generations=3,
    threshold_generations=2, runs=2,
)  # fmt: skip

SMALL = Budget("small", 300, 3, ("rollout:2", "pomcp:4", "despot:4"))

Run = Callable[[Path], int]


@dataclass(frozen=True)
class Case:
    """A command that leaves something in a folder."""

    start: Run
    go_on: Run
    """Where ``begun`` is there; otherwise it is started again."""
    begun: str
    forks: bool = False
    """Whether it works in processes of its own, where no disk fails."""
    prepare: Callable[[Path], object] = lambda folder: None


def command(*words: str) -> Run:
    """A command of the harness; DIR stands for the folder."""
    return lambda folder: main([word.replace("DIR", str(folder)) for word in words])


def reproduced(folder: Path) -> int:
    reproduce(folder, TINY, workers=1)
    return 0


def suited(folder: Path) -> int:
    harness.suite(folder, SMALL, domains=["bordercross-7x8-random"], workers=2)
    return 0


def scored(folder: Path) -> int:
    return main(["check", str(folder / "scores.toml"), "--update"])


def list_scores(folder: Path) -> None:
    folder.mkdir()
    (folder / "scores.toml").write_text(SCORES)


TUNE = ["tune", "rocksample-7x8", "--policy", "belief:0.6", *TABLES, "--set", "episodes=200", "--set", "iterations=25"]
TUNE += ["--set", "validation_episodes=200", "--set", "final_episodes=200"]
SWEEP = ["sweep", "rocksample-7x8", "--policy", "belief", *TABLES, "--points", "9", "--episodes", "300"]
CASES = {
    "evolve": Case(
        command("evolve", *SEARCH, "--generations", "60", "--out", "DIR"), command("evolve", "--resume", "DIR"),
        "config.json",
    ),
    "evolve-runs": Case(
        command("evolve", *MANY, "--out", "DIR", "--workers", "2"),
        command("evolve", "--resume", "DIR", "--workers", "2"), "plan.json", forks=True,
    ),
    "evolve-runs-threads": Case(
        command("evolve", *MANY, "--out", "DIR", "--cluster", "threads:2"),
        command("evolve", "--resume", "DIR", "--cluster", "threads:2"), "plan.json",
    ),
    "tune": Case(
        command(*TUNE, "--out", "DIR"), command("tune", "--resume", "DIR"),
        "config.json",
    ),
    "sweep": Case(command(*SWEEP, "--out", "DIR"), command("sweep", "--resume", "DIR"), "sweep.json"),
    "reproduce": Case(reproduced, reproduced, "config.json"),
    "suite": Case(suited, suited, "config.json"),
    "check --update": Case(scored, scored, "scores.toml", prepare=list_scores),
}  # fmt: skip


class Failing:
    """A disk under a folder that fails at the n-th operation which would change something, and counts them."""

    def __init__(self, folder: Path, at: int, number: int) -> None:
        self.folder, self.at, self.number, self.count = str(folder), at, number, 0
        self._handles: set[int] = set()

    def operation(self) -> None:
        self.count += 1
        if self.count == self.at:
            raise OSError(self.number, os.strerror(self.number))

    def _here(self, path: object) -> bool:
        return path in self._handles if isinstance(path, int) else str(path).startswith(self.folder)

    def install(self) -> None:
        """Stand before the operating system's functions, in this process for good."""
        for name in ("replace", "rename", "mkdir", "chmod", "fsync"):
            setattr(os, name, self._checked(getattr(os, name)))
        opened, os_open = io.open, os.open

        def open_handle(path, flags, *rest, **options):
            if not self._here(path) or not flags & (os.O_WRONLY | os.O_RDWR):
                return os_open(path, flags, *rest, **options)
            self.operation()
            handle = os_open(path, flags, *rest, **options)
            self._handles.add(handle)
            return handle

        def open_file(path, mode="r", *rest, **options):
            writes = self._here(path) and set(mode) & set("wax+")
            if writes and not isinstance(path, int):
                self.operation()
            file = opened(path, mode, *rest, **options)
            return _Writing(file, self) if writes else file

        os.open, io.open, builtins.open = open_handle, open_file, open_file

    def _checked(self, function):
        def checked(path, *rest, **options):
            if self._here(path):
                self.operation()
            return function(path, *rest, **options)

        return checked


class _Writing:
    """A file whose writes may fail."""

    def __init__(self, file, disk: Failing) -> None:
        self._file, self._disk = file, disk

    def __getattr__(self, name):
        return getattr(self._file, name)

    def __enter__(self):
        return self

    def __exit__(self, *reason):
        self._file.close()

    def write(self, content):
        self._disk.operation()
        return self._file.write(content)


def fork(run: Run, folder: Path, disk: Failing | None = None) -> int:
    """Run in a fork whose output goes to the files ``said`` and ``told`` beside the folder; its process number."""
    process = os.fork()
    if process:
        return process
    status = 70
    try:
        os.setpgid(0, 0)
        for stream, name in ((1, "said"), (2, "told")):
            os.dup2(os.open(folder.with_name(name), os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        if disk:
            disk.install()
        status = _status(run, folder)
        if disk:
            folder.with_name("count").write_text(str(disk.count))
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _status(run: Run, folder: Path) -> int:
    try:
        return run(folder)
    except harness.HarnessError as error:  # of what is called from Python
        print(f"harness: {error}", file=sys.stderr)
        return 2
    except BaseException:
        import traceback

        traceback.print_exc()
        return 70


def finish(process: int) -> int:
    """Wait for a fork to end; its exit status."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def kill_later(process: int, seconds: float) -> bool:
    """Kill a fork after a time; whether it was still at work."""
    time.sleep(seconds)
    os.kill(process, signal.SIGKILL)
    return finish(process) == -signal.SIGKILL


def contents(folder: Path) -> dict[str, object]:
    """All that a folder holds, but for times and pictures (which show no more than the tables do)."""
    return {str(path.relative_to(folder)): _content(path) for path in sorted(folder.rglob("*")) if _counts(path)}


def _counts(path: Path) -> bool:
    return path.is_file() and path.suffix not in (".png", ".npz", ".sha256")


def _content(path: Path) -> object:
    if path.suffix != ".csv":
        return re.sub(rb'^  "seconds": .*\n', b"", path.read_bytes(), flags=re.MULTILINE)
    with path.open(newline="") as file:
        return [{name: x for name, x in row.items() if name != "seconds"} for row in csv.DictReader(file)]


class Striker:
    """Strikes at one case, again and again."""

    def __init__(self, name: str, folder: Path, chance: random.Random) -> None:
        """Runs the case without interruption, for its results, its duration and the number of its operations."""
        self.name, self.case, self.chance = name, CASES[name], chance
        self.strikes = self.equal = self.tries = 0
        self.faults: list[str] = []
        self._root = folder / name.replace(" ", "")
        self.duration, self.operations = 0.0, 0
        self._whole = self._reference()

    def _reference(self) -> dict[str, object]:
        for _ in range(2):  # twice: the first one compiles
            folder = self._new()
            began = time.monotonic()
            if finish(fork(self.case.start, folder, Failing(folder, 0, 0))):
                raise SystemExit(f"{self.name}: {folder.with_name('told').read_text()}")
            self.duration = time.monotonic() - began
        self.operations = int(folder.with_name("count").read_text())
        print(f"{self.name}: {self.duration:.1f} s, {self.operations} operations that may fail", flush=True)
        return contents(folder)

    def _new(self) -> Path:
        shutil.rmtree(self._root, ignore_errors=True)
        self._root.mkdir(parents=True)
        self.case.prepare(self._root / "run")
        return self._root / "run"

    def strike(self) -> None:
        """One try: struck once to three times, gone on with, and compared."""
        folder, before, hits = self._new(), len(self.faults), []
        for _ in range(self.chance.randint(1, 3)):
            hit = self._kill(folder) if self.case.forks or self.chance.random() < 0.6 else self._fail(folder)
            hits += [hit] if hit else []
        status = finish(fork(self._run(folder), folder))
        self.tries += 1
        self.strikes += len(hits)
        if status:
            self._fault(f"after {', '.join(hits)} it ends with {status}: {folder.with_name('told').read_text()[-600:]}")
        elif (found := contents(folder)) != self._whole:
            other = [name for name in {**found, **self._whole} if found.get(name) != self._whole.get(name)]
            self._fault(f"after {', '.join(hits)} these differ: {', '.join(other)}")
        self.equal += len(hits) if len(self.faults) == before else 0

    def _run(self, folder: Path) -> Run:
        return self.case.go_on if (folder / self.case.begun).exists() else self.case.start

    def _kill(self, folder: Path) -> str:
        seconds = self.chance.uniform(0, self.duration)
        return f"a kill at {seconds:.3f} s" if kill_later(fork(self._run(folder), folder), seconds) else ""

    def _fail(self, folder: Path) -> str:
        number = self.chance.choice([errno.ENOSPC, errno.EIO, errno.EACCES])
        at = self.chance.randint(1, self.operations)
        status = finish(fork(self._run(folder), folder, Failing(folder, at, number)))
        told = folder.with_name("told").read_text()
        hit = f"{errno.errorcode[number]} at operation {at}"
        if status == 2 and told.startswith("harness: ") and told.count("\n") == 1:
            return hit
        if status != 0:
            self._fault(f"{hit}: status {status}, told {told[-600:]!r}")
        return ""  # it ended before, or what failed did not matter

    def _fault(self, words: str) -> None:
        self.faults.append(words)
        print(f"{self.name}: {words}", flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--strikes", type=int, default=300, metavar="N", help="that hit, in all (default 300)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the moments (default 0)")
    return parser.parse_args()


def strike_all() -> int:
    """Run the script; 0 where every try ended equal."""
    options = _arguments()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        strikers = [Striker(name, Path(folder), chance) for name in options.cases or CASES]
        with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C: enough
            while sum(striker.strikes for striker in strikers) < options.strikes:
                for striker in strikers:
                    striker.strike()
    for s in strikers:
        print(
            f"{s.name}: {s.equal} of {s.strikes} kills and faults in {s.tries} tries ended equal ({s.duration:.1f} s)"
        )
    print(f"{sum(s.equal for s in strikers)} of {sum(s.strikes for s in strikers)} ended equal")
    return int(any(s.faults for s in strikers))


if __name__ == "__main__":
    raise SystemExit(strike_all())
