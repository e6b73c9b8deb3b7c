"""Files are whole at any moment."""

from __future__ import annotations

import os

import pytest

from harness import HarnessError, files


def test_an_interrupt_after_the_rename_is_an_interrupt(tmp_path, monkeypatch):
    rename = os.replace

    def rename_and_stop(old, new):
        rename(old, new)
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", rename_and_stop)
    with pytest.raises(KeyboardInterrupt):
        files.replace_text(tmp_path / "file", "new")
    assert (tmp_path / "file").read_bytes() == b"new"


@pytest.mark.parametrize(
    ("error", "seen"), [(KeyboardInterrupt(), KeyboardInterrupt), (OSError(28, "full"), HarnessError)]
)
def test_a_write_that_fails_leaves_the_old_file(tmp_path, error, seen):
    path = tmp_path / "file"
    files.replace_text(path, "old")

    def write_half():
        with files.replacing(path) as file:
            file.write(b"ne")
            raise error

    with pytest.raises(seen):
        write_half()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(HarnessError, match=r"cannot write .*file/below/x"):
        files.replace_text(tmp_path / "file" / "below" / "x", "")
