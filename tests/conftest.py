"""The domains that most tests use."""

from __future__ import annotations

import signal

import pytest

import harness

if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):  # as in a shell's background job, whose children would ignore it too
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def rocksample():
    return harness.load("rocksample-7x8")


@pytest.fixture(scope="session")
def bordercross():
    return harness.load("bordercross-7x8")


@pytest.fixture(scope="session")
def hidden():
    return harness.load("bordercross-7x8-random")
