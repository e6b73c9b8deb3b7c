"""The suite: its rows are those of compare, however it was stopped and wherever it was played."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

import harness
from harness.benchmark import budgets, playing
from harness.benchmark.budgets import Budget
from harness.benchmark.folder import SuiteFolder
from harness.benchmark.suite import ORIGIN
from harness.cli import main
from harness.regression import stored
from tests.test_cli import NO_JULIA, PATIENCE

TINY = Budget("tiny", 1_200, 3, ("rollout:2", "pomcp:4", "despot:4"))
TIGER = "notebooks/tiger/tiger.npz"
DOMAINS = ("bordercross-7x8-random", TIGER)


def tiny(out, **options):
    return harness.suite(out, TINY, **{"domains": DOMAINS, "workers": 1, **options})


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    return tiny(tmp_path_factory.mktemp("suite") / "out")


def numbers(folder):
    """All results but when they came and the seconds that they took."""
    table = pd.read_csv(folder / "suite.csv").drop(columns=["seconds", "date"])
    return table.to_csv(), (folder / "coverage.csv").read_bytes()


def stop_after(monkeypatch, count):
    """Ctrl-C when so many parts are played."""
    keep = SuiteFolder.keep_part

    def stopping(self, domain, part, played):
        nonlocal count
        keep(self, domain, part, played)
        count -= 1
        if not count:
            raise KeyboardInterrupt

    monkeypatch.setattr(SuiteFolder, "keep_part", stopping)


@pytest.fixture
def plays(monkeypatch):
    """How many parts are played from now on."""
    counted, play = [], playing.play
    monkeypatch.setattr(playing, "play", lambda *given: counted.append(given) or play(*given))
    return counted


class TestResults:
    @pytest.mark.parametrize("domain", DOMAINS)
    def test_rows_are_those_of_compare(self, done, domain):
        domain = harness.load(domain)
        mine = done.table[done.table["domain"] == domain.name].set_index("policy")
        for spec in TINY.policies(domain):
            episodes = mine.loc[spec, "episodes"]
            count = None if pd.isna(episodes) else int(episodes)
            horizon = 90 if domain.name.startswith("tiger") else 50  # it has no end, and 0.95⁹⁰ is below a hundredth
            theirs = harness.compare(domain, spec, episodes=count, horizon=horizon, engine="tables")
            for column in theirs.columns.drop(["policy", "reference"]):
                a, b = theirs.iloc[0][column], mine.loc[spec, column]
                assert a == b or (pd.isna(a) and pd.isna(b)), (spec, column)
        assert (mine["model_hash"] == domain.model_hash).all()
        assert mine.loc[mine["kind"] == "policy", "seconds"].gt(0).all()
        assert mine["versions"].str.contains("NumPy").all()

    def test_coverage_counts_domains(self, done):
        found = done.coverage.set_index("policy")
        assert found.loc["random", "played"] == 2
        assert found.loc["random", "share_domains"] == 1  # the tiger of the notebooks has no bounds stored
        assert found.loc["qmdp", "played"] == 1
        pd.testing.assert_frame_equal(pd.read_csv(done.folder / "coverage.csv"), done.coverage)

    def test_the_table_is_one_of_compare_and_pandas_opens_it(self, done):
        table = pd.read_csv(done.folder / "suite.csv")
        assert table.columns[-len(ORIGIN) :].tolist() == list(ORIGIN)
        assert len(table) == len(done.table)
        harness.render(table)

    def test_the_page_shows_all_of_it(self, done):
        page = done.page.read_text(encoding="utf-8")
        assert "Over all domains" in page
        assert page.count("Comparison on ") >= 2
        assert 'loading="' not in page

    def test_the_list_of_cheap_rows_is_one_of_the_check(self, done):
        rows = stored.read(done.folder / "scores.toml").rows
        assert ("bordercross-7x8-random", "random", 50) in [row.key[:3] for row in rows]
        assert not any(row.policy.startswith("pomcp") for row in rows)

    def test_little_is_left_when_episodes_are_cut(self):
        """RockSample's and BorderCross's at 50 steps, as the paper's; later without an end or much of a discount."""
        found = {name: playing.horizon(harness.load(name)) for name in harness.names() if "20x20" not in name}
        assert found["rocksample-7x8"] == found["bordercross-7x8"] == found["tag"] == 50
        assert found["hallway"] == found["tiger"] == 90
        assert found["heaven-hell"] == found["rocksample-7x8@pobax"] == 459

    def test_what_it_shows_of_itself(self, done):
        assert "domains 2" in repr(done)
        assert "<table" in done._repr_html_()

    def test_every_domain_that_ships_falls_in(self):
        for name in harness.names():
            domain = harness.load(name)
            for budget in (budgets.QUICK, budgets.FULL):
                specs = budget.policies(domain)
                assert {"random", "random-legal", *budget.planners[:2]} <= set(specs)
                assert len(set(specs)) == len(specs)


class TestGoingOn:
    @pytest.mark.parametrize("stop", [1, 6])
    def test_stopped_it_ends_with_the_same_numbers_and_plays_nothing_twice(
        self, done, tmp_path, monkeypatch, plays, stop
    ):
        with monkeypatch.context() as patched:
            stop_after(patched, stop)
            with pytest.raises(KeyboardInterrupt):
                tiny(tmp_path / "out")
        tiny(tmp_path / "out")
        assert numbers(tmp_path / "out") == numbers(done.folder)
        assert len(plays) == len(set(plays)) > stop
        assert not (tmp_path / "out" / "parts").exists()

    def test_done_it_plays_nothing(self, done, plays):
        lines = []
        again = harness.suite(done.folder, TINY, domains=DOMAINS, tell=lines.append)
        assert not plays
        pd.testing.assert_frame_equal(again.table.astype(str), done.table.astype(str))
        assert all("there already" in line for line in lines)

    @pytest.mark.parametrize("where", ["threads:2", "processes:1"])
    def test_elsewhere_the_numbers_are_the_same(self, done, tmp_path, where):
        with harness.cluster(where):
            tiny(tmp_path / "out")
        assert numbers(tmp_path / "out") == numbers(done.folder)

    def test_rows_of_another_model_and_parts_of_other_versions_are_played_again(
        self, done, tmp_path, plays, monkeypatch
    ):
        out = tmp_path / "out"
        shutil.copytree(done.folder, out)
        folder, domain = SuiteFolder(out), harness.load(DOMAINS[0])
        folder.keep_row(domain, "random", {**folder.row(domain, "random"), "model_hash": "another"})
        tiny(out)
        assert {part.policy for _, part in plays} == {"random"}
        assert numbers(out) == numbers(done.folder)
        part = playing.Part("random", 0, 5)
        folder.keep_part(domain, part, playing.play(domain, part))
        assert folder.part(domain, part) is not None
        monkeypatch.setattr("harness.play.executor.fingerprint", lambda: "another")
        assert folder.part(domain, part) is None

    def test_a_damaged_part_is_played_again(self, tmp_path, monkeypatch, done):
        stop_after(monkeypatch, 3)
        with pytest.raises(KeyboardInterrupt):
            tiny(tmp_path / "out")
        monkeypatch.undo()
        for path in (tmp_path / "out" / "parts").rglob("*.npz"):
            path.write_bytes(path.read_bytes()[:-40])
        tiny(tmp_path / "out")
        assert numbers(tmp_path / "out") == numbers(done.folder)

    def test_ctrl_c_of_the_command_says_how_to_go_on(self, tmp_path):
        out = tmp_path / "run"
        command = [sys.executable, "-m", "harness", "suite", TIGER, "--budget", "full", "--out", str(out)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=NO_JULIA)
        while not (out / "config.json").exists() and process.poll() is None:
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
        assert process.returncode == 130
        assert f"go on with: harness suite {TIGER} --budget full --out {out}" in err
        assert "Traceback" not in err


class TestMisuse:
    def test_one_sentence(self, done, tmp_path, capsys):
        (tmp_path / "notes.txt").write_text("mine")
        for words, message in (
            (["suite"], "--out"),
            (["suite", "--budget", "quik", "--out", "x"], "quik"),
            (["suite", "--out", str(done.folder)], "of another budget"),
            (["suite", "--out", str(tmp_path)], "holds other files and no suite"),
            (["suite", TIGER, TIGER, "--out", str(tmp_path / "x")], "given twice"),
            (["suite", "tigre", "--out", str(tmp_path / "x")], "no domain 'tigre'"),
        ):
            try:
                status = main(words)
            except SystemExit as error:
                status = error.code
            error = capsys.readouterr().err
            assert status == 2
            assert message in error
            assert error.count("\n") == 1
        assert not (tmp_path / "x").exists()
        with pytest.raises(harness.HarnessError, match="no budget 'quik'; did you mean 'quick'"):
            harness.suite(tmp_path / "x", "quik")

    def test_an_edited_row_is_named(self, done, tmp_path):
        out = tmp_path / "out"
        shutil.copytree(done.folder, out)
        path = out / "rows" / DOMAINS[0] / "random.json"
        path.write_text(re.sub(r'"mean": -\d', '"mean": 1', path.read_text()))
        with pytest.raises(harness.HarnessError, match=r"random\.json is damaged, or was changed by hand; delete it"):
            tiny(out)
        path.unlink()
        tiny(out)
        assert numbers(out) == numbers(done.folder)
