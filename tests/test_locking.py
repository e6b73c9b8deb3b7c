"""One process at a time in a folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

import harness
from harness import HarnessError, locking
from harness.cli import main

HOLD = """
import sys, time
from pathlib import Path
from harness import locking
with locking.alone_in(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(locking, "WAIT", 0.2)


@pytest.fixture
def holder(tmp_path):
    """A process that works in a folder."""
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_the_second_one_is_told_who_is_there(tmp_path, holder):
    with pytest.raises(HarnessError, match=f"is in use by process {holder.pid} on "), locking.alone_in(tmp_path):
        pass


def test_a_lock_ends_with_its_process(tmp_path, holder):
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert (tmp_path / ".lock").exists()
    (tmp_path / ".history.csv.abc.part").write_text("half")
    (tmp_path / "film.part").write_text("somebody's own")
    with locking.alone_in(tmp_path):
        assert (tmp_path / ".lock").read_text().startswith(f"process {os.getpid()} on ")
    assert [path.name for path in tmp_path.iterdir()] == ["film.part"]


def test_threads_of_one_process_too(tmp_path):
    with locking.alone_in(tmp_path), pytest.raises(HarnessError, match="in use"), locking.alone_in(tmp_path):
        pass


def test_only_an_empty_folder_that_was_made_goes_again(tmp_path):
    (tmp_path / "old").mkdir()
    for name, kept in (("old", True), ("new", False)):
        with locking.alone_in(tmp_path / name):
            pass
        assert (tmp_path / name).exists() == kept


def test_waiting_threads_take_turns(tmp_path, monkeypatch):
    """The file goes with every release: who waits on the old one must not come in beside who has a new one."""
    monkeypatch.setattr(locking, "WAIT", 30)
    inside, together = [], []

    def work():
        for _ in range(5):
            with locking.alone_on(tmp_path / "file"):
                inside.append(1)
                together.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == [1] * 20


def test_every_command_that_works_in_a_folder_is_alone(tmp_path, holder, capsys):
    folder = str(tmp_path)
    for words in (
        ["evolve", "rocksample-7x8", "--out", folder],
        ["evolve", "--resume", folder],
        ["tune", "rocksample-7x8", "--policy", "belief", "--out", folder],
        ["reproduce", "--quick", "--out", folder],
    ):
        assert main(words) == 2
        error = capsys.readouterr().err
        assert f"is in use by process {holder.pid}" in error
        assert error.count("\n") == 1


def test_an_update_is_alone_on_its_file(tmp_path, capsys):
    with locking.alone_on(tmp_path / "scores.toml"):
        assert main(["check", str(tmp_path / "scores.toml"), "--update"]) == 2
    assert "scores.toml is in use by process" in capsys.readouterr().err


def test_a_run_of_many_is_alone_in_its_own_folder(tmp_path):
    small = {"population": 5, "generations": 1, "episodes": 5, "max_init_depth": 15, "score_episodes": 5}
    harness.evolve("rocksample-7x8", runs=2, out=tmp_path, workers=1, **small)
    with locking.alone_in(tmp_path / "seed-1"), pytest.raises(HarnessError, match=r"seed-1 is in use"):
        harness.resume(tmp_path, workers=1)


def test_a_worker_ends_with_its_parent():
    """A child of a killed process, which would sleep on; it says when it ends by closing its output."""
    child = (
        "import os, sys, time; from harness import host; host.end_with(int(sys.argv[1])); print('up', flush=True); "
        "time.sleep(600)"
    )
    middle = "import os, subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1], str(os.getpid())])"
    with subprocess.Popen([sys.executable, "-c", middle, child], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"up\n"
        process.kill()
        assert process.stdout.read() == b""  # the end of the file: nobody has it open any more
