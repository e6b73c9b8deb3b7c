"""Fixtures, and the one line that says why the Julia tests are skipped where there is no Julia."""

from __future__ import annotations

import pytest

import harness
from harness import bridge


def pytest_collection_modifyitems(items):
    if bridge.is_set_up():
        return
    skip = pytest.mark.skip(reason="no Julia is set up for the harness (see `harness julia`)")
    for item in items:
        if "julia" in item.keywords:
            item.add_marker(skip)


@pytest.fixture(scope="session")
def rocksample():
    return harness.load("rocksample-7x8")


@pytest.fixture(scope="session")
def bordercross():
    return harness.load("bordercross-7x8")


@pytest.fixture(scope="session")
def hidden():
    return harness.load("bordercross-7x8-random")
