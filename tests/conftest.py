"""The size of the tests, and the domains that most of them use."""

from __future__ import annotations

import os
import signal
from typing import TypeVar

import pytest

import harness

FULL = os.environ.get("HARNESS_TESTS") == "full"
"""Whether the slow tests take their full size: `make test-full`."""

_T = TypeVar("_T")


def size(small: _T, full: _T) -> _T:
    """The size of a slow test, here and now; a small one must still be able to fail."""
    return full if FULL else small


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


@pytest.fixture(scope="session")
def report_inputs(tmp_path_factory):
    """One of each kind that a report can be of, small: by name, the path."""
    folder = tmp_path_factory.mktemp("report-inputs")
    search = {
        "population": 10,
        "generations": 3,
        "episodes": 10,
        "max_init_depth": 15,
        "grammar": "rocksample-feedback",
    }
    search |= {"test_episodes": 50, "validation_episodes": 50, "score_episodes": 50, "engine": "tables"}
    harness.evolve("rocksample-7x8", out=folder / "run", **search)
    harness.evolve("rocksample-7x8", out=folder / "runs", runs=2, workers=1, **search)
    harness.tune("rocksample-7x8", "belief:0.92", episodes=50, iterations=3, final_episodes=50, out=folder / "tuning")
    sweep = harness.sweep("rocksample-7x8", "belief", points=11, episodes=50, engine="tables")
    (folder / "sweep").mkdir()
    sweep.to_csv(folder / "sweep" / "sweep.csv", index=False)
    for name, domain, policies in (
        ("rocks", "rocksample-7x8", ["belief:0.84", "sarsop", "exit", "mdp"]),
        ("border", "bordercross-7x8", ["sarsop", "random"]),
        ("hidden", "bordercross-7x8-random", ["sarsop", "random"]),
    ):
        table = harness.compare(domain, policies, episodes=20, seed=4, engine="tables")
        (folder / f"{name}.csv").write_text(harness.render(table, "csv"), encoding="utf-8")
        (folder / f"{name}.json").write_text(harness.render(table, "json"), encoding="utf-8")
    names = (
        "run",
        "runs",
        "tuning",
        "sweep",
        *(f"{t}.{e}" for t in ("rocks", "border", "hidden") for e in ("csv", "json")),
    )
    return {name: folder / name for name in names}
