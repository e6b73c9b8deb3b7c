"""What a step of a reproduction works with: the folder, the sizes, the workers.

``results.sha256`` in it has a line for every result but pictures, as ``sha256sum`` writes them: what was changed
by hand is noticed when it is read again, as in the folders of runs.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from harness import files, locking, registry
from harness.errors import HarnessError
from harness.reproduction import paper
from harness.reproduction.sizes import Sizes
from harness.show import drawing

_DOMAINS = (paper.ROCKSAMPLE, paper.BORDERCROSS)
_HASHES = "results.sha256"
_MEND = "delete it and start again"


@dataclass(frozen=True)
class Folder:
    """A reproduction's folder, and what it is told. All files in it are written whole or not at all, by one process."""

    path: Path
    sizes: Sizes
    engine: str
    workers: int
    progress: bool

    def begin(self) -> None:
        """Make the folder, or find that it is of a reproduction of the same sizes.

        Raises:
            HarnessError: it holds something else, or cannot be written.
        """
        config = {"sizes": asdict(self.sizes), "models": {name: registry.load(name).model_hash for name in _DOMAINS}}
        path = self.path / "config.json"
        if not path.exists():
            if self.path.is_dir() and any(other.name != locking.LOCK for other in self.path.iterdir()):
                raise HarnessError(f"{self.path} holds other files and no reproduction; name a new folder")
            files.replace_json(path, config)
            return
        if files.read_json(path, "start again in a new folder") != config:
            raise HarnessError(
                f"{self.path} holds a reproduction of other sizes or of other models of the domains, or a damaged one; "
                "give or leave out --quick as you did then, or name a new folder"
            )

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

    def read_json(self, name: str) -> Any:
        """Read a result of a run.

        Raises:
            HarnessError: it is damaged.
        """
        return json.loads(self.read_text(name, "put back the one that was there, or start anew in another folder"))

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

    def draw(self, name: str, figure: Figure) -> None:
        """Write a figure."""
        drawing.save(figure, self.path / name)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
