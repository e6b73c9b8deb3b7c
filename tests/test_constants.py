"""Constants of programs as numbers to tune: the text, the search, the command."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness.cli import main
from harness.engine import rng
from harness.play.evaluation import evaluate
from harness.policy.program import ProgramPolicy
from harness.program import constant_spans, parse, words_of
from harness.tuning import Constants, objective, tunable
from harness.tuning.journal import Journal
from harness.tuning.lines import Lines
from harness.tuning.method import Ask
from harness.tuning.run import climb

TEXT = """check(2)
down()
if(belief(2) > 0.9 and x() < 3) down()
if(not (belief(2) < 0.123456)) sample()
right()
right()
right()
down()
"""  # rock 2 lies two steps below the start


@pytest.fixture(scope="module")
def words(rocksample):
    return words_of(rocksample)


class Box:
    """Numbers without a policy."""

    def __init__(self, start):
        self.start = np.array(start, dtype=float)
        self.names = tuple(f"c{i + 1}" for i in range(len(start)))
        self.lower, self.upper = np.zeros(len(start)), np.ones(len(start))


def searched(function, start, **options):
    """Lines on a function of a point, the same in every episode; the points that it played."""
    played = []

    def play(ask):
        played.extend(ask.points)
        return np.array([[function(x)] * ask.episodes for x in ask.points])

    search = Lines(Box(start), 0, episodes=2, **options)
    stopped, _ = climb(search, play, Journal(search.subject.names))
    return search.theta, np.array(played), stopped


class TestConstants:
    def test_names_bounds_start_and_text(self, words):
        subject = Constants(parse(TEXT, words))
        assert isinstance(subject, harness.Tunable)
        assert subject.names == ("c1", "c2")
        assert subject.start.tolist() == [0.9, 0.1235]
        assert (subject.lower.tolist(), subject.upper.tolist()) == ([0, 0], [1, 1])
        assert "belief(2) > 0.9 and" in subject.text(subject.start)
        assert "belief(2) < 0.1235" in subject.text(subject.start)

    @settings(max_examples=60, deadline=None)
    @given(theta=st.lists(st.floats(0, 1), min_size=2, max_size=2))
    def test_what_is_played_is_what_is_written(self, words, theta):
        subject = Constants(parse(TEXT, words))
        theta = np.array(theta)
        read = parse(subject.text(theta), words)
        assert read.code.tobytes() == subject.at(theta).code.tobytes()
        np.testing.assert_allclose(read.constants, theta, atol=0.00005001)

    def test_other_numbers_are_left_alone(self, words):
        subject = Constants(parse("if(x() < 3) up() if(belief(1) > 0.5) sample()", words))
        assert subject.names == ("c1",)
        assert subject.text(np.array([0.25])) == "if(x() < 3) up()\nif(belief(1) > 0.25) sample()\n"

    def test_constants_beyond_the_range_start_at_its_end(self, words):
        assert Constants(parse("if(belief(1) < 7) up()", words)).start.tolist() == [1.0]

    @pytest.mark.parametrize("measure", ["return", "discounted"])
    def test_the_compiled_objective_is_evaluate(self, rocksample, words, measure):
        subject = Constants(parse(TEXT, words))
        points = np.array([[0.9, 0.0], [0.2, 0.6], [0.01, 0.55]])
        episodes = objective.Episodes(rocksample, subject, 3, 20, measure, "tables", 2)
        returns = episodes(Ask(points, np.array([40, 0, 40]), 30))
        for point, first, row in zip(points, (40, 0, 40), returns, strict=True):
            played = evaluate(
                rocksample, ProgramPolicy(parse(subject.text(point), words)), episodes=30, first=first,
                seed=rng.TRAINING + 3, horizon=20, engine="tables",
            )  # fmt: skip
            assert row.tolist() == objective.measured(played, measure).tolist()
            assert row.std() > 0

    @pytest.mark.parametrize("text", ["if(belief(3)>0.5)up() # belief(1) > 0.9\nif( belief( 4 )  < 1 ) down()", TEXT])
    def test_where_the_constants_stand(self, words, text):
        spans = constant_spans(text, words)
        assert [float(text[a:b]) for a, b in spans] == parse(text, words).constants.tolist()
        for start, end in spans:
            assert text[:start].rstrip()[-1] in "<>"
            assert not text[end : end + 1].isdigit()


class TestLines:
    @pytest.mark.parametrize("start", [[0.5, 0.1, 0.9], [0.0, 0.33, 1.0]])
    def test_a_known_optimum_of_step_functions_is_found(self, start):
        edges = [(0.23, 0.4), (0.61, 0.87), (0.0, 0.12)]

        def value(x):
            return sum(10.0 * (low < c <= high) - 3 * (c > high) for c, (low, high) in zip(x, edges, strict=True))

        theta, played, stopped = searched(value, start)
        assert value(theta) == 30.0
        assert "no single number can be moved" in stopped
        assert len(played) < 100  # of 1.03 million points of the grid

    def test_a_number_that_moves_takes_the_middle_of_its_stretch(self):
        theta, _, _ = searched(lambda x: float(0.3 < x[0] <= 0.7), [0.05])
        assert theta[0] == pytest.approx(0.5, abs=0.1)

    def test_what_cannot_be_improved_stays(self):
        assert searched(lambda x: 1.0, [0.37, 0.91])[0].tolist() == [0.37, 0.91]
        assert searched(lambda x: float(x[0] > 0.3), [0.37, 0.91])[0].tolist() == [0.37, 0.91]

    def test_both_edges_of_the_best_stretch_are_found_to_the_resolution(self):
        _, played, _ = searched(lambda x: float(0.333 < x[0] <= 0.666), [0.5])
        assert {0.33, 0.34, 0.66, 0.67} <= set(played[:, 0])

    @settings(max_examples=60, deadline=None)
    @given(seed=st.integers(0, 2**32), d=st.integers(1, 4), coarse=st.integers(1, 5))
    def test_never_worse_than_the_start_and_only_better_where_moved(self, seed, d, coarse):
        """On any landscape of steps, with interactions."""
        generator = np.random.default_rng(seed)
        heights = generator.integers(0, 5, (8,) * d).astype(float)

        def value(x):
            return float(heights[tuple(np.minimum((8 * x).astype(int), 7))])

        start = generator.random(d)
        theta, played, _ = searched(value, start, coarse=coarse)
        assert value(theta) == max(value(start), value(theta))
        if (theta != start).any():
            assert value(theta) > value(start)
        assert ((played >= 0) & (played <= 1)).all()

    def test_a_flight_of_steps_is_climbed(self):
        def value(x):
            return sum(-np.floor(20 * abs(c - t)) * (2.3 if c > t else 1) for c, t in zip(x, (0.31, 0.77), strict=True))

        assert value(searched(value, [0.9, 0.1])[0]) == 0


class TestTheCommand:
    def test_it_finds_what_all_pairs_of_a_grid_say(self, rocksample, words, tmp_path, capsys):
        """Two thresholds in a program; the best of 21 × 21 on the very same episodes is not better."""
        source = tmp_path / "program.txt"
        source.write_text(
            "check(2) check(5)\nif(belief(2) > 0.95) down()\nif(belief(2) > 0.95) sample()\n"
            "if(belief(5) > 0.05) up()\nright() right() sample() right() right() right() right() right()"
        )
        options = ["--set", "episodes=400", "--engine", "tables", "--seed", "4"]
        out = tmp_path / "run"
        arguments = ["tune", "rocksample-7x8", "--policy", f"program:{source}", "--method", "lines", *options]
        assert main([*arguments, "--out", str(out)]) == 0
        result = json.loads((out / "result.json").read_text())
        assert (out / "best.txt").read_text() == result["policy"]
        assert result["policy"].splitlines()[2] in capsys.readouterr().out
        best = f"program:{out / 'best.txt'}"
        again = evaluate(rocksample, best, episodes=10_000, seed=rng.HELD_OUT + 4, engine="tables")
        assert again.score._asdict() == result["fresh"]
        subject = tunable(f"program:{source}", rocksample)
        assert list(result["theta"]) == list(subject.names) == ["c1", "c2", "c3"]
        grid = np.array([[a, a, b] for a, b in itertools.product(np.linspace(0, 1, 21), repeat=2)])
        episodes = objective.Episodes(rocksample, subject, 4, 50, "return", "tables", 1)
        means = episodes(Ask(grid, np.zeros(len(grid), dtype=np.int64), 400)).mean(axis=1)
        assert result["training"]["mean"] >= means.max() - 1e-9

    def test_resumed_without_the_program_s_file(self, rocksample, words, tmp_path):
        source = tmp_path / "program.txt"
        source.write_text(TEXT)
        kept = {"method": "lines", "episodes": 200, "final_episodes": 100, "engine": "tables"}
        whole = harness.tune(rocksample, f"program:{source}", out=tmp_path / "whole", **kept)
        files = {p.name: p.read_bytes() for p in (tmp_path / "whole").iterdir()}
        source.unlink()
        path = tmp_path / "whole" / "history.csv"
        head, *rows = path.read_text().splitlines(keepends=True)
        kept_rows = [row for row in rows if int(row.split(",")[0]) < 3]
        assert 0 < len(kept_rows) < len(rows)
        path.write_text("".join([head, *kept_rows]))
        from harness.tuning import resume

        assert resume(tmp_path / "whole", engine="tables").best == whole.best
        assert {p.name: p.read_bytes() for p in (tmp_path / "whole").iterdir()} == files

    @pytest.mark.parametrize(
        ("text", "words_of_it"),
        [
            ("up() right()", "compares no belief with a number"),
            ("if(x() < 3) up()", "compares no belief with a number"),
            ("if(belief(9) > 0.5) up()", "did you mean"),
        ],
    )
    def test_misuse_gets_one_sentence(self, tmp_path, capsys, text, words_of_it):
        (tmp_path / "p.txt").write_text(text)
        assert main(["tune", "rocksample-7x8", "--policy", f"program:{tmp_path / 'p.txt'}"]) == 2
        error = capsys.readouterr().err
        assert words_of_it in error
        assert error.count("\n") == 1
