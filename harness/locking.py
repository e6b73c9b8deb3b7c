"""One process at a time in a folder, or on a file: the second one is told who is there.

The lock is the operating system's, on a file beside what it guards. It ends with the process that holds it, however
that ends, so a lock file that a killed process left locks nobody out.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import os
import platform
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ParamSpec, TypeVar

from filelock import FileLock, Timeout

from harness import files
from harness.errors import HarnessError

WAIT = 3.0
"""Seconds to wait for a lock: workers of a process that was killed need a moment to end."""

LOCK = ".lock"
"""Name of the lock file in a folder."""

_P = ParamSpec("_P")
_T = TypeVar("_T")


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Work in a folder while no other process does; it is made where it is missing.

    What a killed process left half written there is removed. A folder that is still empty at the end goes again.

    Raises:
        HarnessError: another process (or thread) works there, or the folder cannot be made or locked.
    """
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HarnessError(f"cannot write {folder}: {error.strerror}") from None
    try:
        with _held(folder / LOCK, folder):
            files.clear(folder)
            yield
    finally:
        if new:
            with contextlib.suppress(OSError):  # not empty: the rule
                folder.rmdir()


@contextlib.contextmanager
def alone_on(path: Path) -> Iterator[None]:
    """Read and replace a file while no other process does.

    Raises:
        HarnessError: another process (or thread) does, or its folder cannot be written.
    """
    target = Path(os.path.realpath(files.named(path)))
    with _held(target.with_name(f".{target.name}.lock"), path):
        files.clear(target.parent, target.name)
        yield


def alone(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """The function, :func:`alone_in` the folder that its argument ``out`` names, if it names one."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def guarded(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        out = signature.bind(*args, **kwargs).arguments.get("out")
        with contextlib.nullcontext() if out is None else alone_in(files.named(out)):
            return function(*args, **kwargs)

    return guarded


@contextlib.contextmanager
def _held(lock: Path, what: Path) -> Iterator[None]:
    held = FileLock(lock, timeout=WAIT, fallback_to_soft=False)
    try:
        held.acquire()
        lock.write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
    except Timeout:
        raise HarnessError(f"{what} is in use by {_holder(lock)}; wait for its end, or name another") from None
    except OSError as error:
        held.release()
        raise HarnessError(f"cannot lock {what}: {error.strerror or error}") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # first, while it is held: who waits for it finds out and makes it anew
            lock.unlink()
        held.release()


def _holder(lock: Path) -> str:
    try:
        return lock.read_text(encoding="utf-8") or "another process"
    except (OSError, UnicodeDecodeError):
        return "another process"
