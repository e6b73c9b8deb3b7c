"""The hall of fame of a run, and the front of return against length."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

import harness
from harness import HarnessError
from harness.ge.fitness import ProgramFitness
from harness.ge.front import front
from harness.ge.hall import Hall
from harness.ge.parameters import Parameters
from harness.play.evaluation import evaluate
from harness.program import parse, words_of

RUN = {"population": 20, "generations": 6, "episodes": 20, "max_init_depth": 20, "score_episodes": 200}


@pytest.fixture(scope="module")
def rocksample():
    return harness.load("rocksample-7x8")


def test_the_front_holds_what_earns_more_than_all_shorter_ones():
    """Against the definition, on random tables."""
    generator = np.random.default_rng(0)
    for _ in range(50):
        n = int(generator.integers(1, 12))
        figures = {"length": generator.integers(1, 6, n), "validation": generator.integers(0, 5, n) / 1.0}
        table = pd.DataFrame(figures).assign(validation_sem=0.1, program=[f"p{i}" for i in range(n)])
        found = front(table)
        kept = {
            length: rows["validation"].max()
            for length, rows in table.groupby("length")
            if not (table[table["length"] < length]["validation"] >= rows["validation"].max()).any()
        }
        assert dict(zip(found["length"], found["validation"], strict=True)) == kept
        assert found["length"].is_monotonic_increasing


def test_the_hall_takes_what_earns_more_than_all_that_is_as_short(rocksample, tmp_path):
    words, generator = words_of(rocksample), np.random.default_rng(1)
    hall, known = Hall(tmp_path, 0), []
    for g in range(8):
        programs = [parse("up()\n" * int(generator.integers(1, 7)), words) for _ in range(10)]
        means = generator.integers(0, 30, 10) / 2.0
        hall.see(g, programs, means)
        for i in np.argsort(-means, kind="stable"):
            if all(mean < means[i] for length, mean in known if length <= programs[i].length):
                known.append((programs[i].length, means[i]))
    assert [(each["length"], each["mean"]) for each in hall.found] == known
    hall.save(5)
    early = Hall(tmp_path, 5)
    assert early.found == [each for each in hall.found if each["generation"] < 5]
    lengths = [text.count("\n") for text in hall.programs()]
    assert lengths == sorted({length for length, _ in known})


def test_a_run_has_a_front_whose_programs_are_policies(rocksample, tmp_path):
    result = harness.evolve(rocksample, "rocksample-feedback", seed=2, out=tmp_path, engine="tables", **RUN)
    assert result.front.equals(pd.read_csv(tmp_path / "front.csv"))
    assert result.front["validation"].is_monotonic_increasing
    assert len(result.front) > 1
    last = len(result.front) - 1
    assert result.front["validation"][last] >= result.best.validation
    program = result.pick(last).program
    assert (program.length, program.text) == tuple(result.front.loc[last, ["length", "program"]])
    assert (tmp_path / f"front-{program.length}.txt").read_text() == program.text
    p = result.parameters
    again = ProgramFitness(rocksample, p, "tables", 1).judge([program], (p.generations + 1) * p.episodes, 2000)
    assert again.means[0] == pytest.approx(result.front["validation"][last], abs=1e-12)
    assert evaluate(rocksample, result.pick(0), episodes=5, engine="tables").score.episodes == 5
    with pytest.raises(HarnessError, match="programs 0 to"):
        result.pick(len(result.front))


def test_the_front_shows_returns_without_the_penalty_for_length(rocksample):
    result = harness.evolve(rocksample, "rocksample-feedback", engine="tables", penalty=1.0, free_length=0, **RUN)
    p = result.parameters
    fitness = ProgramFitness(rocksample, p, "tables", 1)
    for k, row in result.front.iterrows():
        judged = fitness.judge([result.pick(k).program], (p.generations + 1) * p.episodes, p.validation_episodes)
        assert row["validation"] == pytest.approx(judged.means[0], abs=1e-9)


def test_selection_has_seen_what_is_in_the_hall(rocksample, tmp_path):
    """An entry's mean is that of its program on the episodes of its generation."""
    p = Parameters(**RUN)
    harness.evolve(rocksample, "rocksample-feedback", out=tmp_path, engine="tables", **RUN)
    found = json.loads((tmp_path / "hall.json").read_text())
    fitness = ProgramFitness(rocksample, p, "tables", 1)
    assert len(found) > 2
    for each in found:
        program = fitness.compile("\n".join(each["program"]))
        played = fitness.play([program], each["generation"] * p.episodes, p.episodes)
        assert played.returns.mean() == each["mean"]
        assert program.length == each["length"]
