"""``harness.evolve``: one run or many, in memory or in folders, begun or resumed."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness import files, host, locking
from harness.errors import HarnessError, check_whole
from harness.ge import presets, slices
from harness.ge.folder import PREFIX, Plan, RunFolder, check_new
from harness.ge.parameters import Parameters, from_record
from harness.ge.results import Evolution, Evolutions
from harness.ge.search import Setup, config_of, prepare, restore, run
from harness.model.domain import Domain
from harness.play import cluster, executor
from harness.play.executor import Workers
from harness.progress import Bar, Progress

MOST_RUNS = 10_000
"""Runs of one plan at most."""


@locking.alone
def evolve(
    domain: Domain | str,
    grammar: str | Path | None = None,
    *,
    preset: str = "paper",
    runs: int = 1,
    out: str | Path | None = None,
    engine: str = "tables",
    workers: int | None = None,
    progress: Progress = False,
    **parameters: Any,
) -> Evolution | Evolutions:
    """Evolve a program for a domain by grammatical evolution.

    Args:
        domain: a domain or its name.
        grammar: a BNF file or the name of a shipped grammar; by default the paper's for the domain.
        preset: parameters to begin with (:data:`harness.ge.presets.PRESETS`): ``paper`` or ``best``; those given go
            before it.
        runs: how many independent runs, with the seeds ``seed``, ``seed`` + 1, …
        out: folder for the run's files (:mod:`harness.ge.folder`); many runs get one folder each in it. Without it
            nothing is kept on disk.
        engine: ``tables``, ``julia`` or ``auto``. The default is the embedded engine even where Julia is set up: the
            programs are the same, and found many times faster.
        workers: threads of one run, processes of many (default: as many as there are cores); they change no number.
        progress: True for a bar on a terminal, or a function that is called with the number of generations finished
            since its last call.
        parameters: of the run, see :class:`harness.ge.parameters.Parameters`: ``population``, ``generations``,
            ``episodes``, ``seed``, ``shaping``, ``loop``, ``tournament``, ``crossover``, ``mutation``, …

    Returns:
        :class:`harness.ge.results.Evolution` for one run, :class:`harness.ge.results.Evolutions` for more.

    Raises:
        HarnessError: an argument, the grammar or the folder is wrong, and nothing has run then; or a file cannot be
            written, or a worker was killed, and what ``out`` holds can be resumed.
        KeyboardInterrupt: Ctrl-C; what ``out`` holds can be resumed.
    """
    _check_runs(runs, workers)
    name = domain if isinstance(domain, str) else domain.name
    setup = prepare(domain, grammar, engine, 1, {**presets.preset(preset), **parameters})
    if runs == 1:
        folder = RunFolder(Path(out)) if out is not None else None
        if folder:
            folder.create(config_of(setup, name), setup.grammar.text)
        return _one(setup._replace(workers=host.workers(workers)), folder, progress)
    with contextlib.ExitStack() as stack:
        parent = Path(out if out is not None else stack.enter_context(tempfile.TemporaryDirectory()))
        check_new(parent)
        seeds = [setup.parameters.seed + k for k in range(runs)]
        setups = [_with_seed(setup, seed) for seed in seeds]  # also checks that there are such seeds
        Plan(parent).write(config_of(setup, name), setup.grammar.text, seeds)
        return _many(setups, _planned(parent), parent, workers, progress)


@locking.alone
def resume(
    out: str | Path,
    *,
    generations: int | None = None,
    workers: int | None = None,
    allow_code: bool = False,
    progress: Progress = False,
) -> Evolution | Evolutions:
    """Go on with what :func:`harness.evolve` began in a folder; the end is the same as without the interruption.

    Args:
        out: the folder.
        generations: go on for longer than the run was meant to.
        workers: threads of one run, processes of many.
        allow_code: load the domain even where the folder names a file, a snapshot or a Julia file.
        progress: True for a bar on a terminal, or a function that is called with the number of generations finished
            since its last call.

    Raises:
        HarnessError: the folder holds no run, a damaged one, or one on another model of the domain.
    """
    parent = Path(out)
    _check_runs(1, workers)
    folders = _planned(parent, generations) or folders_of(parent)
    if not folders:
        folder = RunFolder(parent)
        return _one(_restored(folder, host.workers(workers), generations, allow_code), folder, progress)
    setups = [_restored(folder, 1, generations, allow_code) for folder in folders]
    return _many(setups, folders, parent, workers, progress)


def folders_of(parent: Path) -> list[RunFolder]:
    """The folders of many runs, by seed; none where ``parent`` holds a single run, or nothing."""
    return [RunFolder(path.parent) for path in sorted(parent.glob(f"{PREFIX}*/config.json"), key=_seed_of)]


def begun(parent: Path) -> bool:
    """Whether a folder holds runs that :func:`resume` goes on with."""
    return Plan(parent).path.exists() or bool(folders_of(parent)) or (parent / "config.json").exists()


def _planned(parent: Path, generations: int | None = None) -> list[RunFolder]:
    """The folders of all runs in the plan, made or prolonged where they lack that; none where there is no plan."""
    plan = Plan(parent)
    if not plan.path.exists():
        return []
    config, grammar, seeds = plan.read()
    if generations is not None:
        config = _with(config, generations=generations)
        plan.write(config, grammar, seeds)
    least = from_record(config["parameters"]).generations
    folders = [RunFolder(parent / f"{PREFIX}{seed}") for seed in seeds]
    for folder, seed in zip(folders, seeds, strict=True):
        if not (folder.path / "config.json").exists():
            folder.create(_with(config, seed=seed), grammar)
        elif from_record(folder.config()["parameters"]).generations < least:
            folder.prolong(least)
    return folders


def _with(config: Mapping[str, Any], **parameters: int) -> dict[str, Any]:
    return {**config, "parameters": {**config["parameters"], **parameters}}


def _restored(folder: RunFolder, workers: int, generations: int | None, allow_code: bool) -> Setup:
    setup = restore(folder, workers, generations, allow_code)
    state = folder.state()
    if generations is not None:
        if state and generations < state.generation:
            raise HarnessError(f"{folder.path} is at generation {state.generation} already; ask for more of them")
        folder.prolong(generations)
    return setup


def _seed_of(config: Path) -> tuple[int, str]:
    number = config.parent.name.removeprefix(PREFIX)
    return (int(number), "") if number.isdecimal() else (-1, number)


def _with_seed(setup: Setup, seed: int) -> Setup:
    return setup._replace(parameters=Parameters(**{**setup.parameters.__dict__, "seed": seed}))


def _check_runs(runs: int, workers: int | None) -> None:
    check_whole("runs", runs, 1, MOST_RUNS)
    host.workers(workers)


def _one(setup: Setup, folder: RunFolder | None, progress: Progress) -> Evolution:
    with _bar(setup.parameters.generations + 1, progress) as bar:

        def watch(row: Mapping[str, Any]) -> None:
            best = f"best {row['best']:.1f} (fresh {row['test']:.1f})"
            bar.set_postfix_str(f"{best}, mean {row['mean']:.1f}, invalid {row['invalid']:.0%}", refresh=False)
            bar.update()

        return run(setup, folder, watch)


def _many(
    setups: Sequence[Setup],
    folders: Sequence[RunFolder],
    parent: Path,
    workers: int | None,
    progress: Progress,
) -> Evolutions:
    """All runs, as many at a time as there are workers."""
    with (
        _bar(sum(setup.parameters.generations + 1 for setup in setups), progress) as bar,
        cluster.workers_for(host.workers(workers), away=setups[0].engine == "tables") as where,
    ):
        if where is None or where.here:
            result = Evolutions(_in_their_folders(where, setups, folders, bar))
        else:
            result = Evolutions(slices.play(where, setups, folders, bar))
    files.replace_text(parent / "runs.csv", result.table.to_csv(index=False, lineterminator="\n"))
    files.replace_text(parent / "curve.csv", result.curve().to_csv(lineterminator="\n"))
    return result


def _in_their_folders(
    workers: Workers | None, setups: Sequence[Setup], folders: Sequence[RunFolder], bar: Bar
) -> list[Evolution]:
    """All runs, each from its beginning to its end by a worker that sees the folder, which tells how far it is."""
    with _watching(folders, bar):
        numbers = range(len(folders))
        name = [f"the run in {folder.path}" for folder in folders].__getitem__
        return list(executor.ordered(workers, _in_worker, numbers, setups, folders, name=name, alike=False))


def _in_worker(setups: Sequence[Setup], folders: Sequence[RunFolder], k: int) -> Evolution:
    with locking.alone_in(folders[k].path):
        return run(setups[k], folders[k], lambda row: None)


def _bar(total: int, progress: Progress) -> Bar:
    return Bar(progress, total, unit="gen", leave=True)


@contextlib.contextmanager
def _watching(folders: Sequence[RunFolder], bar: Bar) -> Iterator[None]:
    done = threading.Event()

    def count() -> None:
        bar.update(sum(folder.rows_written() for folder in folders) - bar.n)

    def watch() -> None:
        while not done.wait(1.0):
            count()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        count()
