"""The domains that most tests use."""

from __future__ import annotations

import pytest

import harness


@pytest.fixture(scope="session")
def rocksample():
    return harness.load("rocksample-7x8")


@pytest.fixture(scope="session")
def bordercross():
    return harness.load("bordercross-7x8")


@pytest.fixture(scope="session")
def hidden():
    return harness.load("bordercross-7x8-random")
