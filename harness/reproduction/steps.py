"""The steps of a reproduction, and running those whose results are not there yet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from harness import engine as engines
from harness import host, locking, registry
from harness.reproduction import baselines, evolutions, figures, paper, report
from harness.reproduction.folder import Folder
from harness.reproduction.sizes import FULL, Sizes


class Step(NamedTuple):
    """A part of the paper."""

    name: str
    files: tuple[str, ...]
    """What it writes; it is whole when all of them are there."""
    run: Callable[[Folder], None]


def _figures_1_and_2(folder: Folder) -> None:
    for name, domain in (("figure1.png", paper.ROCKSAMPLE), ("figure2.png", paper.BORDERCROSS)):
        folder.draw(name, figures.layout(registry.load(domain)))


def _figure_4(folder: Folder) -> None:
    _programs(folder, "figure4.txt", {"the full policy search": evolutions.FULL_SEARCH})


def _figure_7(folder: Folder) -> None:
    _programs(folder, "figure7.txt", {f"shaping {s}": evolutions.crossing(s) for s in paper.SHAPINGS})


def _programs(folder: Folder, name: str, searches: dict[str, str]) -> None:
    """The best program of each search as text."""
    parts = []
    for title, search in searches.items():
        record = evolutions.best(folder, search)
        score = record["score"]
        parts.append(
            f"# {title}: return {score['mean']:.2f} ± {score['sem']:.2f} on {score['episodes']:,} fresh episodes\n"
            + "".join(f"{line}\n" for line in record["program"])
        )
    folder.write_text(name, "\n".join(parts))


def _report(folder: Folder) -> None:
    folder.write_text("report.md", report.text(folder))


STEPS = (
    Step("Table 1", (baselines.TABLE,), baselines.table_1),
    Step("Figures 1 and 2", ("figure1.png", "figure2.png"), _figures_1_and_2),
    Step(
        "Figure 5",
        (baselines.SWEEPS, baselines.ASCENTS, baselines.POINTS, "figure5.png"),
        baselines.figure_5,
    ),
    Step("Figure 3", (evolutions.THRESHOLD_CURVES, evolutions.THRESHOLD_RUNS, "figure3.png"), evolutions.figure_3),
    Step("Figure 4", ("figure4.txt",), _figure_4),
    Step("Figure 6", ("figure6.png",), evolutions.figure_6),
    Step("Figure 7", ("figure7.txt",), _figure_7),
    Step("the report, with Tables 2 and 3", ("report.md",), _report),
)


@locking.alone
def reproduce(
    out: str | Path,
    sizes: Sizes = FULL,
    *,
    engine: str = "tables",
    workers: int | None = None,
    progress: bool = False,
    tell: Callable[[str], object] = lambda line: None,
) -> Path:
    """Regenerate everything that the paper shows, or go on with that.

    Args:
        out: the folder. What is in it already is kept; steps whose results are there are skipped.
        sizes: how much is played: :data:`~harness.reproduction.sizes.FULL`,
            :data:`~harness.reproduction.sizes.QUICK`, or others.
        engine: ``tables``, ``julia`` or ``auto``; the results are the same.
        workers: threads, or processes of many runs; they change no number.
        progress: show progress bars on a terminal.
        tell: called with a line at the beginning of every step.

    Returns:
        The path of ``report.md``.

    Raises:
        HarnessError: the folder holds something else, or what is in it is damaged.
        KeyboardInterrupt: Ctrl-C; call it again to go on.
    """
    chosen = engines.choose(engine, registry.load(paper.ROCKSAMPLE))
    folder = Folder(Path(out), sizes, chosen, host.workers(workers), progress)
    folder.begin()
    for step in STEPS:
        done = folder.has(step.files)
        tell(f"{step.name}: {'there already' if done else ', '.join(step.files)}")
        if not done:
            step.run(folder)
    return folder.path / "report.md"
