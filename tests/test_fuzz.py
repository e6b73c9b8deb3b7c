"""A fixed small share of the hostile inputs of :mod:`tests.fuzz`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import fuzz
from tests.conftest import size

COUNT = size(400, 800)


def test_hostile_inputs_are_accepted_or_refused():
    tried = list(fuzz.outcomes(seed=0, first=0, last=COUNT))
    assert [outcome for outcome in tried if outcome.failed] == []
    assert [outcome.number for outcome in tried] == list(range(COUNT))
    for kind in fuzz.CASES:  # some of each are good, or only the door is tested; most are not
        results = [outcome.result for outcome in tried if outcome.kind == kind]
        assert results.count("refused") > len(results) / 5
        assert "accepted" in results or kind in ("damaged", "command_line")


def test_a_worker_that_dies_hangs_or_fails_is_told(monkeypatch):
    """One script after another in place of the worker: what it prints is believed, where it stops is a failure."""
    scripts = iter(
        ["print('ready\\n0 accepted\\n1 refused', flush=True); import os; os.abort()", "print('3 ValueError: x')"]
    )
    original = fuzz.subprocess.Popen

    def start(command, **options):
        return original([command[0], "-c", next(scripts)], **options)

    monkeypatch.setattr(fuzz.subprocess, "Popen", start)
    tried = list(fuzz.outcomes(seed=0, first=0, last=4))
    assert [outcome.result for outcome in tried] == ["accepted", "refused", "the worker died or hung", "ValueError: x"]
    assert [outcome.failed for outcome in tried] == [False, False, True, True]


def test_a_bad_message_is_a_failure():
    assert fuzz._fault_of("x\x1b[31m") == "an unprintable message"
    assert fuzz._fault_of("x" * 300) == "a message of 300 characters"
    assert fuzz._fault_of("") == "a message of 0 characters"
    assert fuzz._fault_of("It is so. It is not") == "more than a sentence: It is so. It is not"
    assert fuzz._fault_of("no 'So. It' is known") == ""
    assert fuzz._fault_of("it is " + "a" * 61, ["a" * 70]).startswith("it repeats more than 60 characters")
    assert fuzz._fault_of("it is " + "\\n" * 31, ["\n" * 40]).startswith("it repeats more than 60 characters")
    assert fuzz._fault_of("it is " + "a" * 60, ["a" * 70]) == ""


@pytest.mark.parametrize(
    ("event", "arguments", "told"),
    [
        ("open", ("/etc/passwd", "r", 0), True),
        ("open", ("/etc/hosts", "r", 0), False),
        ("subprocess.Popen", ("julia", ["julia"], None, None), True),
        ("subprocess.Popen", ("git", ["git", "rev-parse"], None, None), False),
        ("os.system", (b"ls",), True),
    ],
)
def test_what_data_must_not_lead_to(monkeypatch, event, arguments, told):
    def case(rng, folder):
        fuzz.listen(event, arguments)

    monkeypatch.setitem(fuzz.CASES, "snapshot", case)
    assert fuzz.ORDER[0] == "snapshot"
    assert fuzz.attempt(0, 0, Path()).startswith("data made it reach") == told
