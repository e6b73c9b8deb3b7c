"""What runs here: the machine's cores and memory, versions of what is installed, a checkout's revision, the parent."""

from __future__ import annotations

import contextlib
import math
import os
import platform
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from harness.errors import HarnessError, check_whole


def cores() -> int:
    """Number of processor cores, 1 where nobody knows."""
    return os.cpu_count() or 1


MOST_WORKERS = 1024
"""Threads or processes at most."""


def workers(given: int | None) -> int:
    """How many threads or processes: as many as were asked for, else one a core.

    Raises:
        HarnessError: it is no number of them.
    """
    if given is None:
        return cores()
    check_whole("workers", given, 1, MOST_WORKERS)
    return given


@contextlib.contextmanager
def ctrl_c_sets(event: threading.Event) -> Iterator[None]:
    """Within, the first Ctrl-C sets the event, and only the second one interrupts; this holds in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        event.set()
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_FIRST = 100_000_000  # bytes that everybody has: nothing is looked up for less


def check_memory(what: str, needed: float) -> None:
    """Check that there is room for so many bytes, before they are taken.

    Raises:
        HarnessError: there is not; the message says how much ``what`` would take.
    """
    if needed > _FIRST and needed > (free := free_memory()):
        raise HarnessError(
            f"{what} would take {needed / 1e9:,.1f} GB of memory, and {free / 1e9:,.1f} GB are free here; take fewer"
        )


def free_memory() -> float:
    """Bytes that this process may still take: of the machine, of its control group (v2), of its own limit."""
    return min(_free_of_machine(), _free_of_group(), _free_of_process())


def _free_of_machine() -> float:
    try:
        lines = (line.split() for line in Path("/proc/meminfo").read_text().splitlines())
        return next(1024 * float(words[1]) for words in lines if words[0] == "MemAvailable:")
    except (OSError, StopIteration):
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")) if hasattr(os, "sysconf") else math.inf


def _free_of_group(root: Path = Path("/sys/fs/cgroup")) -> float:
    """What a container's limit leaves; what is kept of files goes when it is needed."""
    try:
        most, taken = (float((root / f"memory.{name}").read_text()) for name in ("max", "current"))
        kept = dict(line.split() for line in (root / "memory.stat").read_text().splitlines())
        return most - taken + float(kept.get("inactive_file", 0))
    except (OSError, ValueError):  # no such group, or its limit is "max"
        return math.inf


def _free_of_process() -> float:
    try:
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        taken = float(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError):
        return math.inf
    return math.inf if limit == resource.RLIM_INFINITY else limit - taken


def versions(*packages: str) -> dict[str, str]:
    """Versions of Python, of this package and of the named ones, for the record of a run."""
    return {"python": platform.python_version(), **{name: version(name) for name in ("pomdp-harness", *packages)}}


def revision() -> str | None:
    """Git revision of the checkout that this code lies in; None in an installed package."""
    command: Sequence[str] = ("git", "-C", str(Path(__file__).resolve().parent), "rev-parse", "HEAD")
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=5).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


_LOOK = 0.2  # seconds


def end_with(parent: int) -> None:
    """End this process, a worker, as soon as the process ``parent`` that started it is gone.

    A worker whose parent was killed would wait for more work, or go on writing where somebody has taken over.
    """
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os._exit(1)  # nobody is left to tell
