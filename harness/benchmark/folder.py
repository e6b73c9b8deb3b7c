"""A suite's folder: a file a row, and the parts of rows under way."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness import files
from harness.benchmark.budgets import Budget
from harness.benchmark.playing import ARRAYS, HORIZON, REST, SEED, Part, Played
from harness.errors import SnapshotError
from harness.model import archive
from harness.model.domain import Domain
from harness.play import executor
from harness.sealed import Sealed

_KIND, _PARTS = "episodes", "parts"
_MEND = "delete it and go on: it is played again"


class SuiteFolder(Sealed):
    """Rows that are done, sealed by their hashes, and what is played of the others."""

    def begin(self, budget: Budget) -> None:
        """Make the folder, or find that it is of a suite of the same budget.

        Raises:
            HarnessError: it holds something else, or cannot be written.
        """
        config = {"budget": json.loads(json.dumps(asdict(budget))), "seed": SEED, "horizon": HORIZON, "rest": REST}
        self.begin_with(
            config, "suite", "of another budget, or a damaged one; give the --budget that it was begun with"
        )

    def row(self, domain: Domain, policy: str) -> dict[str, Any] | None:
        """A row that is done, by its columns; None where it is not, or was of another model of the domain.

        Raises:
            HarnessError: its file was changed by hand or is damaged.
        """
        name = _row(domain, policy)
        if not self.has([name]):
            return None
        cells: dict[str, Any] = self.read_json(name, _MEND)
        return cells if cells["model_hash"] == domain.model_hash else None

    def keep_row(self, domain: Domain, policy: str, cells: dict[str, Any]) -> None:
        """A row is done; its parts are no longer needed."""
        self.write_text(_row(domain, policy), json.dumps(cells, indent=2) + "\n")
        shutil.rmtree(self.path / _parts(domain, policy), ignore_errors=True)

    def finish(self) -> None:
        """All rows are done: what kills have left of their parts goes."""
        shutil.rmtree(self.path / _PARTS, ignore_errors=True)

    def part(self, domain: Domain, part: Part) -> Played | None:
        """Episodes that are played; None where they are not, or were by other versions or on another model."""
        path = self._part(domain, part)
        if not path.exists():
            return None
        try:
            record, arrays = archive.read(path, _KIND, _MEND)
        except SnapshotError:  # a damaged file costs the seconds of playing it again
            return None
        if record["of"] != _origin(domain, part) or set(arrays) != set(ARRAYS):
            return None
        return Played(arrays, record["seconds"])

    def keep_part(self, domain: Domain, part: Part, played: Played) -> None:
        """Episodes are played."""
        path = self._part(domain, part)
        files.clear(path.parent, path.name)
        record = {"of": _origin(domain, part), "seconds": played.seconds}
        archive.write(path, _KIND, record, played.arrays, compressed=False)

    def _part(self, domain: Domain, part: Part) -> Path:
        return self.path / _parts(domain, part.policy) / f"{part.first}.npz"


def _origin(domain: Domain, part: Part) -> list[Any]:
    """What decides the episodes."""
    return [executor.fingerprint(), domain.model_hash, *part]


def _row(domain: Domain, policy: str) -> str:
    return f"rows/{_word(domain.name)}/{_word(policy)}.json"


def _parts(domain: Domain, policy: str) -> str:
    return f"{_PARTS}/{_word(domain.name)}/{_word(policy)}"


def _word(text: str) -> str:
    """As the name of a file: ``rollout:100`` is ``rollout_100``."""
    return re.sub(r"[^\w.-]+", "_", text)
