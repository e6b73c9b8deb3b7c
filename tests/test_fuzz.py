"""A fixed small share of the hostile inputs of :mod:`tests.fuzz`."""

from __future__ import annotations

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
        assert "accepted" in results or kind == "damaged"


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
    assert fuzz._fault_of("x" * 400) == "a message of 400 characters"
    assert fuzz._fault_of("x") == ""
