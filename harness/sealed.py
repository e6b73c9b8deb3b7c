"""A folder of results that grows step by step, and knows them again when it is gone on with.

``results.sha256`` in it has a line for every sealed result, as ``sha256sum`` writes them: what was changed by hand is
noticed when it is read again, as in the folders of runs. All files are written whole or not at all, by one process.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness import files, locking
from harness.errors import HarnessError

_HASHES = "results.sha256"
_MEND = "delete it and start again"


@dataclass(frozen=True)
class Sealed:
    """Such a folder."""

    path: Path

    def begin_with(self, config: Mapping[str, Any], what: str, otherwise: str) -> None:
        """Make the folder, or find that it was begun with the same ``config.json``.

        Args:
            config: what decides the results, as JSON has it.
            what: what the folder holds, for error messages.
            otherwise: what is to be told of a folder that was begun with another one.

        Raises:
            HarnessError: it holds something else, or cannot be written.
        """
        path = self.path / "config.json"
        if not path.exists():
            if self.path.is_dir() and any(other.name != locking.LOCK for other in self.path.iterdir()):
                raise HarnessError(f"{self.path} holds other files and no {what}; name a new folder")
            files.replace_json(path, config)
        elif files.read_json(path, "start again in a new folder") != config:
            raise HarnessError(f"{self.path} holds a {what} {otherwise}, or name a new folder")

    def has(self, names: Sequence[str]) -> bool:
        """Whether all of some files are there, with their hashes; pictures have none."""
        there = all((self.path / name).exists() for name in names)
        return there and {name for name in names if not name.endswith(".png")} <= self._hashes().keys()

    def write(self, name: str, table: pd.DataFrame) -> None:
        """Write a table as CSV."""
        self.write_text(name, table.to_csv(index=False, lineterminator="\n"))

    def write_text(self, name: str, text: str) -> None:
        """Write a text."""
        path = self.path / name
        files.clear(path.parent, path.name)
        files.replace_text(path, text)
        self.seal([name])

    def read(self, name: str) -> pd.DataFrame:
        """Read a table again.

        Raises:
            HarnessError: it is damaged.
        """
        return pd.read_csv(io.StringIO(self.read_text(name)))

    def read_json(
        self, name: str, mend: str = "put back the one that was there, or start anew in another folder"
    ) -> Any:
        """Read a result of a run.

        Raises:
            HarnessError: it is damaged.
        """
        return json.loads(self.read_text(name, mend))

    def seal(self, names: Sequence[str]) -> None:
        """Keep the hashes of files as they are now."""
        new = {name: _sha256(files.read_text(self.path / name, _MEND)) for name in names}
        hashes = {**self._hashes(), **new}
        files.replace_text(self.path / _HASHES, "".join(f"{hashes[name]}  {name}\n" for name in sorted(hashes)))

    def read_text(self, name: str, mend: str = _MEND) -> str:
        """Read a text again; ``mend`` is what the error message tells the user to do.

        Raises:
            HarnessError: it is damaged.
        """
        text = files.read_text(self.path / name, mend)
        if self._hashes().get(name) != _sha256(text):
            raise HarnessError(f"{self.path / name} is damaged, or was changed by hand; {mend}")
        return text

    def _hashes(self) -> dict[str, str]:
        path = self.path / _HASHES
        lines = files.read_text(path, f"delete it, and what it lists: {_MEND}").splitlines() if path.exists() else []
        return {name: value for value, _, name in (line.partition("  ") for line in lines)}


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
