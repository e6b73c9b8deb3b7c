"""Names of a domain as model files can spell them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from harness.errors import HarnessError

_OWN = {
    "discount", "values", "states", "actions", "observations", "start", "include", "exclude", "T", "O", "R", "uniform",
    "identity", "reset", "reward", "cost", "null",
}  # fmt: skip


def identifiers(names: Sequence[str], letter: str) -> list[str]:
    """Names of letters, digits, ``_`` and ``-`` that begin with a letter, as ``.pomdp`` files need them.

    ``check(1)`` becomes ``check_1``; where two would be called alike, all get the letter and their number.
    """
    spelled = [re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") for name in names]
    spelled = [name if name[:1].isalpha() and name not in _OWN else letter + name for name in spelled]
    return spelled if len(set(spelled)) == len(names) else [f"{letter}{i}" for i in range(len(names))]


def shown(visible: int, reading: str) -> str:
    """The observation of a ``.pomdp`` file that tells a visible value and a reading."""
    return f"v{visible}_{reading}"


def tokens(names: Sequence[str], letter: str) -> list[str]:
    """Names without white space, as POMDPX files need them; nearly all stay as they are."""
    spelled = ["_".join(name.split()) for name in names]
    spelled = [letter + name if name in ("", "*", "-", "null") else name for name in spelled]
    return spelled if len(set(spelled)) == len(names) else [f"{letter}{i}" for i in range(len(names))]


def readings_hang_on_more(name: str, file_format: str) -> HarnessError:
    """What neither format can say."""
    return HarnessError(
        f"{name}: what is read after a step depends on where the step came from, which .{file_format} files cannot "
        "say; keep it as a snapshot (.npz)"
    )
