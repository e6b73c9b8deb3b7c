"""The figures of the README and the pages are those of ``docs/measured.toml``, and these are what comes out."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import harness
from harness import registry
from harness.score import published
from harness.solver import solution

ROOT = Path(__file__).parent.parent
sys.path.append(str(ROOT / "docs"))

import generated  # noqa: E402

MEASURED, FIGURES = generated.measured(), generated.figures()
PAGES = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md")}
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAPERS = {"0.8439", "0.9310"}  # the thresholds that it publishes
OTHERS = {"0.90", "0.97", "0.13", "0.87", "3.10", "7.4"}  # thresholds in the text, a Python, millions of states
ERRORS = {"mean": "sem", "discounted_mean": "discounted_sem"}  # of a difference: its column and _sem


def text(value, error, like):
    """A value and its error with the decimals of a figure."""
    decimals = len(like.rpartition(".")[2])
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


def prose(page):
    """Without code, tables as printed, and what stands between backquotes; in one line."""
    bare = re.sub(r"^```.*?^```|`[^`]*`", "", page, flags=re.DOTALL | re.MULTILINE)
    return " ".join(bare.split())


@pytest.fixture(scope="module")
def tables():
    """The comparisons by their ``against``, each of all policies that the figures need."""
    return {
        against: harness.compare("rocksample-7x8", sorted(policies), against=against, engine="tables").set_index(
            "policy"
        )
        for against, policies in _needed().items()
    }


def _needed():
    needed: dict = {}
    for entry in MEASURED["compare"]:
        needed.setdefault(entry.get("against"), set()).add(entry["policy"])
    needed[None] |= {"sarsop"}
    return needed


@pytest.mark.parametrize("entry", MEASURED["compare"], ids=lambda entry: entry["name"])
def test_a_comparison_gives_the_figure(tables, entry):
    row, column = tables[entry.get("against")].loc[entry["policy"]], entry["column"]
    assert entry["figure"] == text(row[column], row[ERRORS.get(column, f"{column}_sem")], entry["figure"])


@pytest.mark.parametrize("entry", MEASURED["record"], ids=lambda entry: entry["name"])
def test_a_record_holds_the_figure(entry):
    found = _record(entry["domain"], entry["policy"])[entry["key"]]
    assert abs(found - float(entry["figure"])) <= 0.5 * 10.0 ** -len(entry["figure"].partition(".")[2])


def _record(domain, policy):
    return solution.read(registry.policy_path(domain, policy), harness.load(domain), *solution.OWN_KINDS).record


def test_the_derived_figures_follow(tables):
    sarsop = published.reference("rocksample-7x8", "sarsop")
    optimum = _record("rocksample-7x8", "solved")["lower"]
    errors = tables[None].loc[["sarsop", "belief:0.84"], "discounted_sem"]
    assert {entry["name"]: entry["figure"] for entry in MEASURED["derived"]} == {
        "published_share": f"{sarsop.value / optimum:.1%}"[:-1],
        "sarsop_over_belief_unpaired": f"{np.hypot(*errors):.3f}",
    }


def test_tuning_gives_the_figures():
    tuned = harness.tune("rocksample-7x8", "belief:0.92", episodes=1000, iterations=6, engine="tables")
    best, start, gain = tuned.best.score, tuned.start.score, tuned.gain
    found = {
        "best": (best.mean, best.sem),
        "start": (start.mean, start.sem),
        "gain": (gain.mean, gain.sem),
        "loss": (-gain.discounted_mean, gain.discounted_sem),
    }
    for entry in MEASURED["tuned"]:
        assert entry["figure"] == text(*found[entry["of"]], entry["figure"])
    assert tuned.best.policy in PAGES["tuning.md"]


def test_the_readme_has_no_other_figures():
    known = {number for figure in FIGURES.values() for number in re.findall(r"\d+\.\d+", figure)}
    known |= {f"{number:.2f}" for e in published.on("rocksample-7x8") for number in (e.value, e.error) if number}
    assert set(re.findall(r"\d+\.\d+", prose(README))) <= known | PAPERS | OTHERS
    for figure in re.findall(r"−?[\d.]+ ± [\d.]*\d", prose(README)):
        assert figure in FIGURES.values()


def test_the_pages_name_their_figures():
    for name, page in PAGES.items():
        assert not re.findall(r"[\d.]+ ± [\d.]+", prose(page)), f"{name}: put the figure into measured.toml"


def test_every_figure_is_spoken_of():
    named = set(re.findall(r"\{\{ (\w+) \}\}", "".join(PAGES.values())))
    assert named <= set(FIGURES) | set(generated.limits())
    for name, figure in FIGURES.items():
        assert name in named or figure in prose(README), name
