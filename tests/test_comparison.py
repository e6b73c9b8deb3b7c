"""The comparison table, for people and for programs."""

from __future__ import annotations

import io
import json
import re
from html import unescape

import numpy as np
import pandas as pd
import pytest

import harness
from harness.cli.scores import FORMATS
from harness.score import rendering

REQUIRED = [
    *("domain", "policy", "engine", "episodes", "seed", "mean", "sem", "ci_low", "ci_high"),
    *("discounted_mean", "discounted_sem", "steps_mean", "success_rate", "reference"),
]


@pytest.fixture(scope="module")
def table():
    return harness.compare("rocksample-7x8", ["exit", "belief:0.84", "sarsop", "mdp"], episodes=400, engine="tables")


def test_rows_have_what_programs_need(table):
    assert set(REQUIRED) <= set(table.columns)
    assert table["policy"].tolist() == ["exit", "belief:0.84", "sarsop", "mdp"]
    assert table["kind"].tolist() == ["policy"] * 3 + ["upper bound"]


def test_the_score_is_the_mean_of_the_episodes(table):
    returns = harness.evaluate("rocksample-7x8", "belief:0.84", episodes=400, engine="tables").returns
    row = table.set_index("policy").loc["belief:0.84"]
    assert row["mean"] == pytest.approx(np.mean(returns))
    assert row["sem"] == pytest.approx(np.std(returns, ddof=1) / 20)
    assert row["ci_low"] == pytest.approx(row["mean"] - 1.96 * row["sem"], abs=1e-3)
    assert row["ci_high"] == pytest.approx(row["mean"] + 1.96 * row["sem"], abs=1e-3)


def test_json_is_a_list_of_rows(table):
    rows = json.loads(harness.render(table, "json"))
    assert [r["policy"] for r in rows] == table["policy"].tolist()
    assert rows[2]["reference"]["discounted_mean"] == 21.39
    assert "Silver" in rows[2]["reference"]["source"]
    assert rows[0]["reference"] is None
    assert rows[3]["episodes"] is None
    assert all(set(REQUIRED) <= set(r) for r in rows)


def test_csv_opens_in_pandas(table):
    back = pd.read_csv(io.StringIO(harness.render(table, "csv")))
    np.testing.assert_allclose(back["mean"], table["mean"].astype(float))


@pytest.mark.parametrize("style", ["table", "markdown"])
def test_text_shows_every_policy_and_the_published_figures(table, style):
    text = harness.render(table, style)
    assert all(policy in text for policy in table["policy"])
    assert "mdp (upper bound)" in text
    assert "21.39" in text
    assert "POMCP 20.71 ± 0.21" in text


def test_expensive_planners_get_fewer_episodes_unless_told(monkeypatch):
    monkeypatch.setattr("harness.policy.rollout.RolloutPolicy.max_episodes", 3)
    monkeypatch.setattr("harness.score.comparison.EPISODES", 20)
    counts = harness.compare("rocksample-7x8", ["exit", "rollout:1"], engine="tables")["episodes"]
    assert counts.tolist() == [20, 3]
    counts = harness.compare("rocksample-7x8", ["rollout:1"], episodes=5, engine="tables")["episodes"]
    assert counts.tolist() == [5]


def test_the_default_is_all_that_the_domain_knows(rocksample):
    table = harness.compare(rocksample, episodes=2, engine="tables")
    assert table["policy"].tolist() == [
        "random",
        "random-legal",
        "exit",
        "rollout:100",
        "accuracy:0.93",
        "belief:0.84",
        "thresholds",
        "ge",
        "ge-feedback",
        "qmdp",
        "sarsop",
        "solved",
        "optimum",
    ]


def test_scores_are_never_shaped(bordercross):
    plain, shaped = (
        harness.compare(d, ["sarsop"], episodes=5, engine="tables")
        for d in (bordercross, bordercross.shaped("potential"))
    )
    assert plain["mean"].tolist() == shaped["mean"].tolist() == [500.0]


def test_nothing_runs_before_everything_is_checked(monkeypatch):
    monkeypatch.setattr("harness.score.comparison.evaluate", lambda *a, **k: pytest.fail("ran"))
    with pytest.raises(harness.PolicyError):
        harness.compare("rocksample-7x8", ["exit", "no-such-policy"], engine="tables")


def test_one_policy_or_a_mapping_will_do(rocksample):
    one = harness.compare(rocksample, "belief", episodes=5, engine="tables")
    assert one["policy"].tolist() == ["belief:0.84"]
    made = harness.policy.make("exit", rocksample)[1]
    assert harness.compare(rocksample, made, episodes=5, engine="tables")["mean"].tolist() == [10.0]
    named = harness.compare(rocksample, {"leave": made, "mine": "belief", "best": "mdp"}, episodes=5, engine="tables")
    assert named["policy"].tolist() == ["leave", "mine", "best"]
    assert named["mean"].tolist() == [10.0, one["mean"].item(), 50.0]
    with pytest.raises(harness.PolicyError, match="is no policy"):
        harness.compare(rocksample, 5, engine="tables")
    with pytest.raises(harness.HarnessError, match="no policies"):
        harness.compare(rocksample, [], engine="tables")


def test_several_domains_are_the_single_ones_below_each_other(rocksample, bordercross):
    settings = {"policies": ["random-legal", "sarsop", "mdp"], "episodes": 20, "engine": "tables"}
    both = harness.compare([rocksample, "bordercross-7x8"], **settings)
    parts = [harness.compare(d, **settings) for d in (rocksample, bordercross)]
    below = pd.concat(parts, ignore_index=True)
    pd.testing.assert_frame_equal(both.drop(columns="reference"), below.drop(columns="reference"))
    text = harness.render(both)
    for part in parts:
        assert harness.render(part).partition("\n\nreturn:")[0] in text
    assert "random-legal is 0" in text


@pytest.mark.parametrize(("domains", "message"), [(["rocksample-7x8"] * 2, "given twice"), ([], "no domain")])
def test_domains_are_different_and_there_is_one(domains, message):
    with pytest.raises(harness.HarnessError, match=message):
        harness.compare(domains, "random", engine="tables")


def test_the_first_columns_are_what_matters(table):
    with pd.option_context("display.width", 80, "display.max_columns", 0):
        shown = repr(table).splitlines()
    assert shown[0].split()[:3] == ["policy", "mean", "sem"]
    assert list(table)[:5] == ["policy", "mean", "sem", "discounted_mean", "discounted_sem"]


def test_a_notebook_shows_what_the_command_prints(table):
    """Every cell of the text is a cell of the HTML; a part of the table is an ordinary data frame."""
    cells = [unescape(text) for text in re.findall(r"<t[dh]>(.*?)</t[dh]>", table._repr_html_())]
    shown = rendering.shown(table)
    assert cells == [*shown, *shown.values.ravel()]
    assert "ci_low" not in table._repr_html_()
    assert "ci_low" in table[["policy", "ci_low"]]._repr_html_()


def test_the_command_knows_the_formats():
    assert FORMATS == rendering.FORMATS
    with pytest.raises(harness.HarnessError, match="did you mean 'latex'"):
        harness.render(pd.DataFrame(), "latx")
    with pytest.raises(harness.HarnessError, match="no whole comparison table: it has no column"):
        harness.render(pd.DataFrame())


@pytest.mark.parametrize("use", [harness.render, harness.aggregate, harness.compare_figure])
def test_a_table_without_a_column_is_refused(rocksample, use):
    table = harness.compare(rocksample, ["random-legal", "mdp"], episodes=5, engine="tables")
    with pytest.raises(harness.HarnessError, match="no whole comparison table: it has no column sem"):
        use(table.drop(columns="sem"))
    if use is not harness.render:
        with pytest.raises(harness.HarnessError, match="there are no rows to"):
            use(table.iloc[:0])


def test_latex_cells_are_those_of_the_text_escaped(rocksample):
    """Read back by what the signs mean in LaTeX; a name may hold any of them."""
    names = {"50% & more_or_less": "exit", "[a] {b} #1 $x^2~\\<": "random-legal"}
    table = harness.compare(rocksample, names, against="50% & more_or_less", episodes=20, engine="tables")
    text = harness.render(table, "latex")
    tabulars = re.findall(
        r"\\begin\{tabular\}\{l(r+)\}\n\\toprule\n(.*?)\\bottomrule\n\\end\{tabular\}", text, re.DOTALL
    )
    shown = [rendering.shown(table), rendering.differences(table)]
    for (columns, body), cells in zip(tabulars, shown, strict=True):
        lines = [line for line in body.splitlines() if line != r"\midrule"]
        read = [[_plain(cell) for cell in re.split(r"(?<!\\)&", line.removesuffix(r"\\"))] for line in lines]
        assert read == [list(cells), *cells.values.tolist()]
        assert {len(row) for row in read} == {1 + len(columns)}
        assert not re.search(r"^\s*\[", body, re.MULTILINE)
    outside = re.sub(r"\\begin.*?\\end\{tabular\}", "", text, flags=re.DOTALL)
    assert all(line.startswith("%") for line in outside.splitlines() if line)


def _plain(cell):
    """What a cell of LaTeX shows."""
    meaning = {r"\textbackslash{}": "\\", r"\textasciitilde{}": "~", r"\^{}": "^", r"\ensuremath{<}": "<",
               r"$\pm$": "±", "$-$": "-", "{[}": "["}  # fmt: skip
    pattern = "|".join([*map(re.escape, meaning), r"\\([&%$#_{}])"])
    return re.sub(pattern, lambda found: meaning.get(found[0], found[1]), cell).strip()


def test_a_pipe_in_a_name_is_no_cell_of_markdown(rocksample):
    table = harness.compare(rocksample, {"a|b": "exit"}, episodes=5, engine="tables")
    row = harness.render(table, "markdown").splitlines()[4]
    assert len(re.split(r"(?<!\\)\|", row)) == 8 + 2
