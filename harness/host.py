"""What runs here: the cores of this machine, the versions of what is installed, a checkout's revision, the parent."""

from __future__ import annotations

import os
import platform
import subprocess
import threading
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path


def cores() -> int:
    """Number of processor cores, 1 where nobody knows."""
    return os.cpu_count() or 1


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
