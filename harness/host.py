"""What runs here: the cores of this machine, the versions of what is installed, the revision of a checkout."""

from __future__ import annotations

import os
import platform
import subprocess
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
