"""Snapshot and policy files: what is written is read; what is damaged, foreign or stale is refused in one sentence."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import pickle
import shutil
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import harness
from harness import registry
from harness.model import archive, domain
from harness.solver import solution as solutions
from tests.conftest import size

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


KINDS = ["rocksample-7x8", "rocksample-4x4@zmdp", "bordercross-7x8-random", "tag", "hallway", "heaven-hell"]
"""One domain of each kind, for when there is little time."""


@pytest.mark.parametrize("name", size(KINDS, registry.names()))
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


def resealed(path, change):
    """A file whose record and arrays ``change`` edits, under a hash that is right again: hostile, not damaged."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    record = json.loads(str(arrays.pop("record")))
    change(record, arrays)
    record.pop("content_hash")
    record["content_hash"] = archive.digest(arrays, record)
    return {"record": np.array(json.dumps(record)), **arrays}


def reseal(domain_name, tmp_path, change, policy=""):
    source = registry.policy_path(domain_name, policy) if policy else registry.snapshot_path(domain_name)
    np.savez(tmp_path / "hostile.npz", **resealed(source, change))
    return tmp_path / "hostile.npz"


def put(name, place, value):
    def change(_record, arrays):
        arrays[name][place] = value

    return change


HOSTILE = [  # what crashed, hung or lied before snapshots were checked
    ("start_visible", 0, 5000, r"start_visible\[0\] is 5000, which leaves the range 0 … 49"),
    ("outcome_observation", 17, 53, r"outcome_observation\[17\] is 53, which leaves the range 0 … 52"),
    ("outcome_observation", 17, -1, r"outcome_observation\[17\] is -1"),
    ("outcome_visible", 3, -5, r"outcome_visible\[3\] is -5"),
    ("outcome_value", 3, 2, r"outcome_value\[3\] is 2, which leaves the range 0 … 0"),
    ("first_row", 3, 1037, r"first_row\[3\] is 1037, which points outside the rows"),
    ("first_row", 649, 0, "a terminal visible value has rows"),
    ("row_outcomes", 9, 2**30, r"row 9 has no outcome"),
    ("row_outcomes", 0, -(2**30), r"row_outcomes runs from -1073741824"),
    ("prior_factor", 0, 8, r"prior_factor\[0\] is 8, which leaves the range -1 … 7"),
    ("factor", 3, 300, r"factor\[3\] is 300"),
    ("start_values", (5, 1), 2, r"start_values\[5, 1\] is 2, which leaves the range 0 … 1"),
    ("prior_visible", 0, 1, r"start_visible\[0\] is not in prior_visible"),
    ("prior_observation", (0, 1), 999, r"prior_observation\[0, 1\] is 999"),
    ("prior_marginals", (0, 1), np.nan, r"prior_marginals\[0, 1\] is negative|rock 1"),
    ("outcome_probability", 4, 0.5, "the outcomes of row 4 do not sum to 1"),
    ("outcome_probability", 4, np.nan, r"outcome_probability\[4\] is not above 0"),
    ("outcome_cdf", 4, 0.5, r"outcome_cdf\[4\] is not the running sum"),
    ("outcome_cdf", 4, np.nan, r"outcome_cdf\[4\] is not the running sum"),
    ("observation_probability", (2, 1), -0.1, r"observation_probability\[2, 1\] is negative"),
    ("observation_cdf", (2, 1), 0.01, r"observation_cdf\[2, 1\] is not the running sum"),
    ("start_cdf", 7, 0.9, r"start_cdf\[8\] does not rise to 1"),
    ("start_cdf", -1, 1.5, "start_cdf does not rise to 1 but to 1.5"),
    ("outcome_reward", (0, 8), np.inf, r"outcome_reward\[0, 8\] is not a finite number"),
    ("legal", slice(None), False, "no action is legal at visible value 0"),
]


@pytest.mark.parametrize(("name", "place", "value", "words"), HOSTILE)
def test_a_snapshot_with_a_valid_hash_and_bad_contents_is_refused(tmp_path, name, place, value, words):
    path = reseal("rocksample-7x8", tmp_path, put(name, place, value))
    with pytest.raises(harness.SnapshotError, match=rf"hostile\.npz: .*{words}.*; export it again"):
        harness.load(path)


@pytest.mark.parametrize("name", sorted(domain.ARRAYS))
@pytest.mark.parametrize("change", ["missing", "shape", "type"])
def test_missing_arrays_wrong_shapes_and_types_are_refused(tmp_path, name, change):
    def edit(_record, arrays):
        array = arrays.pop(name)
        if change == "shape":
            arrays[name] = array[..., None]
        elif change == "type":
            arrays[name] = array.astype(np.int64)

    with pytest.raises(harness.SnapshotError, match=rf"hostile\.npz: .*{name} .*{change}"):
        harness.load(reseal("bordercross-7x8-random", tmp_path, edit))


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("actions", "up()"),
        ("actions", ["up()"] * 13),
        ("observations", ["none", "good", "b\x1b[31m"]),
        ("observations", ["none", "good", "b" * 1000]),
        ("factor_labels", [[]] * 8),
        ("features", [["belief(1)", 8, 0]]),
        ("features", [["belief(1)", 0, 2]]),
        ("features", [["belief(1)", -1, 0]]),
        ("shapings", ["paper"]),
        ("discount", "0.9"),
        ("discount", 1.5),
        ("discount", 10**400),
        ("discount", float("nan")),
        ("version", None),
        ("states", 10**4000),
        ("layout", {"kind": "rocksample"}),
        ("layout", {}),
        ("provenance", []),
        ("title", "a\nb"),
    ],
)
def test_names_and_numbers_of_a_snapshot_are_checked(tmp_path, entry, value):
    path = reseal("rocksample-7x8", tmp_path, lambda record, _: record.update({entry: value}))
    with pytest.raises(harness.SnapshotError) as error:
        harness.load(path)
    assert str(error.value).isprintable()
    assert len(str(error.value)) < 300


def test_more_rocks_than_checks_are_refused(tmp_path):
    """A heuristic would read beliefs that are not there."""
    path = reseal("rocksample-7x8", tmp_path, lambda record, _: record["layout"]["rocks"].append([1, 1]))
    with pytest.raises(harness.SnapshotError, match="one check for every rock"):
        harness.load(path)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("actions", 13, r"actions\[5\] is 13, which leaves the range 0 … 12"),
        ("visible", -1, r"visible\[5\] is -1"),
        ("values", np.nan, r"values\[5, 0\] is not a finite number"),
    ],
)
def test_alpha_vectors_are_checked(rocksample, tmp_path, name, value, words):
    place = (5, 0) if name == "values" else 5
    path = reseal("rocksample-7x8", tmp_path, put(name, place, value), policy="qmdp")
    with pytest.raises(harness.SnapshotError, match=words):
        solutions.read(path, rocksample)


def test_a_legal_action_that_hangs_on_something_hidden_is_enough(hidden):
    """Two actions, each legal for one half of what a factor may be: every state has one; with a gap, one has none."""
    from harness.model import validation

    def legal_at_start(gap):
        legal = hidden.arrays["legal"].copy()
        for a in range(hidden.n_actions):
            row = hidden.arrays["first_row"][a]
            legal[row : row + 42] = (np.arange(42) < 21 - gap) if a == 4 else (np.arange(42) >= 21) if a == 5 else False
        return replace(hidden, arrays={**hidden.arrays, "legal": legal})

    assert (hidden.arrays["factor"][:9] == 0).all()
    assert list(validation.breaches(legal_at_start(0))) == []
    assert list(validation.breaches(legal_at_start(1))) == [
        "no action is legal at visible value 0, or none for some hidden value"
    ]


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "LARGEST", 2**24)
    path = tmp_path / "bomb.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**22,)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("a.npy", "w", force_zip64=True) as member:
        member.write(header.getvalue() + bytes(2**25))
    assert path.stat().st_size < 2**16
    tracemalloc.start()
    with pytest.raises(harness.SnapshotError, match=r"bomb\.npz: 1 arrays of 33,554,560 bytes are too much"):
        harness.load(path)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()


def test_a_header_that_asks_for_more_than_there_is_takes_no_memory(tmp_path):
    path = tmp_path / "greedy.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**40,)})
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("a.npy", header.getvalue() + bytes(80))
    with pytest.raises(harness.SnapshotError, match="not a readable domain file"):
        harness.load(path)


def test_arrays_come_back_as_they_were_written(tmp_path):
    arrays = {
        "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "empty": np.zeros((3, 0), dtype=np.int16),
        "flags": np.array([True, False]),
    }
    archive.write(tmp_path / "a.npz", "domain", {}, arrays)
    _, back = archive.read(tmp_path / "a.npz", "domain")
    for name, array in arrays.items():
        assert np.array_equal(back[name], array)
        assert back[name].dtype == array.dtype
        assert back[name].flags.writeable


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
