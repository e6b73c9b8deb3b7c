"""Policies of the user's own by path; and that data never decides which files are read or run."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest

import harness
from harness import policy as policies
from harness.cli import main
from harness.errors import HarnessError, PolicyError
from harness.score import comparison
from harness.tuning import sweeping

OWN = """
from pathlib import Path
import numpy as np

Path("{marker}").touch()


class Exit:
    def reset(self, batch):
        pass

    def act(self, batch):
        return np.full(len(batch.done), self.action, dtype=np.int32)

    action = 1  # right()


class ByName(Exit):
    def __init__(self, domain, action="right()"):
        self.action = domain.action(action)


def make(domain):
    return ByName(domain)


instance = Exit()
number = 3


class Waits(Exit):  # reads rock 3 up to ten times, then leaves
    def __init__(self, share):
        self.steps = round(10 * share)

    def act(self, batch):
        return np.full(len(batch.done), batch.domain.action("check(3)") if batch.step < self.steps else 1)


class Tunable:
    names, lower, upper, start = ("share",), np.zeros(1), np.ones(1), np.array([0.5])

    def __init__(self, domain):
        self.domain = domain

    def policy(self, theta):
        return Waits(theta[0])

    def text(self, theta):
        return "wait %.2f" % theta[0]


class Broken(Exit):
    def __init__(self):
        raise RuntimeError("not today\\n" * 99)
"""

SMALL = {"episodes": 20, "engine": "tables"}


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A file of policies in the present folder; running it leaves a trace in the file ``ran`` beside it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "own_policies.py").write_text(OWN.format(marker=(tmp_path / "ran").as_posix()))
    yield tmp_path
    sys.modules.pop("own_policies", None)


@pytest.mark.parametrize("where", ["own_policies.py", "{folder}/own_policies.py", "own_policies"])
@pytest.mark.parametrize("name", ["Exit", "ByName", "make", "instance"])
def test_a_path_is_a_policy_like_any_other(own, rocksample, where, name):
    spec = f"{where.format(folder=own)}:{name}"
    found = harness.evaluate(rocksample, spec, **SMALL)
    assert found.policy == spec
    assert (found.returns == harness.evaluate(rocksample, "exit", **SMALL).returns).all()


def test_every_command_takes_it(own, capsys):
    spec, small = "own_policies.py:Exit", ["--engine", "tables", "--episodes", "30"]
    assert main(["compare", "rocksample-7x8", "--policy", spec, *small]) == 0
    assert "10.00 ± 0.00" in capsys.readouterr().out
    assert main(["show", "rocksample-7x8", spec, "--engine", "tables"]) == 0
    assert "return 10, " in capsys.readouterr().out
    assert main(["tune", "rocksample-7x8", "--policy", spec]) == 2
    assert "makes no tunable policy" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("none.py:Exit", "'none.py': no such file"),
        ("own_policies.py:Exti", "'own_policies.py' has no 'Exti'; did you mean 'Exit'?"),
        ("own_policies.py:number", "makes no policy"),
        ("own_policies.py:np", "makes no policy"),
        ("own_policies.py:Broken", "RuntimeError in line 54 of '"),
        ("no_such_module:Exit", "no policy 'no_such_module:Exit'"),
        ("own_policies.sub:Exit", "ModuleNotFoundError: No module named 'own_policies.sub'"),
        ("syntax.py:Exit", "SyntaxError"),
        ("leaves.py:Exit", "SystemExit in line 1 of '"),
        ("needs.py:Exit", "No module named 'not_there'"),
        ("beleif:good", "did you mean 'belief'"),
        ("right()", "write it into a file"),
        ("check(1)\nright()", "write it into a file"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(own, rocksample, spec, words):
    (own / "syntax.py").write_text("def (\n")
    (own / "leaves.py").write_text("raise SystemExit(3)\n")
    (own / "needs.py").write_text("import not_there\n")
    with pytest.raises(PolicyError) as refusal:
        harness.evaluate(rocksample, spec, **SMALL)
    assert words in str(refusal.value)


class TestTunables:
    """The numbers of a policy of one's own, by path."""

    def test_a_sweep_of_one_goes_on_where_it_is_named_again(self, own, capsys):
        small = ["--episodes", "4", "--engine", "tables", "--points", "3"]
        assert main(["sweep", "rocksample-7x8", "--policy", "own_policies.py:Tunable", "--out", "run", *small]) == 0
        rows = pd.read_csv("run/sweep.csv")
        assert rows["policy"].tolist() == ["wait 0.00", "wait 0.50", "wait 1.00"]
        assert rows["discounted_mean"].tolist() == pytest.approx([10 * 0.95 ** (6 + waits) for waits in (0, 5, 10)])
        lines = Path("run/sweep.csv").read_text().splitlines(keepends=True)
        Path("run/sweep.csv").write_text("".join(lines[:2]))
        assert main(["sweep", "--resume", "run"]) == 2
        assert main(["sweep", "--resume", "run", "--policy", "own_policies.py:Tunable"]) == 0
        assert Path("run/sweep.csv").read_text() == "".join(lines)

    def test_one_is_tuned(self, own, capsys):
        small = ["--set", "episodes=2", "--set", "final_episodes=2", "--measure", "discounted", "--method", "lines"]
        arguments = ["--policy", "own_policies.py:Tunable", *small, "--engine", "tables"]
        assert main(["tune", "rocksample-7x8", *arguments]) == 0
        assert "wait 0.0" in capsys.readouterr().out

    def test_a_policy_without_numbers_is_refused(self, own, rocksample):
        with pytest.raises(PolicyError, match=r"'own_policies.py:Exit' makes no tunable policy: an object with names"):
            harness.sweep(rocksample, "own_policies.py:Exit")

    def test_whoever_stops_it_is_told_how_to_go_on(self, own, capsys, monkeypatch):
        def stop(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr(sweeping.Episodes, "play", stop)
        assert main(["sweep", "rocksample-7x8", "--policy", "own_policies.py:Tunable", "--out", "run"]) == 130
        assert "harness sweep --resume run --policy own_policies.py:Tunable\n" in capsys.readouterr().err


def test_an_installed_package_brings_policies(own, rocksample, monkeypatch, capsys):
    """With the files that an installer writes."""
    info = own / "fast_exit-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fast-exit\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[pomdp_harness.policies]\nfast-exit = own_policies:ByName\n")
    monkeypatch.syspath_prepend(str(own))
    assert "fast-exit" in policies.specs(rocksample)
    assert not (own / "ran").exists()
    found = harness.evaluate(rocksample, "fast-exit", **SMALL)
    assert (found.policy, found.score.mean) == ("fast-exit", 10)
    assert main(["compare", "rocksample-7x8", "--policy", "fast-exti"]) == 2
    assert "did you mean 'fast-exit'" in capsys.readouterr().err


SECRET = "root:x:0:0"


@pytest.fixture
def named(own):
    """Policy strings that name files, which must not be opened."""
    (own / "secret").write_text(SECRET)
    return ["own_policies.py:Exit", "own_policies:Exit", f"program:{own / 'secret'}", "alpha:secret"]


class TestData:
    """Tables, lists of scores and run folders from elsewhere."""

    def test_a_report_reads_and_runs_nothing(self, own, named, rocksample):
        table = comparison.compare(rocksample, ["exit"], **SMALL)
        for i, spec in enumerate(named):
            table.assign(policy=spec).to_csv(own / f"{i}.csv", index=False)
        table.assign(domain="model.jl").to_csv(own / "domain.csv", index=False)
        (own / "model.jl").write_text("error()")
        assert main(["report", *map(str, own.glob("*.csv")), "--out", "page"]) == 0
        page = Path("page/index.html").read_text()
        assert page.count("names a file, which would be run") == 3
        assert page.count("names a file, which would be read") == 2
        assert SECRET not in page
        assert not (own / "ran").exists()
        assert main(["report", "0.csv", "--out", "page", "--allow-code"]) == 0
        assert (own / "ran").exists()
        assert "No replay" not in Path("page/index.html").read_text()

    def test_a_list_of_scores_reads_and_runs_nothing(self, own, named, capsys):
        row = '[[score]]\ndomain = "{}"\npolicy = \'{}\'\nepisodes = 30\nengine = "tables"\n'
        for spec in named:
            Path("scores.toml").write_text(row.format("rocksample-7x8", spec))
            for arguments in (["check"], ["check", "--update"]):
                assert main(arguments) == 2
                error = capsys.readouterr().err
                assert "scores.toml:1: " in error
                assert "only with --allow-code" in error
                assert SECRET not in error
        Path("scores.toml").write_text(row.format("model.jl", "exit"))
        assert main(["check"]) == 2
        assert "'model.jl' names a file, which would be run" in capsys.readouterr().err
        assert not (own / "ran").exists()
        Path("scores.toml").write_text(row.format("rocksample-7x8", named[0]))
        assert main(["check", "--update", "--allow-code"]) == 0
        assert main(["check", "--allow-code"]) == 0

    def test_a_run_of_evolution_does_not_bring_its_domain(self, own, rocksample):
        from harness.model import domain

        domain.save(rocksample, Path("mine.npz"))
        harness.evolve("mine.npz", out="run", population=4, generations=1, episodes=5, engine="tables")
        with pytest.raises(HarnessError, match=r"'mine.npz' names a file"):
            harness.resume("run")
        harness.resume("run", allow_code=True)

    def test_a_run_of_tuning_brings_neither_domain_nor_policy(self, own, monkeypatch, named):
        from harness.tuning import journal, run

        stored = {"shaping": "none", "model_hash": "", "policy": "belief:0.84", "method": "spsa"}
        for changed in ({"domain": "model.jl"}, *({"domain": "rocksample-7x8", "policy": spec} for spec in named)):
            monkeypatch.setattr(journal, "read_parameters", lambda _, changed=changed: {**stored, **changed})
            with pytest.raises(HarnessError, match="names a file"):
                run.resume("run")
        assert not (own / "ran").exists()
