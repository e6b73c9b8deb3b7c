"""What a step of a reproduction works with: the folder, the sizes, the workers."""

from __future__ import annotations

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


@dataclass(frozen=True)
class Folder:
    """A reproduction's folder, and what it is told. All files in it are written whole or not at all."""

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
        """Whether all of some files are there."""
        return all((self.path / name).exists() for name in names)

    def write(self, name: str, table: pd.DataFrame) -> None:
        """Write a table as CSV."""
        files.replace_text(self.path / name, table.to_csv(index=False, lineterminator="\n"))

    def read(self, name: str) -> pd.DataFrame:
        """Read a table again.

        Raises:
            HarnessError: it is damaged.
        """
        try:
            return pd.read_csv(self.path / name)
        except (OSError, ValueError) as error:
            raise HarnessError(f"{self.path / name} cannot be read ({error}); delete it and start again") from None

    def read_json(self, name: str) -> Any:
        """Read a result of a run.

        Raises:
            HarnessError: it is damaged.
        """
        return files.read_json(self.path / name, "delete it and start again")

    def draw(self, name: str, figure: Figure) -> None:
        """Write a figure."""
        drawing.save(figure, self.path / name)


_DOMAINS = (paper.ROCKSAMPLE, paper.BORDERCROSS)
