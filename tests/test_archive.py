"""Snapshot and policy files: what is written is read; what is damaged, foreign or stale is refused in one sentence."""

from __future__ import annotations

import copy
import hashlib
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import harness
from harness import registry
from harness.model import archive, domain
from harness.solver import solution as solutions

SOURCES = Path(__file__).parent.parent / "julia" / "src"


def test_a_snapshot_survives_the_round_trip(rocksample, tmp_path):
    domain.save(rocksample, tmp_path / "copy.npz")
    copy = harness.load(tmp_path / "copy.npz")
    assert copy.model_hash == rocksample.model_hash
    assert domain.to_record(copy) == domain.to_record(rocksample)


@pytest.mark.parametrize("keep", [0, 10, 1000, -1])
def test_a_truncated_snapshot_is_refused(tmp_path, keep):
    whole = registry.snapshot_path("rocksample-7x8").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[:keep])
    with pytest.raises(harness.SnapshotError, match=r"cut\.npz: not a readable domain file"):
        harness.load(tmp_path / "cut.npz")


def test_foreign_files_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.arange(3))
    with pytest.raises(harness.SnapshotError, match="not a readable domain file"):
        harness.load(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(harness.SnapshotError, match="not a readable domain file"):
        harness.load(tmp_path / "text.npz")
    shutil.copy(registry.policy_path("rocksample-7x8", "qmdp"), tmp_path / "policy.npz")
    with pytest.raises(harness.SnapshotError, match="kind 'alpha-vectors', a 'domain' is needed"):
        harness.load(tmp_path / "policy.npz")
    with pytest.raises(harness.SnapshotError, match="no such file"):
        harness.load(tmp_path / "none.npz")


def test_a_snapshot_changed_by_hand_is_refused(tmp_path):
    path = tmp_path / "edited.npz"
    with np.load(registry.snapshot_path("rocksample-7x8")) as stored:
        arrays = {name: stored[name] for name in stored.files}
    arrays["outcome_reward"] = arrays["outcome_reward"] * 2
    np.savez(path, **arrays)
    with pytest.raises(harness.SnapshotError, match="changed by hand"):
        harness.load(path)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file.npz"
    archive.write(path, "domain", {"a": 1}, {"x": np.arange(3)})
    before = path.read_bytes()

    def fail(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(KeyboardInterrupt):
        archive.write(path, "domain", {"a": 2}, {"x": np.arange(4)})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["file.npz"]


def test_a_policy_of_another_model_is_refused(rocksample, bordercross):
    path = registry.policy_path("rocksample-7x8", "qmdp")
    with pytest.raises(harness.SnapshotError, match=r"solved for another model \(rocksample-7x8 version 1"):
        solutions.read(path, bordercross)
    arrays = {**rocksample.arrays, "outcome_reward": rocksample.arrays["outcome_reward"] + 1}
    with pytest.raises(harness.SnapshotError, match="solve it again"):
        solutions.read(path, replace(rocksample, arrays=arrays))


@pytest.mark.parametrize("name", registry.names())
def test_snapshots_are_of_the_julia_sources_as_they_are_now(name):
    """Fails when a Julia source that defines the domain has changed since the export (mend: `harness export`)."""
    provenance = harness.load(name).provenance
    total = hashlib.sha256()
    for source in provenance["sources"]:
        total.update(f"{source}\n".encode())
        total.update((SOURCES / source).read_bytes())
    assert total.hexdigest() == provenance["source_hash"], f"{name}: stale snapshot; run `harness export {name}`"
    assert {"julia", "POMDPs", "POMDPTools"} <= set(provenance["versions"])


@pytest.mark.parametrize("name", registry.names())
def test_every_domain_conforms(name):
    harness.check_domain(name, engine="tables")


@pytest.mark.parametrize(
    ("array", "change", "words"),
    [
        ("outcome_probability", lambda a: a * 0.9, "do not sum to 1"),
        ("observation_probability", lambda a: a[:, ::-1].copy(), "running sum"),
        ("outcome_visible", lambda a: a + 1000, "leaves the range"),
        ("terminal", lambda a: ~a, "terminal visible value has rows|points outside"),
        ("legal", lambda a: a & False, "no action is legal"),
        ("start_cdf", lambda a: a * 0.5, "does not rise to 1"),
        ("outcome_reward", lambda a: a * np.nan, "not a finite number"),
    ],
)
def test_the_conformance_check_can_fail(rocksample, array, change, words):
    broken = replace(rocksample, arrays={**rocksample.arrays, array: change(rocksample.arrays[array])})
    with pytest.raises(harness.ConformanceError, match=words):
        harness.check_domain(broken, engine="tables")


def test_the_conformance_check_sees_an_engine_that_cheats(rocksample, monkeypatch):
    from harness.engine.tables import TablesEngine

    honest = TablesEngine.step

    def swapped(self, actions, u):  # good and bad readings exchanged: the belief no longer predicts them
        rewards = honest(self, actions, u)
        self.observation[:] = np.where(self.observation > 0, 3 - self.observation, self.observation)
        return rewards

    monkeypatch.setattr(TablesEngine, "step", swapped)
    with pytest.raises(harness.ConformanceError, match=r"as often as|impossible"):
        harness.check_domain(rocksample, engine="tables", episodes=2000)


def test_unknown_shapings_and_actions_are_explained(bordercross, rocksample):
    with pytest.raises(harness.HarnessError, match="did you mean 'potential'"):
        bordercross.shaped("potental")
    with pytest.raises(harness.HarnessError, match=r"did you mean 'check\(1\)'"):
        rocksample.action("chek(1)")


def test_shapings_change_the_reward_and_nothing_else(bordercross):
    paper = bordercross.shaped("paper")
    assert paper.model_hash == bordercross.model_hash
    assert np.array_equal(paper.tables.outcomes["visible"], bordercross.tables.outcomes["visible"])
    bonus = paper.tables.outcomes["reward"] - bordercross.tables.outcomes["reward"]
    assert set(bonus) == {0.0, 1.0, 2.0}


def test_an_unpickled_domain_equals_the_original(rocksample, bordercross, tmp_path):
    again = pickle.loads(pickle.dumps(rocksample))
    assert again is not rocksample
    assert again == rocksample
    assert hash(again) == hash(rocksample)
    assert harness.evaluate(again, "belief", episodes=20, engine="tables").returns.tolist() == (
        harness.evaluate(rocksample, "belief", episodes=20, engine="tables").returns.tolist()
    )
    domain.save(rocksample, tmp_path / "again.npz")
    assert domain.read(tmp_path / "again.npz") == rocksample
    assert rocksample != bordercross
    assert rocksample != rocksample.name
    assert bordercross.shaped("potential") != bordercross
    assert replace(rocksample, version=rocksample.version + 1) != rocksample
    changed = {**rocksample.arrays, "outcome_reward": rocksample.arrays["outcome_reward"] + 1}
    assert replace(rocksample, arrays=changed) != rocksample


def test_a_pickled_domain_leaves_live_julia_behind(rocksample):
    live = replace(rocksample, live=lambda: "no pickle takes this")
    assert pickle.loads(pickle.dumps(live)).live is None
    assert copy.deepcopy([live])[0] is live
