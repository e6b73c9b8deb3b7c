"""Parameters of an evolution as a file: the same run again from it, and what is refused."""

from __future__ import annotations

import json
import re
from dataclasses import fields

import pandas as pd
import pytest

import harness
from harness import registry
from harness.cli import main
from harness.ge.parameters import Parameters

SMALL = {
    "population": 20, "generations": 4, "episodes": 15, "max_init_depth": 15, "score_episodes": 100,
    "test_episodes": 50, "validation_episodes": 60, "tail": 0.25, "penalty": 1, "loop": True,
    "mutation_probability": 1e-5, "crossover": "subtree", "seed": 7,
}  # fmt: skip


def results(folder):
    best = json.loads((folder / "best.json").read_text())
    return (
        pd.read_csv(folder / "history.csv").drop(columns="seconds").to_csv(),
        (folder / "finalists.csv").read_text(),
        {name: best[name] for name in ("program", "fitness", "validation", "score", "parameters")},
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parameters") / "run"
    harness.evolve("rocksample-7x8", "rocksample-feedback", out=folder, **SMALL)
    return folder


class TestFile:
    def test_a_run_can_be_had_again_from_what_it_wrote(self, run, tmp_path):
        again = ["--grammar", str(run / "grammar.bnf"), "--parameters", str(run / "parameters.toml")]
        assert main(["evolve", "rocksample-7x8", *again, "--out", str(tmp_path / "again")]) == 0
        assert results(tmp_path / "again") == results(run)
        assert (tmp_path / "again" / "parameters.toml").read_text() == (run / "parameters.toml").read_text()

    def test_it_has_every_parameter_with_its_value_as_text(self, run):
        """Read by a regular expression, not by what the package reads it with."""
        lines = dict(re.findall(r"^(\w+) = (.*)$", (run / "parameters.toml").read_text(), re.MULTILINE))
        assert list(lines) == [f.name for f in fields(Parameters)]
        assert (lines["tail"], lines["loop"], lines["crossover"], lines["population"]) == (
            "0.25", "true", '"subtree"', "20",
        )  # fmt: skip
        assert float(lines["mutation_probability"]) == 1e-5

    def test_each_of_many_runs_and_a_longer_one_has_its_own(self, tmp_path):
        small = {**SMALL, "generations": 1}
        harness.evolve("rocksample-7x8", runs=2, out=tmp_path, workers=1, **small)
        for seed in (7, 8):
            assert f"\nseed = {seed}\n" in (tmp_path / f"seed-{seed}" / "parameters.toml").read_text()
        harness.resume(tmp_path / "seed-7", generations=2)
        assert "\ngenerations = 2\n" in (tmp_path / "seed-7" / "parameters.toml").read_text()

    def test_options_go_before_the_file_and_the_rest_are_defaults(self, tmp_path):
        path = tmp_path / "mine.toml"
        path.write_text('population = 12\ngenerations = 9\nepisodes = 5\n# a remark\nmutation = "per-genome"\n')
        options = ["--parameters", str(path), "--generations", "1", "--elites", "2"]
        assert main(["evolve", "rocksample-7x8", *options, "--out", str(tmp_path / "run")]) == 0
        told = json.loads((tmp_path / "run" / "config.json").read_text())["parameters"]
        assert told == {
            **Parameters().__dict__, "population": 12, "generations": 1, "episodes": 5, "elites": 2,
            "mutation": "per-genome",
        }  # fmt: skip

    def test_only_the_whole_must_fit_together(self, tmp_path):
        (tmp_path / "p.toml").write_text("elites = 300\n")
        arguments = ["evolve", "rocksample-7x8", "--parameters", str(tmp_path / "p.toml"), "--generations", "0"]
        assert main([*arguments, "--out", str(tmp_path / "a")]) == 2
        assert main([*arguments, "--population", "301", "--episodes", "2", "--out", str(tmp_path / "b")]) == 0


class TestMisuse:
    def refused(self, capsys, *arguments):
        try:
            status = main([str(a) for a in arguments])
        except SystemExit as error:
            status = error.code
        assert status == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.count("\n") == 1
        assert len(captured.err) < 320
        return captured.err

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            (b"popualtion = 3", "no parameter 'popualtion'; did you mean 'population'?"),
            (b"a = 3", "no parameter 'a' (see: harness evolve --help)"),
            (b"population = 3.5", "population must be a whole number, not 3.5"),
            (b"population = 1", "population must be 2 or more, not 1"),
            (b"population = 9" + b"9" * 3000, "population must be"),
            (b"population = 9" + b"9" * 5000, "no TOML"),
            (b"tail = inf", "tail must be 10 or less, not inf"),
            (b"tail = nan", "tail must be 0 or more, not nan"),
            (b'crossover = "subtre"', "did you mean 'subtree'"),
            (b"loop = 1", "loop must be true or false"),
            (b"[population]\nx = 1", "population must be a whole number"),
            (b"population 3", "no TOML (Expected '='"),
            (b"population = 3\npopulation = 4", "no TOML"),
            (b"\xff\xfe", "no TOML"),
            (b"x = " + b"[" * 50_000, "no TOML"),
            (b"a." * 40_000 + b"b = 1", "no TOML (over 100 dots in line 1)"),
            (b"#" * 200_000, "more than 100,000 bytes"),
            (None, "cannot read"),
        ],
    )
    def test_a_wrong_file_is_one_sentence_that_names_it(self, capsys, tmp_path, content, words):
        path = tmp_path / "p.toml"
        if content is not None:
            path.write_bytes(content)
        out = tmp_path / "out"
        err = self.refused(capsys, "evolve", "rocksample-7x8", "--parameters", path, "--out", out)
        assert words in err
        assert str(path) in err
        assert not out.exists()

    def test_a_resumed_run_takes_none(self, capsys, run):
        err = self.refused(capsys, "evolve", "--resume", run, "--parameters", run / "parameters.toml")
        assert "parameters cannot be changed" in err

    @pytest.mark.parametrize(
        ("option", "value", "words"),
        [
            ("--tail", "inf", "tail must be 10 or less"),
            ("--max-wraps", "1000000000", "max_wraps must be 1000 or less"),
            ("--population", "1000000000", "population must be 1000000 or less"),
            ("--population", "500000", "must be 100,000,000 or less when multiplied"),
            ("--tournament", "1000000", "population and tournament must be"),
            ("--horizon", "99999999999", "horizon must be 1000000 or less"),
            ("--episodes", "1000000", "population and episodes must be"),
            ("--penalty", "nan", "penalty must be 0 or more"),
            ("--seed", "9" * 5000, "is not a whole number"),
        ],
    )
    def test_limits_are_stated_and_nothing_is_left_behind(self, capsys, tmp_path, option, value, words):
        out = tmp_path / "out"
        assert words in self.refused(capsys, "evolve", "rocksample-7x8", option, value, "--out", out)
        assert not out.exists()


def test_the_help_names_the_words_of_the_shaping(capsys):
    with pytest.raises(SystemExit):
        main(["evolve", "--help"])
    text = capsys.readouterr().out
    section = text[text.rindex("--shaping") :].split("--loop")[0]
    for word in {word for name in registry.names() for word in registry.load(name).shapings}:
        assert re.search(rf"\b{word}\b", section)
