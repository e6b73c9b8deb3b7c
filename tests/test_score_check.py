"""`harness check`: what fails and what passes, what is told, what an update writes, and what a misuse is told."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

import harness
from harness import policy
from harness.cli import main
from harness.errors import HarnessError
from harness.play.evaluation import evaluate
from harness.regression import checking, ci, judging, reports, scoring, stored
from harness.regression.rows import Limits, Row
from tests.test_cli import LONG, interrupted_when_long, misuse

LIST = """\
# what we watch
[check]
min_effect = 0.05  # return units

[[score]]
domain = "rocksample-7x8"
policy = "belief:0.95"  # the better threshold
episodes = 10_000
engine = "tables"

[[score]]
domain = "rocksample-7x8"
policy = "exit"
episodes = 100
engine = "tables"
"""


def with_scores(tmp_path_factory, rows):
    """A list of rows with their scores stored below it."""
    path = tmp_path_factory.mktemp("scores") / "scores.toml"
    path.write_text(rows)
    assert main(["check", str(path), "--update"]) == 0
    return path.read_text()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    return with_scores(tmp_path_factory, LIST)


@pytest.fixture
def scores(shared, tmp_path):
    """A file of scores with two rows, stored."""
    path = tmp_path / "scores.toml"
    path.write_text(shared)
    return path


def check(capsys, *arguments):
    status = main(["check", *map(str, arguments)])
    return status, capsys.readouterr().out


def edit(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def play_instead(monkeypatch, asked, given):
    """Break the code: whoever asks for one policy gets another."""
    make = policy.make
    monkeypatch.setattr(policy, "make", lambda spec, domain: make(given if spec == asked else spec, domain))


def change_returns(monkeypatch, change, column="returns"):
    def changed(*arguments, **options):
        result = evaluate(*arguments, **options)
        return dataclasses.replace(result, **{column: change(getattr(result, column))})

    monkeypatch.setattr(scoring, "evaluate", changed)


def test_unchanged_code_passes_exactly(scores, capsys):
    before = scores.read_text()
    for options in ([], ["--exact"]):
        status, out = check(capsys, scores, *options)
        assert status == 0
        assert "2 rows: 2 same." in out
        assert out.count(" exact ") == 2
    assert scores.read_text() == before  # a check never writes


def test_other_episodes_are_compared_statistically(scores, capsys):
    status, out = check(capsys, scores, "--seed", "5")
    assert status == 0
    assert out.count("statistical") == 2
    assert "2 not worse" in out
    for outcome in checking.check_scores(scores, seed=5).outcomes:
        assert outcome.fresh.seed == 5
        assert outcome.fresh.reference_episodes == outcome.stored.reference_episodes  # equal numbers on both sides
        alone = stats.ttest_ind_from_stats(
            *spread(outcome.stored, less=0.05), *spread(outcome.fresh), equal_var=False, alternative="greater"
        ).pvalue
        if outcome.stored.sem:
            assert outcome.p == pytest.approx(min(1, 2 * alone))


def spread(score, less=0.0):
    n = score.reference_episodes
    return score.mean - less, score.sem * n**0.5, n


def test_a_real_drop_of_one_unit_fails(scores, capsys, monkeypatch):
    """The threshold 0.93 in place of 0.95 costs 1.1 units."""
    play_instead(monkeypatch, "belief:0.95", "belief:0.93")
    for options in ([], ["--seed", "8"], ["--exact"]):
        status, out = check(capsys, scores, *options)
        assert status == 1
        assert "WORSE" in out
        line = next(line for line in out.splitlines() if line.startswith(f"{scores}:5: "))
        assert "belief:0.95 on rocksample-7x8 got worse by 1." in line
        assert "1 worse, 1 " in out


def test_a_real_gain_passes_and_asks_to_be_kept(scores, capsys, monkeypatch):
    play_instead(monkeypatch, "belief:0.95", "belief:0.97")
    status, out = check(capsys, scores)
    assert status == 0
    assert "got better by" in out
    assert "keep it with harness check --update" in out
    assert check(capsys, scores, "--exact")[0] == 1


def test_a_change_that_costs_nothing_passes_unless_exact(scores, capsys, monkeypatch):
    change_returns(monkeypatch, lambda returns: np.roll(returns, 1))  # every mean as before, episodes not
    status, out = check(capsys, scores)
    assert status == 0
    assert "the same episodes came out differently" in out
    assert "1 changed, 1 same" in out
    status, out = check(capsys, scores, "--exact")
    assert status == 1
    assert "DIFFERS" in out


@pytest.mark.parametrize("column", ["returns", "discounted", "steps", "terminated"])
def test_exact_means_every_column_of_every_episode(scores, capsys, monkeypatch, column):
    def change(values):
        values = values.copy()
        values[7] = ~values[7] if column == "terminated" else values[7] + (1 if column == "steps" else 1e-9)
        return values

    change_returns(monkeypatch, change, column)
    assert check(capsys, scores)[0] == 0
    status, out = check(capsys, scores, "--exact")
    assert status == 1
    assert "DIFFERS" in out


@pytest.mark.parametrize(("loss", "status"), [(0.04, 0), (0.06, 1)])
def test_a_deterministic_policy_is_compared_without_a_test(scores, capsys, monkeypatch, loss, status):
    change_returns(monkeypatch, lambda returns: returns - loss * (returns.std() == 0))
    assert check(capsys, scores)[0] == status


def test_a_mean_that_is_no_number_fails(scores, capsys, monkeypatch):
    change_returns(monkeypatch, lambda returns: returns * np.nan)
    status, out = check(capsys, scores)
    assert status == 1
    assert out.count("DAMAGED") == 2
    assert "its mean return is now nan" in out
    before = scores.read_text()
    assert main(["check", str(scores), "--update"]) == 2
    assert scores.read_text() == before


@pytest.mark.parametrize(
    ("line", "instead", "words"),
    [
        ("mean = .*", "", "'mean' is missing"),
        ("mean = .*", "mean = nan", "'mean' is nan, no finite number"),
        ("mean = .*", 'mean = "high"', "'mean' must be a number, not 'high'"),
        ("sem = .*", "sems = 0.1", "no key 'sems' is known here; did you mean 'sem'?"),
        ("sem = .*", "sem = -1.0", "sem must be 0 or more"),
    ],
)
def test_a_stored_column_missing_or_wrong_fails_its_row_only(scores, capsys, line, instead, words):
    scores.write_text(re.sub(f"^{line}$", instead, scores.read_text(), count=1, flags=re.MULTILINE))
    status, out = check(capsys, scores)
    assert status == 1
    assert words in out
    assert "1 damaged, 1 same" in out
    assert check(capsys, scores, "--update")[0] == 0
    assert check(capsys, scores)[0] == 0


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("mean", "99.0", "its stored mean is 99, but the stored episodes give"),
        ("sem", "1000", "its stored sem is 1000, and none is"),
        ("sem", "0.001", "its stored sem is 0.001, but the stored episodes give"),
        ("discounted_mean", "20.0", "its stored discounted_mean is 20, but"),
        ("steps_mean", "51.0", "its stored steps_mean is 51, and none is below 0 or above 50"),
        ("success_rate", "7.0", "its stored success_rate is 7, and none is"),
        ("success_rate", "0.5", "its stored success_rate is 0.5, but"),
        ("reference_episodes", "9999", "reference_episodes must be 10000 or more"),
        ("engine", '"banana"', "engine must be tables or julia, not 'banana'"),
    ],
)
def test_an_edited_figure_fails_its_row_and_is_mended(scores, shared, capsys, column, value, words):
    """With the old digest: the episodes come out as stored, but what is said of them is not theirs."""
    rows, mark, figures = shared.partition("[[stored]]")
    edited = re.sub(f"^{column} = .*$", f"{column} = {value}", figures, count=1, flags=re.MULTILINE)
    scores.write_text(rows + mark + edited)
    status, out = check(capsys, scores)
    assert status == 1
    assert words in out
    assert "1 damaged, 1 same" in out
    assert main(["check", str(scores), "--update"]) == 0
    assert scores.read_text() == shared


def test_what_no_score_can_be_is_noticed_on_other_episodes_too(scores, capsys):
    edit(scores, "success_rate = 1.0", "success_rate = 1.01")
    status, out = check(capsys, scores, "--seed", "5")
    assert status == 1
    assert "its stored success_rate is 1.01, and none is" in out


@pytest.mark.parametrize(
    ("limits", "word"),
    [
        ("false_alarm = 0.9999999", "false_alarm = 0.9999999 is large"),
        ("min_effect = 1000\ndrop = 2000", "min_effect = 1000 is large"),
    ],
)
def test_limits_that_let_all_pass_or_fail_get_a_word(scores, capsys, limits, word):
    assert " is large" not in check(capsys, scores)[1]
    edit(scores, "min_effect = 0.05  # return units", limits)
    assert word in check(capsys, scores)[1]


def test_an_update_follows_a_symbolic_link_and_keeps_the_mode(scores, tmp_path):
    link = tmp_path / "link.toml"
    link.symlink_to(scores)
    scores.chmod(0o600)
    edit(scores, "episodes = 100\n", "episodes = 200\n")
    assert main(["check", str(link), "--update"]) == 0
    assert link.is_symlink()
    assert "reference_episodes = 200" in scores.read_text()
    assert scores.stat().st_mode & 0o777 == 0o600
    assert {path.name for path in tmp_path.iterdir()} == {"link.toml", "scores.toml"}


def test_a_score_stored_twice_fails(scores, capsys):
    text = scores.read_text()
    scores.write_text(text + "\n" + text[text.rindex("[[stored]]") :])
    status, out = check(capsys, scores)
    assert status == 1
    assert "two scores are stored for it, in lines " in out


def test_a_vanished_row_fails(scores, capsys):
    scores.write_text(scores.read_text().replace(LIST[LIST.rindex("[[score]]") :], ""))
    status, out = check(capsys, scores)
    assert status == 1
    assert "exit on rocksample-7x8: a score is stored for it, but it is no longer listed" in out
    status, out = check(capsys, scores, "--update")
    assert "exit on rocksample-7x8: 10.00 ± 0.00 dropped, no longer listed" in out
    assert check(capsys, scores)[0] == 0


def test_a_row_without_a_score_fails_until_it_is_stored(scores, capsys):
    with scores.open("a") as file:
        file.write('\n# added below the stored scores\n[[score]]\ndomain = "bordercross-7x8"\npolicy = "sarsop"\n')
    status, out = check(capsys, scores, "--engine", "tables")
    assert status == 1
    assert "no score is stored for it; run harness check --update" in out
    assert "2 same, 1 unscored" in out
    status, out = check(capsys, scores, "--update")
    assert out.splitlines() == [
        "sarsop on bordercross-7x8: 500.00 ± 0.00 stored, 10,000 episodes",
        "1 moved, 2 as before",
    ]
    assert "# added below the stored scores\n[[score]]" in scores.read_text()


@pytest.mark.parametrize(("column", "value"), [("domain_version", "0"), ("model_hash", '"abc"')])
def test_another_model_is_not_compared(scores, capsys, column, value):
    scores.write_text(
        re.sub(f"^{column} = .*$", f"{column} = {value}", scores.read_text(), count=1, flags=re.MULTILINE)
    )
    status, out = check(capsys, scores)
    assert status == 1
    assert "not comparable; run harness check --update" in out
    status, out = check(capsys, scores, "--update")
    assert "on another model of the domain: not comparable" in out
    assert check(capsys, scores)[0] == 0


def test_a_row_with_other_episodes_than_stored_is_compared_statistically(scores, capsys):
    edit(scores, "episodes = 10_000", "episodes = 9_000")
    status, out = check(capsys, scores)
    assert (status, out.count("statistical"), out.count(" exact ")) == (0, 1, 1)
    status, out = check(capsys, scores, "--exact")
    assert status == 1
    assert "cannot be compared exactly: the row says 9,000 episodes of seed 0, stored are 10,000 of seed 0" in out


def test_update_prints_what_moved_and_keeps_the_rest(scores, capsys, monkeypatch):
    before = scores.read_text()
    status, out = check(capsys, scores, "--update")
    assert (status, out) == (0, "0 moved, 2 as before\n")
    assert scores.read_text() == before
    change_returns(monkeypatch, lambda returns: returns + 1.0)
    status, out = check(capsys, scores, "--update")
    old, new = re.search(r"belief:0.95 on rocksample-7x8: ([\d.]+) ± .* → ([\d.]+) ± ", out).groups()
    assert float(new) - float(old) == pytest.approx(1)
    size = float(re.search(r"\(\+([\d.]+) standard errors\)", out).group(1))
    error = stored.read(scores).stored["rocksample-7x8", "belief:0.95", 50, "sampled"].sem * 2**0.5
    assert size == pytest.approx(1 / error, abs=0.06)
    assert "exit on rocksample-7x8: 10.00 ± 0.00 → 11.00 ± 0.00 (+1 exactly)" in out
    assert "2 moved, 0 as before" in out
    assert scores.read_text().startswith(LIST)  # comments and order of the list
    assert not list(scores.parent.glob("*.part"))


def test_other_limits_need_other_episodes(scores, capsys):
    """An update keeps a score whose episodes are as before only if it rests on as many as the limits now ask for."""
    edit(scores, "[check]", "[check]\ndrop = 2.0")
    assert "1 moved, 1 as before" in check(capsys, scores, "--update")[1]
    (score, _) = stored.read(scores).stored.values()
    assert score.reference_episodes == 10_000
    assert score.mean == evaluate("rocksample-7x8", "belief:0.95", episodes=10_000, engine="tables").score.mean


def test_the_stored_score_is_that_of_the_planned_episodes(scores):
    score = stored.read(scores).stored["rocksample-7x8", "belief:0.95", 50, "sampled"]
    result = evaluate("rocksample-7x8", "belief:0.95", episodes=score.reference_episodes, engine="tables").score
    assert score.reference_episodes > score.episodes == 10_000
    assert (score.mean, score.sem, score.steps_mean) == (result.mean, result.sem, result.steps_mean)
    outcome = checking.check_scores(scores).outcomes[0]
    assert 0.8 < outcome.smallest_drop <= 1  # planned for 100 rows, and here are two


MISUSES = [
    ("policy =", "polcy =", 7, "no key 'polcy' is known here; did you mean 'policy'?"),
    ('"exit"', '"exti"', 11, "no policy 'exti'; did you mean 'exit'?"),
    ('"exit"', '"belief:0.95"', 11, "belief:0.95 on rocksample-7x8 is listed twice (first in line 5)"),
    ('domain = "rocksample-7x8"', 'domain = "rocksampl-7x8"', 5, "did you mean 'rocksample-7x8'?"),
    ('domain = "rocksample-7x8"', "", 5, "'domain' is missing"),
    ("episodes = 10_000", 'episodes = "many"', 8, "'episodes' must be a whole number, not 'many'"),
    ("episodes = 10_000", "episodes = true", 8, "'episodes' must be a whole number"),
    ("episodes = 10_000", "episodes = 5", 8, "episodes must be 30 or more, not 5"),
    ("episodes = 10_000", "max_episodes = 99", 8, "max_episodes (99) must not be below episodes (10000)"),
    ("episodes = 10_000", "seed = -1", 8, "seed must be a whole number from 0"),
    ("episodes = 10_000", "horizon = 0", 8, "horizon must be 1 or more, not 0"),
    ('engine = "tables"', 'engine = "table"', 5, "did you mean 'tables'?"),
    ("min_effect = 0.05", "min_effct = 0.05", 3, "did you mean 'min_effect'?"),
    ("min_effect = 0.05", "min_effect = 2", 2, "drop must be larger than min_effect (2.0)"),
    ("min_effect = 0.05", "false_alarm = 1.0", 3, "false_alarm must lie between 0 and 1"),
    ("[check]", "[chek]", 2, "no section 'chek' is known here; did you mean 'check'?"),
    ("[check]", "[[check]]", 2, "'check' must be written [check]"),
]


@pytest.mark.parametrize(("old", "new", "line", "words"), MISUSES)
def test_misuse_names_file_and_line(tmp_path, capsys, old, new, line, words):
    path = tmp_path / "scores.toml"
    path.write_text(LIST)
    edit(path, old, new)
    for options in ([], ["--update"]):
        said = misuse(capsys, "check", path, *options)
        assert said.startswith(f"harness: {path}:{line}: ")
        assert words in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "lists nothing to score"),
        ("[[score]\n", "not TOML: "),
        ("\n\nx = \n", "line 3"),
        ("score = 3\n", "'score' must be written [[score]]"),
        ("[score]\ndomain = 'a'\n", "'score' must be written [[score]]"),
        (b"\xff\xfe", "no UTF-8 text"),
        ("# long\n" * 150_000, "longer than 1,048,576 bytes"),
        ("# short\n" + "a." * 60_000 + "b = 1", "not TOML: over 100 dots in line 2"),
        ("x = " + "9" * 5_000, "not TOML: "),
        ("x = " + "[" * 100_000, "not TOML: "),
    ],
)
def test_files_that_are_no_lists(tmp_path, capsys, text, words):
    path = tmp_path / "scores.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert words in misuse(capsys, "check", path)


def test_misuse_of_options(scores, tmp_path, capsys):
    assert "no such file" in misuse(capsys, "check", tmp_path / "none.toml")
    assert "leave out either --exact or --seed" in misuse(capsys, "check", scores, "--exact", "--seed", "1")
    assert "leave out --junit" in misuse(capsys, "check", scores, "--update", "--junit", "x.xml")
    assert "did you mean 'tables'" in misuse(capsys, "check", scores, "--engine", "tabels")


def test_junit(scores, capsys, monkeypatch, tmp_path):
    play_instead(monkeypatch, "belief:0.95", "belief:0.93")
    with scores.open("a") as file:
        file.write('\n[[score]]\ndomain = "bordercross-7x8"\npolicy = "sarsop"\n')
    path = tmp_path / "out.xml"
    assert check(capsys, scores, "--junit", path, "--engine", "tables")[0] == 1
    root = ElementTree.parse(path).getroot()
    (suite,) = root
    assert [(n, suite.get(n)) for n in ("tests", "failures", "errors")] == [
        ("tests", "3"),
        ("failures", "1"),
        ("errors", "1"),
    ]
    cases = {(case.get("classname"), case.get("name")): case for case in suite}
    assert "got worse by" in cases["rocksample-7x8", "belief:0.95"].find("failure").get("message")
    assert cases["rocksample-7x8", "belief:0.95"].get("line") == "5"
    assert cases["bordercross-7x8", "sarsop"].find("error").get("type") == "unscored"
    assert cases["rocksample-7x8", "exit"].find("failure") is None


def test_github(scores, capsys, monkeypatch, tmp_path):
    summary = tmp_path / "summary.md"
    summary.write_text("before\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    play_instead(monkeypatch, "belief:0.95", "belief:0.93")
    status, out = check(capsys, scores, "--github")
    assert status == 1
    (line,) = [line for line in out.splitlines() if line.startswith("::")]
    head, _, message = line[2:].partition("::")
    file = str(scores).replace(":", "%3A").replace(",", "%2C")
    assert head == f"error file={file},line=5,title=belief%3A0.95 on rocksample-7x8%3A worse"
    assert "got worse by" in message
    assert "%25" in message  # the success rate's per cent sign
    assert "%" not in message.replace("%25", "")
    written = summary.read_text()
    assert written.startswith("before\n### Scores: some rows failed")
    assert sum(line.startswith("|") for line in written.splitlines()) == 2 + 2  # heading, rule, two rows
    monkeypatch.delenv("GITHUB_STEP_SUMMARY")
    assert check(capsys, scores, "--github")[0] == 1  # elsewhere than on GitHub: annotations alone


def test_awkward_names_are_escaped():
    row = Row("a,b", "alpha:x\x01\r\ny%z<&>.npz")
    outcome = judging.Outcome(row, "unscored", "", reason="first\nsecond: 100 %")
    told = judging.ScoreCheck(Path("s,c:o.toml"), Limits(), (outcome,))
    (line,) = ci.github_annotations(told).splitlines()
    title = "alpha%3Ax\x01%0D%0Ay%25z<&>.npz on a%2Cb%3A unscored"
    assert line.startswith(f"::error file=s%2Cc%3Ao.toml,line=1,title={title}::")
    assert line.endswith("first%0Asecond: 100 %25")
    (case,) = ElementTree.fromstring(ci.junit(told).encode()).iter("testcase")
    assert case.get("name").endswith("y%z<&>.npz")
    assert "alpha" in reports.text(told)


def test_check_scores_from_python(scores):
    result = harness.check_scores(scores)
    assert result.passed
    assert [o.verdict for o in result.outcomes] == ["same", "same"]
    assert [move.before == move.after for move in harness.update_scores(scores)] == [True, True]
    with pytest.raises(HarnessError, match="no such file"):
        harness.check_scores(scores.parent / "none.toml")


def test_holm_counts_the_rows_not_finished_after_ctrl_c(scores, monkeypatch):
    edit(scores, 'policy = "exit"', 'policy = "random-legal"')
    measure, played = scoring.measure, []

    def interrupted(task, score):
        if played:
            raise KeyboardInterrupt
        played.append(task)
        return measure(task, score)

    whole = checking.check_scores(scores, seed=3).outcomes[0]
    monkeypatch.setattr(scoring, "measure", interrupted)
    with pytest.raises(checking.Interrupted) as stop:
        checking.check_scores(scores, seed=3)
    (outcome,) = stop.value.check.outcomes
    assert (outcome.p, outcome.smallest_drop) == (whole.p, whole.smallest_drop)


def test_ctrl_c_prints_the_rows_finished(tmp_path):
    """In a process of its own, interrupted for real."""
    path = tmp_path / "scores.toml"
    row = '[[score]]\ndomain = "rocksample-7x8"\npolicy = "{}"\nepisodes = {}\nengine = "tables"\n'
    path.write_text(row.format("exit", 100))
    checking.update_scores(path)
    exit_score = next(iter(stored.read(path).stored.values()))
    many = {"episodes": 100_000, "reference_episodes": 100_000}
    slow = dataclasses.replace(exit_score, policy="long.py:Long", **many)
    (tmp_path / "long.py").write_text(LONG)
    path.write_text(row.format("exit", 100) + row.format("long.py:Long", 100_000))
    stored.write(path, [exit_score, slow])
    command = [sys.executable, "-m", "harness", "check", "--allow-code", str(path)]
    out, err, process = interrupted_when_long(command, tmp_path)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "Traceback" not in err
    assert "1 row: 1 same" in out
    assert "Long" not in out


def test_ctrl_c_leaves_the_file_of_an_update_alone(scores, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    before = scores.read_text()
    monkeypatch.setattr(scoring, "renew", interrupted)
    assert main(["check", str(scores), "--update"]) == 130
    assert scores.read_text() == before


def test_what_cannot_be_written_is_told(scores, capsys):
    with pytest.raises(HarnessError, match="cannot write"):
        stored.write(scores / "below-a-file.toml", [])
    assert main(["check", str(scores), "--junit", "/no/file.xml"]) == 2
    assert "cannot write" in capsys.readouterr().err


def test_the_shipped_list_covers_the_named_7x8_domains():
    """Every default policy of theirs is watched, and stored; CI runs the check itself."""
    file = stored.read(Path(__file__).parent.parent / "scores.toml")
    listed = {(row.domain, row.policy) for row in file.rows}
    for name in ("rocksample-7x8", "bordercross-7x8", "bordercross-7x8-random"):
        assert {(name, spec) for spec in policy.default_specs(harness.load(name))} <= listed
    assert {row.key for row in file.rows} == set(file.stored)
    assert file.damaged == {}
