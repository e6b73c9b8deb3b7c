"""``progress=`` means the same everywhere."""

from __future__ import annotations

import pytest

import harness
from harness.regression import checking

SMALL = {"engine": "tables", "episodes": 40}
EVOLVE = {"population": 4, "generations": 3, "episodes": 5, "validation_episodes": 10, "engine": "tables"}
ROW = '[[score]]\ndomain = "rocksample-7x8"\npolicy = "exit"\nepisodes = 40\nengine = "tables"\n'


def sweep(**progress):
    harness.sweep("rocksample-7x8", "belief", points=3, **SMALL, **progress)


def tune(**progress):
    small = {"engine": "tables", "final_episodes": 40}
    harness.tune("rocksample-7x8", "belief", iterations=3, method="spsa", **small, **progress)


def update(**progress):
    checking.update_scores("scores.toml", **progress)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scores.toml").write_text(ROW + ROW.replace("exit", "random"))


@pytest.mark.parametrize(
    ("run", "total"),
    [
        (lambda **p: harness.evaluate("rocksample-7x8", "belief", workers=2, **SMALL, **p), 40),
        (lambda **p: harness.compare("rocksample-7x8", ["belief", "exit", "mdp"], **SMALL, **p), 80),
        (sweep, 3),
        (tune, 3),
        (update, 2),
        (lambda **p: harness.evolve("rocksample-7x8", out="run", **EVOLVE, **p), 4),
        (lambda **p: harness.evolve("rocksample-7x8", out="runs", runs=2, workers=1, **EVOLVE, **p), 8),
    ],
    ids=["evaluate", "compare", "sweep", "tune", "update_scores", "evolve", "evolve-runs"],
)
def test_a_function_is_told_and_a_bar_stays_off_files(run, total, capsys, tmp_path):
    told = []
    run(progress=told.append)
    assert sum(told) == total
    assert capsys.readouterr().err == ""


def test_true_is_a_bar_on_a_terminal_only(capsys):
    sweep(progress=True)
    assert capsys.readouterr().err == ""
