"""Table 1 and the policies that the paper names beside it; Figure 5: sweeps and gradient ascent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.engine import rng
from harness.play.evaluation import evaluate
from harness.reproduction import figures, paper
from harness.reproduction.folder import Folder
from harness.score.bounds import OPTIMUM
from harness.score.comparison import compare
from harness.tuning import resume, sweep, tune

TABLE, SWEEPS, ASCENTS, POINTS = "table1.csv", "sweeps.csv", "gradient.csv", "thresholds.csv"


def table_1(folder: Folder) -> None:
    """Scores of the policies that the paper speaks of: ``table1.csv``, columns of :func:`harness.compare`."""
    s = folder.sizes
    common: dict[str, Any] = {"engine": folder.engine, "workers": folder.workers, "progress": folder.progress}
    solved = [row.policy for row in paper.table_1() if not row.policy.startswith("rollout")]
    thresholds = [f"{word}:{x}" for word in paper.HEURISTICS for x in (paper.GRADIENT[word], paper.EVOLVED[word])]
    quick = ["random", "random-legal", "exit", *thresholds, "qmdp", *solved]
    slow = [row.policy for row in paper.table_1() if row.policy.startswith("rollout")]
    tables = [
        compare(paper.ROCKSAMPLE, [*quick, OPTIMUM], episodes=s.episodes, **common),
        compare(paper.ROCKSAMPLE, slow, episodes=s.rollout_episodes, **common),
    ]
    folder.write(TABLE, pd.concat([t.drop(columns="reference") for t in tables], ignore_index=True))


def figure_5(folder: Folder) -> None:
    """Sweeps of both thresholds, and where gradient ascent leads (eq. 4, 5, 7; Table 3)."""
    s = folder.sizes
    sweeps = []
    for word in paper.HEURISTICS:
        table = sweep(
            paper.ROCKSAMPLE, word, points=s.sweep_points, episodes=s.sweep_episodes, engine=folder.engine,
            workers=folder.workers, progress=folder.progress,
        )  # fmt: skip
        sweeps.append(table.assign(heuristic=word))
    ascents = [_ascent(folder, word) for word in paper.HEURISTICS]
    folder.write(SWEEPS, pd.concat(sweeps, ignore_index=True))
    folder.write(ASCENTS, pd.DataFrame(ascents))
    folder.write(POINTS, _differences(folder, ascents))
    folder.draw("figure5.png", figures.sweeps(folder.read(SWEEPS), folder.read(ASCENTS)))


def _ascent(folder: Folder, word: str) -> dict[str, object]:
    path = folder.path / f"gradient-{word}"
    common: dict[str, Any] = {"engine": folder.engine, "workers": folder.workers, "progress": folder.progress}
    if (path / "config.json").exists():
        tuned = resume(path, **common)
    else:
        tuned = tune(
            paper.ROCKSAMPLE, f"{word}:{paper.START[word]}", out=path, episodes=folder.sizes.gradient_episodes,
            final_episodes=folder.sizes.episodes, **common,
        )  # fmt: skip
    (threshold,) = tuned.ended.theta.values()  # not the best: this is where the paper's method leads
    score = tuned.ended.score
    return {
        "heuristic": word,
        "start": paper.START[word],
        "threshold": threshold,
        "mean": score.mean,
        "sem": score.sem,
        "stopped": tuned.stopped,
    }


def _differences(folder: Folder, ascents: list[dict[str, object]]) -> pd.DataFrame:
    """Published thresholds against ours, on the same fresh episodes: the paired difference with its error."""
    rows = []
    for word, ascent in zip(paper.HEURISTICS, ascents, strict=True):
        ours = _returns(folder, f"{word}:{ascent['threshold']}")
        for what, value in (("gradient", paper.GRADIENT[word]), ("evolved", paper.EVOLVED[word])):
            theirs = _returns(folder, f"{word}:{value}")
            gap = theirs - ours
            rows.append(
                {
                    "heuristic": word,
                    "what": what,
                    "published": float(value),
                    "mean": theirs.mean(),
                    "sem": theirs.std(ddof=1) / np.sqrt(len(theirs)),
                    "difference": gap.mean(),
                    "difference_sem": gap.std(ddof=1) / np.sqrt(len(gap)),
                    "plateau": bool((theirs == _returns(folder, f"{word}:0.5")).all()),
                }
            )
    return pd.DataFrame(rows)


def _returns(folder: Folder, spec: str) -> NDArray[np.float64]:
    result = evaluate(
        paper.ROCKSAMPLE, spec, episodes=folder.sizes.episodes, seed=rng.HELD_OUT, engine=folder.engine,
        workers=folder.workers,
    )  # fmt: skip
    return result.returns
