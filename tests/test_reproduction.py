"""The reproduction: every file and every published value, interruptions, misuse."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

import harness
from harness.cli import main
from harness.engine import rng
from harness.play.evaluation import evaluate
from harness.reproduction import FULL, QUICK, Sizes, reproduce, thresholds, wording
from harness.reproduction.figures import best_stretch
from harness.reproduction.steps import STEPS
from tests.test_cli import PATIENCE

TINY = Sizes(
    episodes=60,
    rollout_episodes=3,
    sweep_points=6,
    sweep_episodes=50,
    gradient_episodes=60,
    runs=2,
    population=12,
    training_episodes=5,
    generations=3,
    threshold_generations=3,
    test_episodes=10,
)

# Typed off the paper, section by section; nothing of it is taken from the package.
IN_THE_PAPER = {
    "problem": [("published |S| =", "12,544")],
    "Table 1": [("Rollout", "9.46"), ("SARSOP", "21.39")],
    "section 5": [("random rollouts earn about", "12.8 %"), ("SARSOP would get at most", "30 %")],
    "Table 2": [
        ("Individuals in population", "250"),
        ("Episodes", "100"),
        ("Generations", "500 / 399"),
        ("Max steps", "50"),
        ("Penalty for long codes", "max([0,length - 50])*0.1"),
    ],
    "Table 3": [
        ("Episodes", "10000"),
        ("Error Tolerance", "0.001"),
        ("γ (momentum)", "0.2"),
        ("ε (forward difference; the symbol is lost in print)", "0.01"),
        ("α0", "0.05"),
        ("α_{t+1}", "α_t exp(−t/20)"),
    ],
    "gradient ascent": [("accuracy, gradient", "λ = 0.9310"), ("belief, gradient", "γ = 0.8439")],
    "evolution": [("accuracy, evolved", "λ = 0.93"), ("belief, evolved", "γ = 0.74")],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("reproduction") / "paper"
    reproduce(path, TINY, engine="tables", workers=1)
    return path


def contents(folder):
    """All files but those that hold times or dates."""
    skipped = ("history.csv", "config.json", "best.json", "checkpoint.npz", "results.sha256")
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in skipped
    }


class TestReport:
    def test_all_files_are_there(self, folder):
        for step in STEPS:
            for name in step.files:
                assert (folder / name).stat().st_size > 0
        figures = sorted(path.name for path in folder.glob("figure*.png"))
        assert figures == ["figure1.png", "figure2.png", "figure3.png", "figure5.png", "figure6.png"]
        for name in figures:
            picture = imread(folder / name)
            assert picture.shape[1] > 700
            assert picture[..., :3].std() > 0.02
        report = (folder / "report.md").read_text()
        assert set(re.findall(r"\((figure\d\.png)\)", report)) == set(figures)
        for k in range(1, 8):
            assert re.search(rf"^## Figures?.*{k}" if k != 2 else r"^## Figures 1 and 2", report, re.MULTILINE)

    @pytest.mark.parametrize("part", IN_THE_PAPER)
    def test_every_published_value_is_in_the_report(self, folder, part):
        report = (folder / "report.md").read_text()
        for name, value in IN_THE_PAPER[part]:
            row = rf"\| {re.escape(name)} +\| {re.escape(value)} +\|"  # beside ours, in a table
            assert re.search(row, report) or f"{name} {value}" in report

    def test_smaller_sizes_are_said(self, folder):
        report = (folder / "report.md").read_text()
        assert "Smaller than the paper's sizes" in report
        assert "population 12 (full: 250)" in report

    def test_ours_are_what_the_harness_says(self, folder):
        """Table 1's own column, worked out anew."""
        report = (folder / "report.md").read_text()
        table = harness.compare("rocksample-7x8", ["sarsop"], episodes=60, engine="tables").iloc[0]
        row = next(line for line in report.splitlines() if line.startswith("| SARSOP"))
        assert f"{table['discounted_mean']:.2f} ± {table['discounted_sem']:.2f}" in row
        points = pd.read_csv(folder / "thresholds.csv")
        for _, point in points.iterrows():
            spec = f"{point['heuristic']}:{point['published']}"
            returns = evaluate("rocksample-7x8", spec, episodes=60, seed=rng.HELD_OUT, engine="tables").returns
            assert point["mean"] == pytest.approx(returns.mean())
        plateau = points.set_index(["heuristic", "what"])["plateau"]
        assert plateau["belief"].all()
        assert not plateau["accuracy"].any()

    def test_programs_are_those_of_the_runs(self, folder, rocksample):
        text = (folder / "figure4.txt").read_text()
        program = text.partition("\n")[2]
        winners = [(folder / "full-search" / f"seed-{k}" / "best.txt").read_text() for k in range(2)]
        assert program in winners


class TestPieces:
    def test_verdicts(self):
        assert wording.verdict(10.0, 0.5, 9.46).startswith("agrees (+0.54")
        assert wording.verdict(10.0, 0.1, 9.46) == "differs (+0.54, 5.4 standard errors)"
        assert wording.verdict(10.0, 0.0, 9.46) == "differs (+0.54)"
        assert wording.verdict(9.46, 0.0, 9.46).startswith("agrees")

    def test_best_stretch(self):
        sweep = pd.DataFrame({"threshold": [0.5, 0.6, 0.7, 0.8], "mean": [1.0, 3.0, 3.0, 2.0]})
        assert best_stretch(sweep) == (0.6, 0.7)

    def test_the_sizes_are_the_papers(self):
        assert (FULL.population, FULL.training_episodes, FULL.generations, FULL.threshold_generations) == (
            250, 100, 500, 399,
        )  # fmt: skip
        assert FULL.gradient_episodes == 10_000
        assert all(getattr(QUICK, name) <= getattr(FULL, name) for name in vars(FULL))

    def test_sentences_of_the_tiny_grammar_are_policies(self, rocksample):
        from harness import policy
        from harness.ge.mapping import derive

        grammar = thresholds.grammar("belief")
        texts = {derive(grammar, np.array([a, b], dtype=np.int32)).phenotype for a in range(5) for b in range(10)}
        assert texts == {f"belief:{k / 100:.2f}" for k in range(50, 100)}
        assert all(policy.make(text, rocksample)[0] == text for text in texts)

    def test_an_evolved_threshold_is_scored_on_the_generation_s_episodes(self, folder):
        history = pd.read_csv(folder / "evolved-thresholds" / "belief-1.csv")
        assert history["generation"].tolist() == [0, 1, 2, 3]
        for _, row in history.iterrows():
            own = evaluate(
                "rocksample-7x8", row["policy"], episodes=5, seed=rng.TRAINING + 1, first=5 * row["generation"],
                engine="tables",
            )  # fmt: skip
            assert row["best"] == own.score.mean


class TestGoingOn:
    def test_what_is_there_is_kept_and_what_is_missing_made_again(self, folder, tmp_path):
        other = tmp_path / "other"
        shutil.copytree(folder, other)
        for name in ("report.md", "figure3.png", "evolved-thresholds/belief-1.csv", "figure7.txt", "sweeps.csv"):
            (other / name).unlink()
        kept = (other / "table1.csv").stat().st_mtime_ns
        lines = []
        reproduce(other, TINY, engine="tables", workers=2, tell=lines.append)
        assert contents(other) == contents(folder)
        assert (other / "table1.csv").stat().st_mtime_ns == kept
        assert [line for line in lines if "there already" in line] == [
            f"{name}: there already" for name in ("Table 1", "Figures 1 and 2", "Figure 4", "Figure 6")
        ]

    @pytest.mark.parametrize("step", ["figure_3", "figure_6"])
    def test_interrupted_between_runs_it_ends_the_same(self, folder, tmp_path, monkeypatch, step):
        """Ctrl-C after a search of the step, before its picture."""
        from harness.reproduction import figures

        def stop(*tables):
            raise KeyboardInterrupt

        other = tmp_path / "other"
        shutil.copytree(folder, other)
        picture, name = {"figure_3": ("figure3.png", "learning"), "figure_6": ("figure6.png", "crossing")}[step]
        (other / picture).unlink()
        configs = sorted(other.glob("*/seed-*/config.json"))
        times = [path.stat().st_mtime_ns for path in configs]
        monkeypatch.setattr(figures, name, stop)
        with pytest.raises(KeyboardInterrupt):
            reproduce(other, TINY, engine="tables", workers=1)
        monkeypatch.undo()
        reproduce(other, TINY, engine="tables", workers=1)
        assert contents(other) == contents(folder)
        assert [path.stat().st_mtime_ns for path in configs] == times  # resumed, not begun anew
        assert len(configs) == 8

    def test_ctrl_c_says_how_to_go_on(self, tmp_path):
        out = tmp_path / "run"
        process = subprocess.Popen(
            [sys.executable, "-m", "harness", "reproduce", "--quick", "--engine", "tables", "--out", str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        while not (out / "config.json").exists() and process.poll() is None:
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
        assert process.returncode == 130
        assert f"go on with: harness reproduce --quick --out {out}" in err
        assert "Traceback" not in err


class TestMisuse:
    def refused(self, capsys, *arguments):
        try:
            status = main(["reproduce", *arguments])
        except SystemExit as error:
            status = error.code
        error = capsys.readouterr().err
        assert status == 2
        assert error.startswith("harness: ")
        assert error.count("\n") == 1
        return error

    def test_one_sentence(self, capsys, tmp_path, folder):
        assert "--out" in self.refused(capsys)
        assert "'0' is not a whole number" in self.refused(capsys, "--out", str(tmp_path / "x"), "--workers", "0")
        assert "of other sizes" in self.refused(capsys, "--out", str(folder), "--engine", "tables")
        assert "did you mean" in self.refused(capsys, "--out", str(tmp_path / "x"), "--engine", "table")
        assert not (tmp_path / "x").exists()
        (tmp_path / "notes.txt").write_text("mine")
        assert "holds other files" in self.refused(capsys, "--out", str(tmp_path), "--engine", "tables")
        assert "cannot write" in self.refused(capsys, "--out", "/dev/null/x", "--engine", "tables")

    @pytest.mark.parametrize(
        "name",
        [
            "table1.csv",
            "sweeps.csv",
            "gradient.csv",
            "thresholds.csv",
            "evolved-thresholds.csv",
            "figure4.txt",
            "figure7.txt",
            "full-search/seed-1/best.json",
            "full-search/seed-1/history.csv",
            "bordercross-paper/seed-0/history.csv",
        ],
    )
    def test_damaged_and_edited_results_are_named(self, folder, tmp_path, name):
        other = tmp_path / "other"
        shutil.copytree(folder, other)
        (other / "report.md").unlink()
        whole = (other / name).read_text()
        edited = re.sub(r"\d(?=\D*$)", lambda digit: str(9 - int(digit[0])), whole)  # its last digit is another
        for content in (edited.encode(), b"\x00\xff"):
            (other / name).write_bytes(content)
            with pytest.raises(harness.HarnessError, match=re.escape(name.rpartition("/")[2])):
                reproduce(other, TINY, engine="tables")
        (other / name).write_text(whole)
        reproduce(other, TINY, engine="tables")

    def test_an_edited_run_of_a_step_that_is_made_again_is_named(self, folder, tmp_path):
        other = tmp_path / "other"
        shutil.copytree(folder, other)
        (other / "evolved-thresholds.csv").unlink()
        path = other / "evolved-thresholds" / "belief-1.csv"
        path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")
        with pytest.raises(harness.HarnessError, match=r"belief-1\.csv is damaged, or was changed by hand; delete it"):
            reproduce(other, TINY, engine="tables", workers=1)

    def test_what_a_kill_left_half_written_goes(self, folder, tmp_path):
        other = tmp_path / "other"
        shutil.copytree(folder, other)
        (other / "report.md").unlink()
        (other / "evolved-thresholds.csv").unlink()
        (other / "evolved-thresholds" / "belief-1.csv").rename(other / "evolved-thresholds" / ".belief-1.csv.abc.part")
        reproduce(other, TINY, engine="tables", workers=1)
        assert contents(other) == contents(folder)
