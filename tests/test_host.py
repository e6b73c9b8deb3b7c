"""Workers and memory: what is asked for is compared with what there is, before anything is taken or run."""

from __future__ import annotations

import math
import resource
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import harness
from harness import host
from harness.cli import main
from harness.errors import HarnessError
from harness.play import population
from harness.program import parse, words_of

NO_ROOM = r"would take [\d.,]+ GB of memory, and 0\.2 GB are free here"


@pytest.fixture
def little(monkeypatch):
    """A machine with 0.2 GB to spare."""
    monkeypatch.setattr(host, "free_memory", lambda: 2e8)


class TestFreeMemory:
    def test_is_at_most_that_of_the_machine(self):
        assert 0 < host.free_memory() <= 1024 * 2**40

    def test_a_container_leaves_what_its_limit_leaves(self, tmp_path):
        for name, text in (("max", "1000\n"), ("current", "700\n"), ("stat", "anon 5\ninactive_file 50\n")):
            (tmp_path / f"memory.{name}").write_text(text)
        assert host._free_of_group(tmp_path) == 350
        (tmp_path / "memory.max").write_text("max\n")
        assert host._free_of_group(tmp_path) == math.inf
        assert host._free_of_group(tmp_path / "none") == math.inf

    def test_a_limit_of_the_process_counts(self):
        code = (
            "import resource; from harness import host;"
            f"resource.setrlimit(resource.RLIMIT_AS, ({2**33}, {resource.RLIM_INFINITY}));"
            f"assert 0 < host.free_memory() < {2**33}"
        )
        subprocess.run([sys.executable, "-c", code], check=True)

    def test_little_is_not_looked_up(self, monkeypatch):
        monkeypatch.setattr(host, "free_memory", lambda: 0)
        host.check_memory("this", 1e6)
        with pytest.raises(
            HarnessError, match=r"^this would take 3\.0 GB of memory, and 0\.0 GB are free here; take fe"
        ):
            host.check_memory("this", 3e9)


@pytest.mark.usefixtures("little")
class TestRequests:
    @pytest.mark.parametrize(
        ("words", "told"),
        [
            (["compare", "rocksample-7x8", "--policy", "exit", "--episodes", "90000000"], "90,000,000 episodes"),
            (["compare", "rocksample-7x8", "--policy", "exit", "--policy", "random", "--episodes", "9000000",
              "--against", "exit"], "to compare 2 policies episode by episode"),
            (["evolve", "rocksample-7x8", "--episodes", "1000", "--horizon", "1000000"], "1,000,000 steps"),
            (["evolve", "rocksample-7x8", "--score-episodes", "900000", "--horizon", "1000"], "in 900,000 episodes"),
            (["evolve", "rocksample-7x8", "--max-codons", "100000"], "250 with 100,000 codons each"),
            (["tune", "rocksample-7x8", "--policy", "program:PROGRAM", "--horizon", "1000000", "--set",
              "episodes=10000"], "10,000 episodes of 1,000,000 steps"),
            (["check-policy", "rocksample-7x8", "exit", "--episodes", "1000000"], "1,000,000 episodes of 50 steps"),
        ],
    )  # fmt: skip
    def test_too_much_is_refused_before_anything_runs(self, capsys, tmp_path, words, told):
        (tmp_path / "p.txt").write_text("if(belief(1) > 0.5) up()")
        out = tmp_path / "out"
        words = [word.replace("PROGRAM", str(tmp_path / "p.txt")) for word in words]
        assert main([*words, *(["--out", str(out)] if words[0] in ("evolve", "tune") else [])]) == 2
        error = capsys.readouterr().err
        assert error.startswith("harness: ")
        assert error.count("\n") == 1
        assert told in error
        assert "GB of memory" in error
        assert not out.exists()

    def test_pictures_and_replays(self, rocksample, tmp_path):
        with pytest.raises(HarnessError, match=f"a picture of 9,000,000 steps {NO_ROOM}"):
            harness.draw_beliefs(rocksample, "exit", horizon=9_000_000)
        table = harness.compare(rocksample, ["exit"], episodes=5)
        table.assign(horizon=9_000_000).to_json(tmp_path / "table.json", orient="records")
        page = harness.write_report(tmp_path / "table.json", tmp_path).read_text()
        assert "No replay of exit: a page shows episodes of 10,000 steps at most" in page

    def test_what_fits_runs(self, rocksample):
        harness.check_policy("exit", rocksample, episodes=1000)
        many = harness.evaluate(rocksample, "exit", episodes=500_000, workers=host.MOST_WORKERS)
        assert len(many.returns) == 500_000


def test_the_estimate_of_programs_is_what_they_take(rocksample):
    """Measured by another: the largest resident size that the operating system saw."""
    episodes = population.Episodes(0, 0, 40_000, 1000)
    program = parse("up()", words_of(rocksample))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    population.play(rocksample, [program], episodes)
    taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before
    estimate = population.memory(rocksample, 1, episodes.size, episodes.horizon)[1]
    assert taken < 1.3 * estimate


@pytest.mark.parametrize("workers", [0, -1, host.MOST_WORKERS + 1, 2**31, 1.5, True, "2"])
def test_workers_out_of_range_are_refused(workers, tmp_path):
    with pytest.raises(HarnessError, match="workers must be a whole number from 1 to 1,024, not"):
        harness.evaluate("rocksample-7x8", "exit", episodes=5, workers=workers)
    with pytest.raises(HarnessError, match="workers must be a whole number from 1 to 1,024, not"):
        harness.evolve("rocksample-7x8", workers=workers, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"episodes": 0}, "episodes must be a whole number from 1 to 100,000,000, not 0"),
        ({"episodes": 2.5}, "episodes must be a whole number"),
        ({"episodes": True}, "episodes must be a whole number"),
        ({"episodes": 10**400}, "episodes must be a whole number from 1 to 100,000,000, not 1000"),
        ({"horizon": -1}, "horizon must be a whole number from 1 to 100,000,000, not -1"),
        ({"seed": 2**64}, "seed must be a whole number from 0 to 18,446,744,073,709,551,615, not"),
        ({"seed": -1}, "seed must be a whole number"),
    ],
)
def test_numbers_of_an_evaluation(given, told):
    calls = (
        lambda: harness.evaluate("rocksample-7x8", "exit", **given),
        lambda: harness.compare("rocksample-7x8", "exit", **given),
        lambda: harness.check_policy("exit", "rocksample-7x8", **given),
        lambda: list(harness.replay("rocksample-7x8", "exit", **given)),
        lambda: harness.draw_episode("rocksample-7x8", "exit", **given),
    )
    for call in calls if "episodes" not in given else calls[:3]:
        with pytest.raises(HarnessError, match=told) as error:
            call()
        assert len(str(error.value)) < 300


def test_numpys_numbers_are_numbers():
    played = harness.evaluate("rocksample-7x8", "exit", episodes=np.int64(3), seed=np.uint64(2), horizon=np.int32(9))
    assert np.array_equal(played.returns, harness.evaluate("rocksample-7x8", "exit", episodes=3, seed=2).returns)


@pytest.mark.parametrize(
    ("name", "value"), [("batch_size", 0), ("batch_size", "x"), ("batch_size", 1.5), ("max_episodes", -1)]
)
def test_sizes_that_a_policy_asks_for(rocksample, name, value):
    class Own:
        def reset(self, batch):
            pass

        def act(self, batch):
            return np.zeros(batch.size, dtype=int)

    policy = Own()
    setattr(policy, name, value)
    with pytest.raises(harness.PolicyError, match=f"Own.{name} must be a whole number, 1 or more, not {value!r}"):
        harness.compare(rocksample, policy)


def test_a_rock_beyond_the_last_letter_is_drawn(rocksample):
    cells = [[x, y] for y in range(1, 8) for x in range(2, 8)]
    many = replace(rocksample, layout={**rocksample.layout, "rocks": cells})
    start = list(harness.replay(many, "exit", engine="tables"))[1]
    assert sum(start.count(mark) for mark in "*") == len(cells) - 35
    assert "z" in start
    from harness.show.replay import label

    far = replace(many, features=[("rock", 34, 1), ("rock", 35, 1)])
    assert [label(far, i) for i in (0, 1)] == ["rock z", "rock 36"]


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 5000, "\x1b[31m", "a\nb"])
def test_paths_that_can_name_no_file(name, tmp_path):
    for call in (
        lambda: harness.check_scores(name),
        lambda: harness.update_scores(name),
        lambda: harness.write_report(name, tmp_path),
        lambda: harness.write_report(tmp_path, name),
        lambda: harness.resume(name),
        lambda: harness.sweep("rocksample-7x8", "belief", out=name),
    ):
        with pytest.raises(HarnessError, match="cannot be the name of a file; give another"):
            call()
