"""Rows of the score check whose expected return is computed: no sampling error, hence no test and no tolerance."""

from __future__ import annotations

import dataclasses
import functools
import re

import pytest

import harness
from harness.cli import main
from harness.regression import checking, computing, single, stored
from tests.test_cli import misuse
from tests.test_score_check import check, edit, play_instead, with_scores

LIST = """\
[[score]]
domain = "rocksample-7x8"
policy = "belief:0.95"
how = "exact"

[[score]]
domain = "rocksample-7x8"
policy = "exit"
how = "exact"

[[score]]
domain = "rocksample-7x8"
policy = "exit"
episodes = 100
engine = "tables"
"""


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    return with_scores(tmp_path_factory, LIST)


@pytest.fixture
def scores(shared, tmp_path):
    path = tmp_path / "scores.toml"
    path.write_text(shared)
    return path


def shift(monkeypatch, by):
    """Break the code: every expected return comes out otherwise."""

    def shifted(*arguments, **options):
        found = harness.exact(*arguments, **options)
        return dataclasses.replace(found, mean=harness.Interval(found.mean.low + by, found.mean.high + by))

    monkeypatch.setattr(computing, "exact", shifted)


def test_what_is_stored_is_the_expected_return(scores):
    """Going right from column 1 to the exit is seven steps, the last of which pays 10."""
    score = stored.read(scores).stored["rocksample-7x8", "exit", 50, "exact"]
    assert (score.how, score.mean, score.steps_mean, score.success_rate) == ("exact", 10.0, 7.0, 1.0)
    assert score.discounted_mean == pytest.approx(10 * 0.95**6, abs=1e-12)
    computed = stored.read(scores).stored["rocksample-7x8", "belief:0.95", 50, "exact"]
    played = harness.evaluate("rocksample-7x8", "belief:0.95", episodes=50_000, engine="tables").score
    assert abs(computed.mean - played.mean) < 4 * played.sem


@pytest.mark.parametrize("options", [[], ["--exact"], ["--seed", "5"], ["--engine", "tables"]])
def test_unchanged_code_passes_and_is_shown_as_exact(scores, capsys, options):
    status, out = check(capsys, scores, *options)
    assert status == 0
    rows = [line for line in out.splitlines() if line.startswith("rocksample-7x8")]
    assert re.fullmatch(r"rocksample-7x8 +belief:0.95 +(\d\d\.\d{4}) +\1 +0 +exact +same", rows[0])
    assert "±" not in rows[0] + rows[1]
    assert "±" in rows[2]  # the sampled row of the same policy
    assert "Without ±: expected returns" in out


def test_a_drop_fails_without_a_p_value(scores, capsys, monkeypatch):
    play_instead(monkeypatch, "belief:0.95", "belief:0.93")
    status, out = check(capsys, scores)
    assert status == 1
    assert "belief:0.95 on rocksample-7x8 got worse by 1." in out
    assert " as computed (discounted " in out
    assert "p = " not in out


@pytest.mark.parametrize(
    ("by", "verdict", "status", "strict"),
    [(-0.06, "WORSE", 1, 1), (-0.04, "changed", 0, 1), (1e-11, "same", 0, 0), (0.04, "changed", 0, 1),
     (0.06, "better", 0, 1)],
)  # fmt: skip
def test_the_verdict_is_of_the_difference_alone(scores, capsys, monkeypatch, by, verdict, status, strict):
    """0.05 is the minimal effect; what is below rounding is none."""
    shift(monkeypatch, by)
    found, out = check(capsys, scores)
    assert found == status
    rows = [line.split() for line in out.splitlines() if line.startswith("rocksample-7x8 ")]
    assert [row[-2:] for row in rows] == [["exact", verdict], ["exact", verdict], ["exact", "same"]]
    assert check(capsys, scores, "--exact")[0] == strict


def test_intervals_are_told_apart_where_they_do_not_meet(scores, capsys, monkeypatch):
    monkeypatch.setattr(computing, "exact", functools.partial(harness.exact, memory=100_000))
    assert main(["check", str(scores), "--update"]) == 0
    assert re.search(r"belief:0.95 on rocksample-7x8: [\d.]+ → [\d.-]+ to [\d.]+", capsys.readouterr().out)
    score = stored.read(scores).stored["rocksample-7x8", "belief:0.95", 50, "exact"]
    assert score.how == "interval"
    assert score.mean_low < 48 < score.mean_high
    status, out = check(capsys, scores)
    assert status == 0
    assert re.search(r"belief:0.95 .* to .* interval +same", out)
    monkeypatch.setattr(computing, "exact", harness.exact)
    assert " changed" in check(capsys, scores)[1]  # inside the interval: nothing proves a loss
    width = score.mean_high - score.mean_low
    shift(monkeypatch, -width - 1)
    assert " WORSE" in check(capsys, scores)[1]


def test_what_draws_random_numbers_is_told(scores, capsys):
    edit(scores, '"exit"', '"random"')
    edit(scores, 'policy = "exit"\nhorizon = 50\nhow', 'policy = "random"\nhorizon = 50\nhow')
    status, out = check(capsys, scores)
    assert status == 1
    told = "random on rocksample-7x8: it draws random numbers, so that what it earns can only be sampled; leave how out"
    assert told in out
    before = scores.read_text()
    assert told in misuse(capsys, "check", scores, "--update")
    assert scores.read_text() == before


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("mean_low", "11.0", "mean_low is 11.0, which does not go with mean_high = 10.0"),
        ("how", '"guessed"', "how must be 'exact' or 'interval', not 'guessed'"),
        ("rounding", "1e9", "no key 'rounding' is known here"),
        ("steps_mean", "51.0", "its stored steps_mean is 51, and none is below 0 or above 50"),
        ("discounted_low", "", "'discounted_low' is missing"),
        ("model_hash", '"abc"', "not comparable; run harness check --update"),
    ],
)
def test_a_damaged_score_fails_its_row_and_is_mended(scores, shared, capsys, column, value, words):
    head, mark, rest = shared.rpartition('policy = "exit"\nhorizon = 50\nhow')
    line = f"{column} = {value}" if value else ""
    edited = re.sub(f"^{column} = .*$", line, f"how{rest}", count=1, flags=re.MULTILINE)
    edited = edited if column in f"how{rest}" else f"{line}\n{edited}"
    scores.write_text(head + mark.removesuffix("how") + edited)
    status, out = check(capsys, scores)
    assert status == 1
    assert words in out
    assert main(["check", str(scores), "--update"]) == 0
    assert scores.read_text() == shared


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('how = "exact"', 'how = "sure"', 4, "how must be 'sampled' or 'exact', not 'sure'"),
        ('how = "exact"', 'how = "exact"\nepisodes = 100', 5, "episodes is of sampled rows only; leave it out"),
        ('how = "exact"', 'how = "exact"\nseed = 3', 5, "seed is of sampled rows only"),
        ('policy = "exit"', 'policy = "belief:0.95"', 6, "belief:0.95 on rocksample-7x8 is listed twice"),
    ],
)
def test_misuse_names_file_and_line(tmp_path, capsys, old, new, line, words):
    path = tmp_path / "scores.toml"
    path.write_text(LIST)
    edit(path, old, new)
    said = misuse(capsys, "check", path)
    assert said.startswith(f"harness: {path}:{line}: ")
    assert words in said


def test_a_row_that_becomes_exact_has_no_score_yet(scores, capsys):
    edit(scores, 'episodes = 100\nengine = "tables"\n', 'how = "exact"\nhorizon = 40\n')
    outcomes = checking.check_scores(scores).outcomes
    assert [o.verdict for o in outcomes] == ["same", "same", "unscored", "vanished"]


def test_the_fixture_computes_too(tmp_path):
    """What ``score_regression.check(…, how="exact")`` does."""
    how = {"episodes": 10_000, "seed": 0, "horizon": 50, "engine": "auto", "max_episodes": None, "how": "exact"}
    path = tmp_path / "mine.toml"
    task = single.task("belief:0.95", "rocksample-7x8", **how)
    assert "no score was stored" in single.check(path, task, {}, exact=True, renew=False)
    assert single.check(path, task, {}, exact=True, renew=False) is None
    edit(path, "mean_low = ", "mean_low = 1")
    edit(path, "mean_high = ", "mean_high = 1")
    told = single.check(path, task, {}, exact=False, renew=False)
    assert "got worse by 100" in told
    assert re.search(r"mean_low +4\d\.\d+ +14\d\.", told)
    with pytest.raises(harness.HarnessError, match="seed is of sampled rows only"):
        single.task("exit", "rocksample-7x8", **{**how, "seed": 1})
