"""Grammars in a domain's own words: all that they derive are programs, of all words that the domain has."""

from __future__ import annotations

import functools
import tempfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness import registry
from harness.cli import main
from harness.ge import derived
from harness.ge import grammar as bnf
from harness.ge.initialisation import FULL, tree
from harness.ge.mapping import derive
from harness.program import NestingError, parse, words_of
from harness.program.words import ACT, BELIEF, IF, READING, REGISTER, VISIBLE

ODD = ["open-left", "up", "up()", "not", "move north", "7", "say 'x' | <b>", 'é#"', "check(3)", "loop"]
READINGS = ["none", "a b", 'with "one"', "with 'two'", """both " and ' """, "two  blanks", "0.5", "<x> | #"]


def made(actions, observations, states=3):
    """A domain of these names whose states all differ in what they pay."""
    a, s, o = len(actions), states, len(observations)
    return harness.from_arrays(
        np.full((a, s, s), 1 / s), np.full((a, s, o), 1 / o), np.arange(a * s).reshape(a, s), np.full(s, 1 / s), 0.9,
        actions=actions, observations=observations,
    )  # fmt: skip


@functools.cache
def domain_of(name):
    if name == "odd":
        return made(ODD, READINGS)
    if name == "nothing to see":
        return made(["a", "b"], ["none"], states=1)
    if name == "levels":
        return made(["a"], ["0", "2.5", "40"])
    if name.startswith("model."):
        return harness.load(write(name))
    return harness.load(name)


@functools.cache
def write(name):
    path = f"{tempfile.mkdtemp()}/{name}"
    source = {"model.pomdpx": "rocksample-7x8", "model.pomdp": "notebooks/tiger/tiger.npz"}[name]
    harness.write_model(harness.load(source), path)
    return path


@functools.cache
def grammar_of(name, feedback):
    return bnf.parse(harness.grammar(domain_of(name), feedback=feedback)), words_of(domain_of(name))


NAMES = [
    *harness.names(),
    "odd",
    "nothing to see",
    "levels",
    "model.pomdp",
    "model.pomdpx",
    "notebooks/tiger/tiger.npz",
]


@pytest.mark.parametrize("feedback", [False, True])
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30, deadline=None)
@given(codons=st.lists(st.integers(0, 2**31 - 1), min_size=40, max_size=400))
def test_all_sentences_are_programs(name, feedback, codons):
    grammar, words = grammar_of(name, feedback)
    phenotype = derive(grammar, np.array(codons, dtype=np.int32), 3).phenotype
    if phenotype is None:
        return
    try:
        program = parse(phenotype, words)
    except NestingError:
        assert feedback
        return
    assert parse(program.text, words).code.tobytes() == program.code.tobytes()  # as it is printed it is the same


KINDS = {
    "bordercross-7x8-random": {READING},
    "rocksample-7x8": {REGISTER, BELIEF},
    "rocksample-11x11": {READING, REGISTER, BELIEF, VISIBLE},
    "odd": {READING, REGISTER, BELIEF},
    "nothing to see": {BELIEF},
    "levels": {READING, BELIEF},
    "model.pomdp": {READING, BELIEF},
    "model.pomdpx": {READING, REGISTER, BELIEF, VISIBLE},
}


@pytest.mark.parametrize("name", KINDS)
def test_all_operations_and_all_kinds_of_conditions_are_said(name):
    grammar, words = grammar_of(name, False)
    draws = np.random.default_rng(1)
    texts = [derive(grammar, tree(grammar, 0, 14, FULL, 1000, draws)).phenotype for _ in range(60)]
    code = np.concatenate([parse(text, words).code for text in texts])
    acts = code["op"] == ACT
    assert set(code["arg"][acts]) == set(range(words.domain.n_actions))
    assert set(code["op"][~acts]) - {IF} == KINDS[name]


def test_readings_that_no_program_can_say_are_left_out():
    grammar, words = grammar_of("odd", False)
    said = {t.strip() for t in grammar.terminals}
    assert {'"a b"', "'with \"one\"'", "\"with 'two'\"", '"0.5"', '"<x> | #"'} <= said
    assert not any("both" in t or "blanks" in t or "none" in t for t in said)
    assert parse("action(5) action(4) open-left() up() action(2) check(3)", words).code["arg"].tolist() == [
        4,
        3,
        0,
        2,
        1,
        8,
    ]


def test_wide_rules_are_grouped_and_words_without_end_left_out(monkeypatch):
    """600 actions are all in reach of codons below 1,000; of states without end, no condition is about one of them."""
    many = made([f"go({i})" for i in range(600)], ["a", "b"], states=2)
    found = bnf.parse(harness.grammar(many))
    assert max(map(len, found.productions_of)) == derived.WIDEST
    assert {f"go({i})" for i in range(600)} <= {t.strip() for t in found.terminals}
    monkeypatch.setattr(derived, "MOST_COMPARED", 50)
    text = harness.grammar(made(["a"], ["x"], states=51))
    assert "# No condition is about its 51 belief features: more than 50." in text
    assert "belief(" not in text


def test_the_command_prints_what_evolve_takes(tmp_path, capsys):
    harness.write_model(harness.load("notebooks/tiger/tiger.npz"), model := tmp_path / "tiger.pomdp")
    assert main(["grammar", str(model), "--feedback"]) == 0
    (tmp_path / "mine.bnf").write_text(capsys.readouterr().out)
    assert main([
        "evolve", str(model), "--grammar", str(tmp_path / "mine.bnf"), "--out", str(tmp_path / "run"), "--population",
        "8", "--generations", "1", "--episodes", "5", "--test-episodes", "5", "--validation-episodes", "5",
        "--score-episodes", "5", "--max-init-depth", "12",
    ]) == 0  # fmt: skip
    assert (tmp_path / "run" / "grammar.bnf").read_text() == (tmp_path / "mine.bnf").read_text()


def test_hand_written_ones_come_first(capsys):
    for name, options, shipped in (
        ("rocksample-7x8", [], "rocksample"),
        ("rocksample-7x8", ["--feedback"], "rocksample-feedback"),
        ("bordercross-7x8", [], "bordercross"),
    ):
        assert main(["grammar", name, *options]) == 0
        assert capsys.readouterr().out == registry.grammar_path(shipped).read_text(encoding="utf-8")
    assert "derived from its words" in harness.grammar("rocksample-11x11")
    assert main(["grammar", "bordercros-7x8"]) == 2
    assert "did you mean 'bordercross-7x8'" in capsys.readouterr().err
