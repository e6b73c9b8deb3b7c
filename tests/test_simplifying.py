"""Programs without what changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness.cli import main
from harness.ge.simplifying import _parsed, acting, simplify
from harness.policy.program import ProgramPolicy
from harness.program import parse, shorter, words_of
from tests import models

TEXT = """check(3)
if(3 == "good" and 3 == "good") {
    up()
    down()
}
if(3 == "bad") check(2)
else check(1)
while(x() > 90) up()
right()
"""


@pytest.fixture(scope="module")
def rocksample():
    return harness.load("rocksample-7x8")


def without(text, at):
    return ["\n".join(lines) + "\n" for lines in shorter.candidates(text.splitlines(), at)]


def test_what_can_be_taken_from_a_program(rocksample):
    text = parse(TEXT, words_of(rocksample)).text
    lines = text.splitlines()
    assert without(text, 0) == ["\n".join(lines[1:]) + "\n"]
    block, condition = without(text, 1)
    assert block == "\n".join([lines[0], *lines[5:]]) + "\n"
    assert condition == "\n".join([lines[0], "up()", "down()", *lines[5:]]) + "\n"
    whole, other = without(text, 5)
    assert whole == "\n".join([*lines[:5], *lines[7:]]) + "\n"
    assert other == "\n".join([*lines[:6], *lines[7:]]) + "\n"
    assert without(text, 4) == without(text, 6) == []  # a brace, an else
    assert len(without(text, 7)) == 1  # a loop keeps its condition


def test_an_else_with_a_block_goes_as_a_whole(rocksample):
    text = parse("if(x() < 3) { up() down() } else { left() right() }\nup()", words_of(rocksample)).text
    _, other = without(text, 0)
    assert parse(other, words_of(rocksample)).text == "if(x() < 3) {\n    up()\n    down()\n}\nup()\n"


def random_text(generator, words, depth=2):
    actions, tests = list(words.actions), ["x() < 3", "belief(2) > 0.5", '3 == "good"']
    lines = []
    for _ in range(generator.integers(1, 4)):
        kind, action = generator.integers(5), actions[generator.integers(len(actions))]
        test = tests[generator.integers(len(tests))]
        if kind == 0 or depth == 0:
            lines.append(action)
        elif kind == 1:
            lines.append(f"if({test}) {action}")
        elif kind == 2:
            lines.append(f"if({test} and not {test}) {{ {random_text(generator, words, depth - 1)} }}")
        else:
            inside = [random_text(generator, words, depth - 1) for _ in range(2)]
            lines.append(f"if({test}) {{ {inside[0]} }} else {{ {inside[1]} }}")
    return "\n".join(lines)


def test_candidates_are_smaller_programs_or_none(rocksample):
    """Of random programs: what parses again is smaller, and every operation can go by some chain of candidates."""
    words, generator = words_of(rocksample), np.random.default_rng(3)
    for _ in range(100):
        program = parse(random_text(generator, words), words)
        while program.length > 1:
            found = [
                each
                for at in range(program.text.count("\n"))
                for lines in shorter.candidates(program.text.splitlines(), at)
                for each in _parsed(lines, program)
            ]
            assert found
            assert all(len(each.code) < len(program.code) for each in found)
            program = found[generator.integers(len(found))]


def test_the_shipped_programs_earn_the_same_with_fewer_statements(rocksample):
    for spec in ("ge", "ge-feedback"):
        found = simplify(rocksample, spec)
        assert found.episodes == 0
        assert found.program.length < found.original.length
        before, after = (harness.exact(rocksample, ProgramPolicy(p)) for p in found[:2])
        assert after.mean.low == pytest.approx(before.mean.low, abs=1e-9)
        assert after.discounted.low >= before.discounted.low - 1e-9  # fewer steps, same rewards
        assert simplify(rocksample, found.program).program.text == found.program.text


def test_what_earns_stays(rocksample):
    text = 'check(2)\ndown()\ndown()\nif(2 == "good") sample()\n'
    found = simplify(rocksample, f"up()\ndown()\n{text}check(5)\n")
    assert found.after > found.before  # the reading is taken one cell nearer
    # A move up and one down can only go together; without the guard a bad rock would be sampled.
    assert sorted(found.program.text.splitlines()) == sorted(text.splitlines())
    assert simplify(rocksample, f"up()\ndown()\n{text}check(5)\n", episodes=2000).how == "on 2,000 episodes"


def test_acting_counts_lines(rocksample):
    program = parse('check(2)\nwhile(y() > 2) down()\nif(2 == "good") sample()\nright()\n', words_of(rocksample))
    once, twice, half, last = acting(rocksample, program)
    assert (once, twice, last) == (1, 2, 1)
    assert half == pytest.approx(0.5, abs=0.06)  # rock 2 is good half the time, and a reading from there is right
    assert acting(rocksample, parse("loop up()", words_of(rocksample)), horizon=7).tolist() == [0, 7]


def test_simplify_at_the_command_line(tmp_path, capsys):
    path = tmp_path / "program.txt"
    path.write_text(TEXT + "if(x() < 9) right()\n" * 7)
    assert main(["simplify", "rocksample-7x8", f"program:{path}", "--out", str(tmp_path / "less.txt")]) == 0
    assert "return was 10.0000 and is 10.0000 (judged exactly)" in capsys.readouterr().out
    assert (tmp_path / "less.txt").read_text() == "right()\n" * 7
    assert main(["simplify", "rocksample-7x8", "belief"]) == 2
    assert "is no program; give program:FILE" in capsys.readouterr().err


def test_tiger_knows_no_better(rocksample):
    tiger = models.tiger()
    found = simplify(tiger, "a0()\na0()\na0()\n")
    assert (found.program.text, found.after) == ("a0()\n", -1.0)  # listening costs 1: less of it earns more
