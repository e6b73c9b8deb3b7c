"""Figures 3, 4, 6 and 7: programs and thresholds found by grammatical evolution with the paper's Table 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from harness.errors import HarnessError
from harness.ge import runs
from harness.ge.folder import RunFolder
from harness.play import cluster, executor
from harness.reproduction import figures, paper, thresholds
from harness.reproduction.folder import Folder

FULL_SEARCH = "full-search"
THRESHOLD_RUNS, THRESHOLD_CURVES = "evolved-thresholds.csv", "evolved-thresholds-history.csv"


def figure_3(folder: Folder) -> None:
    """Learning curves of the full search and of both parametrized policies."""
    full_search(folder, FULL_SEARCH, paper.ROCKSAMPLE)
    curves = _thresholds(folder)
    folder.write(THRESHOLD_CURVES, curves)
    folder.write(THRESHOLD_RUNS, thresholds.winners(folder, curves))
    folder.draw("figure3.png", figures.learning(search_history(folder, FULL_SEARCH), curves))


def _thresholds(folder: Folder) -> pd.DataFrame:
    """The histories of all runs; of those that are not in their files yet, played now and written as they end."""
    jobs = {
        f"evolved-thresholds/{word}-{k}.csv": (word, k) for word in paper.HEURISTICS for k in range(folder.sizes.runs)
    }
    missing = [(name, job) for name, job in jobs.items() if not folder.has([name])]
    with cluster.workers_for(folder.workers, away=folder.engine == "tables") as workers:
        played = executor.each(workers, _evolved, missing, folder, name=lambda item: item[0], alike=False)
        for (name, _), history in played:
            folder.write(name, history)
    return pd.concat([folder.read(name) for name in jobs], ignore_index=True)


def _evolved(folder: Folder, item: tuple[str, tuple[str, int]]) -> pd.DataFrame:
    word, seed = item[1]
    return thresholds.evolve(folder, word, seed).assign(heuristic=word, seed=seed)


def figure_6(folder: Folder) -> None:
    """BorderCross with each reward shaping: what the search sees, and the true team return."""
    for shaping in paper.SHAPINGS:
        full_search(folder, crossing(shaping), paper.BORDERCROSS, shaping=shaping)
    histories = [search_history(folder, crossing(s)).assign(shaping=s) for s in paper.SHAPINGS]
    folder.draw("figure6.png", figures.crossing(pd.concat(histories, ignore_index=True)))


def crossing(shaping: str) -> str:
    """The folder of the runs on BorderCross with a shaping."""
    return f"bordercross-{shaping}"


def full_search(folder: Folder, name: str, domain: str, **options: Any) -> None:
    """Evolve programs in a folder of their own, or go on with it."""
    s, path = folder.sizes, folder.path / name
    common: dict[str, Any] = {"workers": folder.workers, "progress": folder.progress}
    if runs.begun(path):
        runs.resume(path, **common)
    else:
        _begin(folder, path, domain, **common, **options)
    folder.seal([f"{name}/seed-{k}/best.json" for k in range(s.runs)])


def _begin(folder: Folder, path: Path, domain: str, **options: Any) -> None:
    s = folder.sizes
    seeds: dict[str, Any] = {"runs": s.runs, "out": path} if s.runs > 1 else {"runs": 1, "out": path / "seed-0"}
    runs.evolve(
        domain,
        engine=folder.engine,
        population=s.population,
        episodes=s.training_episodes,
        generations=s.generations,
        test_episodes=s.test_episodes,
        score_episodes=s.episodes,
        **seeds,
        **options,
    )


def search_history(folder: Folder, name: str) -> pd.DataFrame:
    """The histories of all runs, with a column ``seed``."""
    tables = [_history(folder.path / name / f"seed-{k}").assign(seed=k) for k in range(folder.sizes.runs)]
    return pd.concat(tables, ignore_index=True)


def _history(path: Path) -> pd.DataFrame:
    state = RunFolder(path).state()
    if state is None:
        raise HarnessError(f"{path} has lost its checkpoint.npz; put it back, or start anew in another folder")
    return pd.DataFrame(state.rows)


def winners(folder: Folder, name: str) -> list[dict[str, Any]]:
    """``best.json`` of every run."""
    return [folder.read_json(f"{name}/seed-{k}/best.json") for k in range(folder.sizes.runs)]


def best(folder: Folder, name: str) -> dict[str, Any]:
    """That of the run whose winner did best among its finalists: its score was not looked at for that."""
    chosen: dict[str, Any] = max(winners(folder, name), key=lambda record: float(record["validation"]))
    return chosen
