"""Sweeps that keep their rows: interrupted anywhere, resumed, damaged."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import harness
from harness.cli import main
from harness.tuning import sweeping
from tests.test_cli import NO_JULIA, PATIENCE

OPTIONS = ["--from", "0.8", "--points", "41", "--episodes", "4000", "--seed", "3", "--horizon", "40"]
COMMAND = ["sweep", "rocksample-7x8", "--policy", "belief", *OPTIONS, "--engine", "tables"]
TEXT = "check(2)\nif(belief(2) > 0.9) down()\nif(not (belief(2) < 0.25)) sample()\nright()\n"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "sweep"
    assert main([*COMMAND, "--out", str(folder)]) == 0
    return folder


def count(folder):
    path = folder / "sweep.csv"
    return path.read_text().count("\n") - 1 if path.exists() else 0


def same(folder, whole):
    return all((folder / name).read_bytes() == (whole / name).read_bytes() for name in ("sweep.json", "sweep.csv"))


class TestProcesses:
    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
    def test_stopped_and_resumed_it_is_the_same_sweep(self, tmp_path, whole, capsys, number):
        folder = tmp_path / "cut"
        process = subprocess.Popen(
            [sys.executable, "-m", "harness", *COMMAND, "--out", str(folder)], stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, env=NO_JULIA,
        )  # fmt: skip
        while count(folder) < 2 and process.poll() is None:
            time.sleep(0.005)
        process.send_signal(number)
        _, err = process.communicate(timeout=PATIENCE)
        assert 2 <= count(folder) < 41
        if number == signal.SIGINT:
            assert process.returncode == 130
            assert f"harness: go on with: harness sweep --resume {folder}" in err
            assert "Traceback" not in err
        assert (whole / "sweep.csv").read_bytes().startswith((folder / "sweep.csv").read_bytes())
        capsys.readouterr()
        assert main(["sweep", "--resume", str(folder)]) == 0
        assert "highest return" in capsys.readouterr().out
        assert same(folder, whole)
        assert (folder / "sweep.png").stat().st_size > 10_000


class TestFolders:
    def test_cut_anywhere_it_goes_on_and_plays_only_what_is_missing(self, tmp_path, whole, monkeypatch):
        lines = (whole / "sweep.csv").read_text().splitlines(keepends=True)
        played, plain = [], sweeping._score
        monkeypatch.setattr(sweeping, "_score", lambda *a: played.append(1) or plain(*a))
        for rows in (None, 0, 1, 40, 41):
            folder = tmp_path / str(rows)
            folder.mkdir()
            (folder / "sweep.json").write_bytes((whole / "sweep.json").read_bytes())
            if rows is not None:
                (folder / "sweep.csv").write_text("".join(lines[: rows + 1]))
            played.clear()
            table = sweeping.resume(folder, engine="tables")
            assert len(played) == 41 - (rows or 0)
            assert (folder / "sweep.csv").read_text() == table.to_csv(index=False) == "".join(lines)

    def test_it_is_the_table_without_a_folder(self, whole):
        table = harness.sweep(
            "rocksample-7x8", "belief", start=0.8, points=41, episodes=4000, seed=3, horizon=40, engine="tables"
        )
        assert (whole / "sweep.csv").read_text() == table.to_csv(index=False)

    def test_a_program_is_resumed_without_its_file(self, rocksample, tmp_path):
        source = tmp_path / "program.txt"
        source.write_text(TEXT)
        options = {"parameter": "c2", "episodes": 50, "points": 6, "engine": "tables"}
        table = harness.sweep(rocksample, f"program:{source}", out=tmp_path / "s", **options)
        assert table["c2"].tolist() == np.linspace(0, 1, 6).round(10).tolist()
        source.unlink()
        path = tmp_path / "s" / "sweep.csv"
        text = path.read_text()
        harness.sweep(rocksample, TEXT, out=tmp_path / "short", **{**options, "points": 2})
        head = (tmp_path / "short" / "sweep.csv").read_text()
        first = head[: head.index('"check(2)', head.index("down()"))]
        assert text.startswith(first)
        path.write_text(first)
        assert sweeping.resume(tmp_path / "s").equals(table)
        assert path.read_text() == text

    def test_objects_are_resumed_by_the_program_that_made_them(self, rocksample, tmp_path):
        from harness.tuning import tunable

        class Mine:
            def __init__(self):
                self.inner = tunable("belief", rocksample)
                self.names, self.start = ("x",), self.inner.start
                self.lower, self.upper = self.inner.lower, self.inner.upper

            def policy(self, theta):
                return self.inner.policy(theta)

            def text(self, theta):
                return f"mine at {theta[0]}"

        options = {"points": 4, "episodes": 20, "out": tmp_path, "engine": "tables"}
        table = harness.sweep(rocksample, Mine(), **options)
        assert harness.sweep(rocksample, Mine(), resume=True, **options).equals(table)
        with pytest.raises(harness.HarnessError, match="mine at"):
            sweeping.resume(tmp_path)


class TestMisuse:
    @pytest.fixture
    def folder(self, tmp_path, whole):
        folder = tmp_path / "run"
        folder.mkdir()
        for name in ("sweep.json", "sweep.csv"):
            (folder / name).write_bytes((whole / name).read_bytes())
        return folder

    def refused(self, capsys, *arguments):
        assert main([str(a) for a in arguments]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.count("\n") == 1
        assert len(captured.err) < 320
        return captured.err

    def test_another_sweep_is_not_overwritten(self, capsys, folder):
        before = {p.name: p.read_bytes() for p in folder.iterdir()}
        assert "already holds a run" in self.refused(capsys, *COMMAND, "--out", folder)
        (folder / "sweep.json").unlink()  # of an older version
        assert "already holds a run" in self.refused(capsys, *COMMAND, "--out", folder)
        (folder / "sweep.json").write_bytes(before["sweep.json"])
        for other in (["--seed", "8"], ["--points", "5"], ["--from", "0.8"], ["--horizon", 3]):
            assert "cannot be changed" in self.refused(capsys, "sweep", "--resume", folder, *other)
        other = ["--policy", "accuracy", "--engine", "tables"]  # one may be named again, as the folder brings no code
        assert "has policy 'belief:0.84', not 'acc" in self.refused(capsys, "sweep", "--resume", folder, *other)
        with pytest.raises(harness.HarnessError, match="has values"):
            harness.sweep("rocksample-7x8", "belief", out=folder, resume=True, episodes=4000, seed=3, horizon=40)
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before

    @pytest.mark.parametrize(
        "damage",
        [
            lambda text: text[: len(text) // 2],
            lambda text: text[: text.index("\nbelief:0.81") + 1] + text[text.index("\nbelief:0.82") + 1 :],
            lambda text: text.replace(",4000,", ",4001,", 1),
            lambda text: text.replace("\nbelief:0.81,0.81,4000,", "\nbelief:0.81,0.81,4000,x"),
            lambda text: text.replace("\nbelief:0.81,0.81,4000,", "\nbelief:0.81,0.81,4000,nan,"),
            lambda text: text.replace("belief:0.81,", "belief:0.99,"),
            lambda text: "",
            lambda text: "\x00" + text,
            lambda text: text + text.splitlines()[-1] + "\n",
        ],
    )
    def test_damaged_rows_are_refused(self, capsys, folder, damage):
        path = folder / "sweep.csv"
        text = path.read_text()
        assert damage(text) != text
        path.write_text(damage(text))
        assert "sweep.csv is damaged" in self.refused(capsys, "sweep", "--resume", folder, "--engine", "tables")
        assert path.read_text() == damage(text)

    @pytest.mark.parametrize("text", ["", "[]", '{"run": {"domain": "rocksample-7x8"}}', None])
    def test_damaged_parameters_are_refused(self, capsys, folder, text):
        path = folder / "sweep.json"
        path.write_text(path.read_text().replace('"seed": 3', '"seed": 4') if text is None else text)
        assert "sweep.json is damaged" in self.refused(capsys, "sweep", "--resume", folder)


@pytest.mark.parametrize("given", [{"start": 10**400}, {"stop": "x"}, {"values": [10**400]}, {"values": [0.6, None]}])
def test_what_is_no_number_is_refused(given):
    with pytest.raises(harness.HarnessError, match="must be a number, not"):
        harness.sweep("rocksample-7x8", "belief", **given)


@pytest.mark.parametrize("given", [{"stop": 1e308}, {"start": -np.inf}, {"start": np.nan}, {"values": [0.6, np.inf]}])
def test_what_is_out_of_range_is_refused(given):
    """Before a grid is made of it, which NumPy would warn of."""
    with pytest.raises(harness.HarnessError, match=r"lies between 0\.5 and 1; .* is out of range"):
        harness.sweep("rocksample-7x8", "belief", **given)
