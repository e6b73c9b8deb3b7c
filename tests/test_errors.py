"""What messages echo of the user's text is short, printable and on one line."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

import harness
from harness.errors import HarnessError, nearest, quoted, sentence


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("sarsop", "'sarsop'"),
        ("γ ≥ 0.5 …", "'γ ≥ 0.5 …'"),
        ("two\nlines\tand\r", r"'two\nlines\tand\r'"),
        ("\x1b[31mred", r"'\x1b[31mred'"),
        ("\u202eright to left", r"'\u202eright to left'"),
        ("\udc80", r"'\udc80'"),
        (Path("folder/file"), "'folder/file'"),
        (Path("x" * 70 + "/\n/file.jl"), f"'… {'x' * 47}/\\n/file.jl'"),
        (0.25, "0.25"),
        ([1, "a"], "[1, 'a']"),
        ("x" * 60, f"'{'x' * 60}'"),
        ("x" * 61, f"'{'x' * 58} …'"),
    ],
)
def test_quoted(text, shown):
    assert quoted(text) == shown


def test_a_number_that_python_does_not_spell_is_quoted_too():
    assert quoted(10**5000) == "a huge int"


@pytest.mark.parametrize("text", ["a" * 10**6, "\n" * 10**6, "\U0001f600\x00" * 500])
def test_what_is_quoted_is_short(text):
    assert len(quoted(text)) <= 62
    assert quoted(text).isprintable()


def test_every_message_is_one_short_sentence_that_keeps_its_end():
    error = HarnessError(f"no {'x' * 5000}\nhere; say --mend")
    assert len(str(error)) < 300
    assert str(error).isprintable()
    assert str(error).startswith("no xxx")
    assert str(error).endswith(r"x\nhere; say --mend")
    assert sentence("as it is") == "as it is"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_the_nearest_word_of_a_long_text_takes_no_time():
    assert nearest("belif", ["belief", "exit"]) == "; did you mean 'belief'?"
    assert nearest("x" * 10**6, ["belief", "exit"]) == ""


_LONG = "belief\n\x1b[31m" * 1000


@pytest.mark.parametrize(
    "act",
    [
        lambda: harness.load(_LONG),
        lambda: harness.evaluate("rocksample-7x8", _LONG),
        lambda: harness.evaluate("rocksample-7x8", f"belief:{_LONG}"),
        lambda: harness.evaluate("rocksample-7x8", f"exit:{_LONG}"),
        lambda: harness.evaluate("rocksample-7x8", f"thresholds:{_LONG}"),
        lambda: harness.evaluate("rocksample-7x8", f"thresholds:accept={_LONG}"),
        lambda: harness.evaluate("rocksample-7x8", f"rollout:{_LONG}"),
        lambda: harness.evaluate("rocksample-7x8", "exit", engine=_LONG),
        lambda: harness.tune("rocksample-7x8", "belief", method=_LONG),
        lambda: harness.tune("rocksample-7x8", "belief", measure=_LONG),
        lambda: harness.tune("rocksample-7x8", _LONG),
        lambda: harness.sweep("rocksample-7x8", "belief", parameter=_LONG),
        lambda: harness.load("rocksample-7x8").action(_LONG),
        lambda: harness.load("rocksample-7x8").shaped(_LONG),
        lambda: harness.evolve("rocksample-7x8", _LONG, out="nowhere"),
        lambda: harness.evolve("rocksample-7x8", out="nowhere", initialisation=_LONG),
    ],
)
def test_refusals_quote_little(act):
    with pytest.raises(HarnessError) as refusal:
        act()
    message = str(refusal.value)
    assert message.isprintable()
    assert len(message) < 300
    assert message.count("belief\\n\\x1b[31m") <= 4  # 60 characters hold no more
    assert " … " not in message.replace(" …'", "'")  # what was cut is the quote, not the sentence
