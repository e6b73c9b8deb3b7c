"""Files are whole at any moment."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

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


def test_a_symbolic_link_and_a_mode_stay(tmp_path):
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to("file")
    files.replace_text(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("path", ["/dev/null", "."])
def test_what_is_no_file_is_not_replaced(path):
    with pytest.raises(HarnessError, match="there is a folder or a device of that name"):
        files.replace_text(Path(path), "")
    assert Path("/dev/null").is_char_device()


def test_what_is_renamed_is_on_the_disk_already(tmp_path, monkeypatch):
    """In the order of the calls; the folder's entry follows."""
    calls = []
    for name in ("fsync", "replace"):
        function = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *a, name=name, function=function: (calls.append(name), function(*a)))
    files.replace_text(tmp_path / "file", "new")
    assert calls == ["fsync", "replace", "fsync"]


@pytest.mark.parametrize("name", ["mkstemp", "fsync", "replace", "chmod"])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_a_failing_disk_is_one_sentence(tmp_path, monkeypatch, name, number):
    def fail(*arguments, **options):
        raise OSError(number, os.strerror(number))

    path = tmp_path / "file"
    path.write_text("old")
    monkeypatch.setattr(tempfile if name == "mkstemp" else os, name, fail)
    with pytest.raises(HarnessError, match=f"^cannot write {path}: {os.strerror(number)}$"):
        files.replace_text(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file"),
        (b"{", "not JSON"),
        (b"\xff", "not UTF-8 text"),
        (b"[" * 100_000, "not JSON"),
        (b"9" * 5_000, "not JSON"),
    ],
)
def test_a_damaged_json_file_is_one_sentence(tmp_path, content, reason):
    path = tmp_path / "file.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(HarnessError, match=rf"^{path} cannot be read \({reason}.*\); mend it$"):
        files.read_json(path, "mend it")


def test_half_a_character_is_written_as_an_escape(tmp_path):
    files.replace_text(tmp_path / "x", "a\ud800γ")
    assert (tmp_path / "x").read_text(encoding="utf-8") == "a\\ud800γ"
