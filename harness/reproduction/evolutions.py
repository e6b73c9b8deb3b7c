"""Figures 3, 4, 6 and 7: programs and thresholds found by grammatical evolution with the paper's Table 2."""

from __future__ import annotations

import os
from typing import Any

import joblib
import pandas as pd

from harness import host
from harness.ge import runs
from harness.reproduction import figures, paper, thresholds
from harness.reproduction.folder import Folder

FULL_SEARCH = "full-search"
THRESHOLD_RUNS, THRESHOLD_CURVES = "evolved-thresholds.csv", "evolved-thresholds-history.csv"


def figure_3(folder: Folder) -> None:
    """Learning curves of the full search and of both parametrized policies."""
    full_search(folder, FULL_SEARCH, paper.ROCKSAMPLE)
    jobs = [(word, seed) for word in paper.HEURISTICS for seed in range(folder.sizes.runs)]
    parallel = joblib.Parallel(n_jobs=folder.workers, initializer=host.end_with, initargs=(os.getpid(),))
    histories = parallel(joblib.delayed(_thresholds)(folder, *job) for job in jobs)
    curves = pd.concat(histories, ignore_index=True)
    folder.write(THRESHOLD_CURVES, curves)
    folder.write(THRESHOLD_RUNS, thresholds.winners(folder, curves))
    folder.draw("figure3.png", figures.learning(search_history(folder, FULL_SEARCH), curves))


def _thresholds(folder: Folder, word: str, seed: int) -> pd.DataFrame:
    """The history of one run; from its file where it is whole."""
    name = f"evolved-thresholds/{word}-{seed}.csv"
    if not folder.has([name]):
        folder.write(name, thresholds.evolve(folder, word, seed).assign(heuristic=word, seed=seed))
    return folder.read(name)


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
        return
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
        **common,
        **options,
    )


def search_history(folder: Folder, name: str) -> pd.DataFrame:
    """The histories of all runs, with a column ``seed``."""
    tables = [folder.read(f"{name}/seed-{k}/history.csv").assign(seed=k) for k in range(folder.sizes.runs)]
    return pd.concat(tables, ignore_index=True)


def winners(folder: Folder, name: str) -> list[dict[str, Any]]:
    """``best.json`` of every run."""
    return [folder.read_json(f"{name}/seed-{k}/best.json") for k in range(folder.sizes.runs)]


def best(folder: Folder, name: str) -> dict[str, Any]:
    """That of the run whose winner did best among its finalists: its score was not looked at for that."""
    chosen: dict[str, Any] = max(winners(folder, name), key=lambda record: float(record["validation"]))
    return chosen
