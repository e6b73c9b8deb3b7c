"""What a terminal and a notebook show of results: short, and what they say is so."""

from __future__ import annotations

import re
from html import unescape

import pytest

import harness
from harness.program import parse, words_of

SEARCH = {"population": 10, "generations": 2, "episodes": 10, "test_episodes": 20, "validation_episodes": 20}


@pytest.fixture(scope="module")
def results():
    domain = harness.load("rocksample-7x8")
    search = {**SEARCH, "score_episodes": 30, "engine": "tables"}
    return {
        "Domain": domain,
        "Evaluation": harness.evaluate(domain, "belief", episodes=200, engine="tables"),
        "Evolution": harness.evolve(domain, **search),
        "Evolutions": harness.evolve(domain, runs=2, workers=1, **search),
        "Tuned": harness.tune(domain, "belief:0.92", episodes=20, iterations=2, final_episodes=20, engine="tables"),
        "Program": parse("check(3)\nif(belief(3) > 0.74 and not belief(2) < 0.5) sample()\n", words_of(domain)),
    }


KINDS = ["Domain", "Evaluation", "Evolution", "Evolutions", "Tuned", "Program"]


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_one_short_line(results, kind):
    shown = repr(results[kind])
    assert shown.startswith(f"<{kind} ")
    assert "\n" not in shown
    assert len(shown) < 300


@pytest.mark.parametrize("kind", KINDS)
def test_a_card_says_what_the_line_says(results, kind):
    card = results[kind]._repr_html_()
    facts = dict(re.findall(r"<th>(.*?)</th><td>(.*?)</td>", card))
    for name, value in facts.items():
        assert name == "title" or f"{name} {unescape(value)}" in repr(results[kind])
    assert len(card) < 3000


def test_the_figures_are_the_score_s(results):
    result = results["Evaluation"]
    assert f"return {result.score.mean:.2f} ± {result.score.sem:.2f}" in repr(result)
    assert "belief:0.84 on rocksample-7x8" in repr(result)
    assert f"states {results['Domain'].n_states:,}" in repr(results["Domain"])
    assert "shaping paper" in repr(harness.load("bordercross-7x8").shaped("paper"))
    best = results["Evolution"].best
    assert f"return {best.score.mean:.2f} ± {best.score.sem:.2f}" in repr(results["Evolution"])


@pytest.mark.parametrize("kind", ["Evolution", "Program"])
def test_a_program_is_text_in_a_notebook(results, kind):
    """Escaped: its comparisons are no tags."""
    program = results[kind].best.program if kind == "Evolution" else results[kind]
    (shown,) = re.findall(r"<pre>(.*?)</pre>", results[kind]._repr_html_(), re.DOTALL)
    assert unescape(shown) == program.text
    assert "<" not in shown
