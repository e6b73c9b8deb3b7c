"""Published figures beside ours: the verdicts by hand, where each figure is from, and that other rules stay apart."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import re
from pathlib import Path

import pandas as pd
import pytest

import harness
from harness import registry
from harness.cli import main
from harness.score import listing, published, verdicts
from harness.score.literature import COLUMNS
from harness.score.rendering import footnote
from harness.solver import solution
from tests import models

ROOT = Path(__file__).parent.parent
NONE = math.nan


@pytest.fixture(scope="module")
def table():
    return harness.literature()


@pytest.mark.parametrize(
    ("value", "error", "ours", "ours_error", "verdict", "gap", "combined"),
    [
        ("100.0", 0.3, 100.9, 0.4, "reproduced", 0.9, 0.5),  # a 3-4-5 triangle; 2 · 0.5 of 100 is one per cent
        ("100.0", 0.3, 101.1, 0.4, "not reproduced", 1.1, 0.5),
        ("100.0", 0.3, 98.9, 0.4, "not reproduced", -1.1, 0.5),
        ("10.0", 0.3, 10.9, 0.4, "undecided", 0.9, 0.5),  # a tenth of the value
        ("-10.0", 0.3, -9.1, 0.4, "undecided", 0.9, 0.5),
        ("21.39", NONE, 21.6513, 0.0, "not reproduced", 0.2613, 0.0),
        ("21.39", NONE, 21.3949, 0.0, "reproduced", 0.0049, 0.0),  # it is printed as 21.39
        ("21.39", NONE, 21.3951, NONE, "not reproduced", 0.0051, 0.0),
        ("12544", NONE, 12544.4, 0.0, "reproduced", 0.4, 0.0),
        ("16.80", 0.30, 19.65, 0.90, "not reproduced", 2.85, 0.9487),
    ],
)
def test_verdicts_by_hand(value, error, ours, ours_error, verdict, gap, combined):
    found = verdicts.compared(value, error, ours, ours_error)
    assert found.verdict == verdict
    assert found.gap == pytest.approx(gap, abs=1e-9)
    assert found.error == pytest.approx(combined, abs=1e-4)


def test_every_figure_says_where_it_is_from(table):
    assert tuple(table.columns) == COLUMNS
    assert len(table) > 50
    for column in ("problem", "rules", "method", "quantity", "source", "place"):
        assert table[column].str.strip().ne("").all(), column
    assert set(table["seen"]) == {"source", "quoted", "recalled"}
    assert (table["place"].str.contains("memory") == (table["seen"] == "recalled")).all()


def test_every_figure_has_a_verdict_and_its_reason(table):
    assert set(table["verdict"]) <= set(verdicts.VERDICTS)
    alone = table["verdict"].isin(["other rules", "not run", "attainable"])
    assert table["why"][alone].ne("").all()
    assert table["run"][~alone].str.startswith("harness ").all()
    assert table["domain"][~alone].isin(registry.names()).all()


@pytest.mark.parametrize(
    ("value", "error", "high", "verdict"),
    [
        ("21.37", 0.22, 21.705, "attainable"),
        ("21.70", NONE, 21.705, "attainable"),
        ("21.71", NONE, 21.7051, "attainable"),  # it may be 21.705
        ("21.72", NONE, 21.705, "not attainable"),
        ("22.16", 0.22, 21.705, "not attainable"),
        ("-5.90", 0.66, -7.3, "not attainable"),
    ],
)
def test_a_method_that_is_not_here_is_judged_by_the_optimum(value, error, high, verdict):
    assert verdicts.within(value, error, high) == verdict


def test_methods_that_are_not_here_stand_beside_the_optimum(table):
    judged = table[table["verdict"] == "attainable"]
    assert {"AEMS2", "HSVI2", "Perseus", "PBVI"} <= set(judged["method"])
    assert judged[["optimum_low", "optimum_high"]].notna().all().all()
    assert judged[["ours", "gap"]].isna().all().all()
    assert (judged["run"] == "").all()
    assert (table["verdict"] == "not run").sum() < 8


def test_other_rules_stand_beside_nothing(table):
    other = table[table["verdict"] == "other rules"]
    assert {"RockSample(15, 15)", "RockSample(20, 20)"} <= set(other["problem"])
    assert other[["ours", "ours_error", "gap", "combined_error", "optimum_low"]].isna().all().all()
    assert (other["domain"] == "").all()
    assert (other["run"] == "").all()


def test_on_our_rules_nothing_published_exceeds_the_optimum(table):
    """Else the rules were others, whatever the file says."""
    known = table[table["optimum_high"].notna()]
    assert len(known) >= 15
    assert (known["value"] - 2 * known["error"].fillna(0) <= known["optimum_high"]).all()


def test_compare_shows_what_was_seen_on_the_same_rules_only():
    shown = published.on("rocksample-7x8")
    assert [(each.method, each.value, each.error) for each in shown] == [
        ("Rollout", 9.46, None),
        ("SARSOP", 21.39, None),
        ("POMCP", 20.71, 0.21),
        ("AEMS2", 21.37, 0.22),
        ("HSVI-BFS", 21.46, 0.22),
    ]
    assert {name for name in registry.names() if published.on(name)} == {"rocksample-7x8", "tag"}
    assert published.reference("rocksample-7x8", "pomcp:1000").value == 20.71
    assert published.reference("rocksample-7x8", "solved") is None
    assert "POMCP" not in [each.method for each in published.not_run_here("rocksample-7x8", ["pomcp:10", "exit"])]


def test_a_shorter_horizon_is_another_task():
    assert published.reference("rocksample-7x8", "sarsop", 49) is None
    assert published.not_run_here("rocksample-7x8", ["exit"], 49) == []
    assert published.reference("rocksample-7x8", "sarsop", 1000).value == 21.39


def test_a_domain_that_only_has_the_name_has_nothing_of_ours():
    for name in ("rocksample-7x8", "tiger"):
        namesake = dataclasses.replace(models.tiger(), name=name, version=0)  # as a user's are
        table = harness.compare(namesake, episodes=1, engine="tables")
        assert set(table["policy"]) == {"random", "random-legal", "rollout:100"}
        assert table["reference"].isna().all()
        assert table["optimum_high"].isna().all()
        assert "Published" not in footnote(table)
        with pytest.raises(harness.HarnessError, match="no solution is stored"):
            harness.evaluate(namesake, "solved", episodes=1)


def test_the_footnote_names_the_sources():
    reference = {"discounted_mean": 21.39, "error": None, "source": "Silver and Veness 2010, Monte-Carlo Planning"}
    columns = ["optimum_low", "optimum_high", "how"]
    rows = [{"domain": "rocksample-7x8", "policy": "sarsop", "horizon": 50, "reference": reference}]
    assert "published: discounted (Silver and Veness 2010)." in footnote(
        pd.DataFrame(rows).assign(**dict.fromkeys(columns))
    )


def test_a_bound_of_ours_is_read_from_what_ships(table):
    path = registry.policy_path("rocksample-11x11", "sarsop")
    lower = solution.read(path, harness.load("rocksample-11x11"), *solution.OWN_KINDS).record["lower"]
    row = table[(table["problem"] == "RockSample(11, 11)") & (table["value"] == 21.56)].iloc[0]
    assert row["ours"] == lower
    assert row["gap"] == pytest.approx(lower - 21.56)


def test_the_exact_figures_of_ours_are_what_is_computed(table):
    exact = table[table["run"].str.endswith("--policy sarsop --exact")]
    assert len(exact) == 3
    found = harness.exact("rocksample-7x8", "sarsop")
    returns = exact[exact["quantity"] == "discounted return"]["ours"].tolist()
    assert returns == [pytest.approx(found.discounted.middle, abs=5e-5)] * 2
    share = exact[exact["quantity"] != "discounted return"]["ours"].item()
    assert share == pytest.approx(100 * found.mean.middle / 50, abs=0.05)


def test_the_command_plays_the_policy_that_the_figure_is_of(table):
    beside = table[table["policy"].ne("") & table["ours"].notna()]
    assert len(beside) > 10
    for row in beside.itertuples():
        assert f" {row.domain} " in row.run
        assert f" {row.policy}" in row.run


def test_one_domain_or_problem(table):
    assert set(harness.literature("rocksample-11x11")["problem"]) == {"RockSample(11, 11)"}
    assert set(harness.literature("rocksample-15x15")["verdict"]) == {"other rules"}
    assert len(harness.literature("Tag")) == (table["problem"] == "Tag").sum() == 10
    for unknown, words in (
        ("Tigre", "did you mean 'Tiger'"),
        ("bordercross-7x8", "nothing published on 'bordercross-7x8'"),
    ):
        with pytest.raises(harness.HarnessError, match=words):
            harness.literature(unknown)


def test_the_command_prints_figures_verdicts_and_reasons(capsys):
    assert main(["literature", "--domain", "rocksample-7x8"]) == 0
    text = capsys.readouterr().out
    assert re.search(
        r"SARSOP +21\.39 +Silver and Veness 2010 \(quoted\) +21\.65 +sarsop +not reproduced \(\+0\.26", text
    )
    assert "(4) no AEMS2 here" in text
    assert text.endswith("16 figures: 5 not run, 4 not reproduced, 3 attainable, 2 reproduced, 2 undecided.\n")


@pytest.mark.parametrize("style", ["markdown", "latex"])
def test_other_formats_have_every_figure(table, style, tmp_path):
    assert main(["literature", "--format", style, "--out", str(tmp_path / "file")]) == 0
    text = (tmp_path / "file").read_text(encoding="utf-8")
    assert all(printed.lstrip("-") in text for printed in table["printed"])


def test_programs_get_every_column(capsys):
    main(["literature", "--format", "csv"])
    back = pd.read_csv(io.StringIO(capsys.readouterr().out))
    assert tuple(back.columns) == COLUMNS
    main(["literature", "--format", "json"])
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == len(back)
    assert rows[1]["value"] == 21.39
    assert rows[1]["error"] is None


def test_a_misspelt_domain_is_one_sentence(capsys):
    assert main(["literature", "--domain", "rocksample-7x9"]) == 2
    assert "did you mean 'rocksample-7x8'" in capsys.readouterr().err


def test_pandas_reads_the_file():
    read = pd.read_csv(published.FILE)
    assert read["value"].dtype == float
    assert len(read) == len(published.figures())
    assert not read.duplicated(["problem", "method", "value", "source"]).any()


def test_the_page_of_the_documentation_is_made_from_it(monkeypatch, table):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import generated

    page = generated.literature()
    assert all(source in page for source in table["source"])
    assert all(place in page for place in table["place"])
    assert all(f"`{run}`" in page for run in table["run"] if run)
    assert listing.tally(table) in page
