"""Programs that a run keeps on its way, in a file of its folder that later generations only add to.

What a generation adds depends on those before it, so a run that goes on from a checkpoint drops what came after that,
and ends with the same file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from harness import files
from harness.errors import HarnessError

_MEND = "delete it, nothing else depends on it"


class Kind(NamedTuple):
    """A file of entries."""

    name: str
    what: str
    """What it lists, for people."""
    fields: Mapping[str, type]
    """Of an entry: ``generation`` and numbers, beside ``program``, its lines."""


class Entries:
    """The file in a run's folder, and what will be in it."""

    def __init__(self, kind: Kind, folder: Path | None, generations: int) -> None:
        """Those of the first so many generations; without a folder they are kept in memory.

        Raises:
            HarnessError: the file is damaged.
        """
        self._kind, self._folder = kind, folder
        stored = read(kind, folder) if folder else []
        self.found = [each for each in stored if each["generation"] < generations]
        self._written: int | None = None  # entries on disk, if they are these

    def save(self, generations: int) -> None:
        """Write those of the first so many generations, where that changes the file.

        Raises:
            HarnessError: it cannot be written.
        """
        kept = [each for each in self.found if each["generation"] < generations]
        if self._folder and self._written != len(kept):
            files.replace_json(self._folder / self._kind.name, kept)
            self._written = len(kept)


def read(kind: Kind, folder: Path) -> list[dict[str, Any]]:
    """The entries in a run's folder; none where there is no file, as in folders of older versions.

    Raises:
        HarnessError: the file is damaged.
    """
    path = folder / kind.name
    if not path.exists():
        return []
    found = files.read_json(path, _MEND)
    if not isinstance(found, list) or not all(_is_whole(kind.fields, each) for each in found):
        raise HarnessError(f"{path}: this is no list of {kind.what}; {_MEND}")
    return found


def _is_whole(fields: Mapping[str, type], entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and all(type(entry.get(name)) is kind for name, kind in fields.items())
        and isinstance(lines := entry.get("program"), list)
        and all(isinstance(line, str) for line in lines)
        and all(math.isfinite(entry[name]) for name in fields)
    )
