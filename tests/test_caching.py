"""Compiled code on disk: never older than the sources, wherever these have changed. In processes of their own, on a
copy of the package."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from harness.model import caching

RUN = """
import numpy as np
from harness.model.tables import compiled
from harness.model import tables, splitmix
from harness.model.caching import folder

@compiled
def outer(state):
    return splitmix.next_uniform(state)

print(folder().name, splitmix.__file__.startswith({root!r}))
print(outer(np.array([1], dtype=np.uint64)), splitmix.next_uniform(np.array([1], dtype=np.uint64)))
"""


@pytest.fixture
def copy(tmp_path):
    """The package without data, and a module of a user's that inlines a verb of it."""
    shutil.copytree(
        caching.PACKAGE, tmp_path / "harness", ignore=shutil.ignore_patterns("__pycache__", "data"), symlinks=True
    )
    (tmp_path / "user.py").write_text(RUN.format(root=str(tmp_path)))
    return tmp_path


def run(copy, **environment):
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "user.py"],
        cwd=copy,
        env={**inherited, "PYTHONPATH": str(copy), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (folder, own), numbers = (line.split() for line in done.stdout.splitlines())
    assert own == "True"
    return folder, numbers


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_changed_verb_is_compiled_again_where_it_is_inlined(copy):
    first, before = run(copy)
    assert run(copy) == (first, before)
    assert before[0] == before[1]
    change(copy / "harness/model/splitmix.py", "* 2.0**-53", "* 2.0**-54")
    second, after = run(copy)
    assert second != first
    assert [2 * float(x) for x in after] == [float(x) for x in before]


def test_what_was_kept_is_found_again(copy):
    folder, _ = run(copy)
    kept = {path: path.stat().st_mtime_ns for path in copy.rglob("*.nb?")}
    assert kept
    assert all(folder in path.parts for path in kept)
    run(copy)
    assert {path: path.stat().st_mtime_ns for path in copy.rglob("*.nb?")} == kept


def test_a_class_that_moved_does_not_break_what_was_kept(copy):
    """An index that names the old module of a class cannot be read; it must not even be looked at."""
    user = (copy / "user.py").read_text()
    for old, new in (("record_old", "record_new"), ("record_new", "record_old")):
        (copy / f"harness/model/{old}.py").unlink(missing_ok=True)
        (copy / f"harness/model/{new}.py").write_text(
            "from typing import NamedTuple\n\nclass R(NamedTuple):\n    x: int\n"
        )
        verb = "\n\n@compiled\ndef take(r: R) -> int:\n    return r.x\n"
        source = (copy / "harness/model/splitmix.py").read_text().split("\n\nfrom harness.model.record")[0]
        source += f"\n\nfrom harness.model.{new} import R\nfrom harness.model.tables import compiled{verb}"
        (copy / "harness/model/splitmix.py").write_text(source)
        (copy / "user.py").write_text(user + f"from harness.model.{new} import R\nassert splitmix.take(R(3)) == 3\n")
        run(copy)


def test_a_constant_counts_and_a_command_does_not(copy):
    before = caching.digest(copy / "harness")
    change(copy / "harness/cli/__init__.py", "harness: interrupted", "harness: stopped")
    assert caching.digest(copy / "harness") == before
    change(copy / "harness/program/words.py", "BELOW, ABOVE, EQUAL = range(3)", "BELOW, ABOVE, EQUAL = 1, 0, 2")
    assert caching.digest(copy / "harness") != before


def test_numba_s_own_setting_and_the_users_functions_are_left_alone(copy, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    (copy / "user.py").write_text(
        (copy / "user.py").read_text() + f"import numba\nassert numba.config.CACHE_DIR == {str(elsewhere)!r}\n"
    )
    folder, _ = run(copy, NUMBA_CACHE_DIR=str(elsewhere))
    assert list((elsewhere / folder).rglob("*.nbi"))
    assert not list((copy / "harness").rglob("*.nbi"))


def test_a_package_that_nobody_may_write_to_uses_the_users_cache(copy, monkeypatch):
    def refuse(path, mode):
        return str(path).startswith(str(copy / "home"))

    monkeypatch.setattr(os, "access", refuse)
    monkeypatch.setattr(caching, "PACKAGE", copy / "harness")
    monkeypatch.setenv("XDG_CACHE_HOME", str(copy / "home"))
    found = caching.folder.__wrapped__()
    assert found is not None
    assert found.parent == copy / "home" / "pomdp-harness"
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert caching.folder.__wrapped__() is None


def test_few_old_folders_are_kept(tmp_path):
    for n in range(9):
        (tmp_path / f"harness-{n}").mkdir()
        os.utime(tmp_path / f"harness-{n}", (n, n))
    caching._forget_old(tmp_path, tmp_path / "harness-0")
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"harness-{n}" for n in (0, 5, 6, 7, 8)]
