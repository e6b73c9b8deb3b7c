"""The state of solving as a file: going on from it is as if the work had never ended."""

from __future__ import annotations

import itertools
import signal

import numpy as np
import pytest

import harness
from harness.model import archive
from harness.solver import anytime, checkpoint
from harness.solver.points import course as points
from tests import models

MEMORY = 10**9


def bounds_over(course, module, blocks):
    latest, seen = course, []
    for latest in itertools.islice(module.blocks(course, 1e-3, MEMORY), blocks):
        seen.append((latest.lower, latest.upper, latest.memory))
    return seen, latest


@pytest.mark.parametrize(
    ("name", "module", "before"),
    [
        ("rocksample-7x8", anytime, 2),
        ("rocksample-7x8", anytime, 7),
        ("rocksample-11x11", anytime, 5),
        ("bordercross-7x8-random", points, 1),
    ],
)
def test_it_goes_on_as_if_it_had_never_ended(tmp_path, name, module, before):
    domain, path = harness.load(name), tmp_path / "state"
    whole, _ = bounds_over(module.begin(domain), module, before + 3)
    first, course = bounds_over(module.begin(domain), module, before)
    checkpoint.save(path, course, [{"seconds": 1.5}])
    resumed, history = checkpoint.restore(path, module.begin(domain))
    rest, _ = bounds_over(resumed, module, 3)
    assert history == [{"seconds": 1.5}]
    assert first + rest == whole


def test_solve_writes_it_and_takes_the_history_up_again(tmp_path):
    path = tmp_path / "state"
    domain = models.rocksample(4, [(2, 1), (2, 3), (3, 3), (0, 1)], (0, 1))
    first = harness.solve(domain, gap=5.0, resume=path)
    second = harness.solve(domain, gap=0.01, resume=str(path))
    assert first.history["lower"].tolist() == second.history["lower"].tolist()[: len(first.history)]
    assert (np.diff(second.history["seconds"]) >= 0).all()
    assert second.gap <= 0.01
    assert second.lower <= harness.solve(domain, gap=0.01).upper


def damaged(path, tmp_path, change):
    record, arrays = archive.read(path, checkpoint.KIND)
    change(record, arrays)
    other = tmp_path / "other"
    archive.write(other, checkpoint.KIND, {k: v for k, v in record.items() if k not in ("kind", "format")}, arrays)
    return other


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record, arrays: record.update(model_hash="0"), "state of solving another model than tiger"),
        (lambda record, arrays: record.update(numbers=[]), "no state that this version"),
        (lambda record, arrays: record["numbers"].update(stage="x"), "no state that this version"),
        (lambda record, arrays: record["numbers"].pop("stage"), "no state that this version"),
        (lambda record, arrays: arrays.pop("graph.lower"), "no state that this version"),
        (lambda record, arrays: arrays.update({"graph.lower": np.zeros((2, 2))}), "no state that this version"),
        (lambda record, arrays: arrays.update({"graph.more": np.zeros(2)}), "no state that this version"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(tmp_path, change, message):
    domain, path = models.tiger(), tmp_path / "state"
    harness.solve(domain, gap=1.0, resume=path)
    other = damaged(path, tmp_path, change)
    before = other.read_bytes()
    with pytest.raises(harness.HarnessError, match=message) as refused:
        harness.solve(domain, gap=1.0, resume=other)
    assert str(other) in str(refused.value)
    assert other.read_bytes() == before


def test_bytes_that_were_changed_are_noticed(tmp_path):
    path = tmp_path / "state"
    harness.solve(models.tiger(), gap=1.0, resume=path)
    spoilt = bytearray(path.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    path.write_bytes(spoilt)
    with pytest.raises(harness.HarnessError, match="state"):
        harness.solve(models.tiger(), gap=1.0, resume=path)


def test_the_first_ctrl_c_ends_it_with_what_there_is(tmp_path):
    def watch(seconds, lower, upper):
        signal.raise_signal(signal.SIGINT)

    solved = harness.solve("rocksample-7x8", gap=1e-6, resume=tmp_path / "state", watch=watch)
    assert solved.stopped == "by Ctrl-C"
    assert len(solved.history) == 2  # the block, and the end
    course, history = checkpoint.restore(tmp_path / "state", anytime.begin(harness.load("rocksample-7x8")))
    assert (course.lower, course.upper) == (solved.lower, solved.upper)
    assert len(history) == 2
