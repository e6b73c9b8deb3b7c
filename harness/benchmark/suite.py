"""``harness.suite``: every domain × every policy that makes sense there."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import pandas as pd

from harness import cards, host, locking, registry
from harness.benchmark import budgets, playing, scorelist
from harness.benchmark.budgets import Budget
from harness.benchmark.folder import SuiteFolder
from harness.benchmark.playing import ENGINE, Part, Played
from harness.model.domain import Domain
from harness.play import cluster, executor
from harness.play.executor import Workers
from harness.progress import Bar, Progress
from harness.report import write_report
from harness.score import comparison, rendering
from harness.score.aggregation import coverage
from harness.score.bounds import NAMES
from harness.score.comparison import Entry
from harness.score.table import COLUMNS, Table

ORIGIN = ("seconds", "date", "model_hash", "versions")
"""Columns that a suite's table has beside those of a comparison: seconds of one core, when, of what was played."""
TABLE, COVERAGE, SCORES = "suite.csv", "coverage.csv", "scores.toml"


@dataclass(frozen=True)
class Suite:
    """What a suite gave."""

    folder: Path
    budget: Budget
    table: pd.DataFrame
    """One row a domain and policy: the columns of :func:`harness.compare`, and :data:`ORIGIN`."""
    coverage: pd.DataFrame
    """One row a policy (:func:`harness.score.aggregation.coverage`)."""
    page: Path
    """The page of it all."""

    def __repr__(self) -> str:
        """What it is of, on one line."""
        return cards.line("Suite", self.budget.name, self._facts())

    def _repr_html_(self) -> str:
        return cards.card("Suite", self.budget.name, self._facts()) + rendering.covered(self.coverage).to_html(
            index=False
        )

    def _facts(self) -> dict[str, object]:
        rows = self.table[self.table["kind"] == "policy"]
        return {
            "domains": rows["domain"].nunique(),
            "policies": len(self.coverage),
            "rows": len(rows),
            "page": self.page,
        }


@locking.alone
def suite(
    out: str | Path,
    budget: str | Budget = "quick",
    *,
    domains: Sequence[Domain | str] | None = None,
    workers: int | None = None,
    progress: Progress = False,
    tell: Callable[[str], object] = lambda line: None,
) -> Suite:
    """Play all default policies on all domains, or go on with that.

    Stopped or killed at any moment and called again, it goes on where it was, and ends with the same numbers. It plays
    on the workers of a surrounding :func:`harness.cluster`.

    Args:
        out: the folder. It holds ``suite.csv`` (the table), ``coverage.csv`` (a row a policy), ``index.html`` (the
            page), ``scores.toml`` (a list for ``harness check`` of what does not plan), and a file a row.
        budget: ``quick``, ``full``, or a :class:`~harness.benchmark.budgets.Budget`.
        domains: domains or their names; by default all that ship with the package.
        workers: threads, by default one a core; they change no number.
        progress: True for a bar a domain on a terminal, or a function told of every part that has been played.
        tell: called with a line at the beginning of every domain.

    Raises:
        HarnessError: an argument is wrong, or the folder holds something else or what is in it is damaged.
        KeyboardInterrupt: Ctrl-C; call it again to go on.
    """
    chosen, count = budgets.named(budget), host.workers(workers)
    games = comparison.domains_of(registry.names() if domains is None else list(domains))
    folder = SuiteFolder(Path(out))
    folder.begin(chosen)
    rows: list[dict[str, Any]] = []
    for domain in games:
        rows += _Game(folder, domain, chosen).rows(count, progress, tell)
        _write(folder, rows)
    return _finished(folder, chosen, rows)


def _write(folder: SuiteFolder, rows: list[dict[str, Any]]) -> Table:
    """The rows so far: of a suite that is stopped, those of whole domains can be looked at."""
    table = Table(rows, columns=[*COLUMNS, *ORIGIN])
    folder.write_text(TABLE, rendering.render(table, "csv"))
    return table


def _finished(folder: SuiteFolder, budget: Budget, rows: list[dict[str, Any]]) -> Suite:
    folder.finish()
    table = _write(folder, rows)
    covered = coverage(table)
    folder.write(COVERAGE, covered)
    folder.write_text(SCORES, scorelist.text(table, budget))
    page = write_report([folder.path / TABLE], folder.path, episodes=0)
    return Suite(folder.path, budget, table, covered, page)


class _Game:
    """One domain of a suite."""

    def __init__(self, folder: SuiteFolder, domain: Domain, budget: Budget) -> None:
        self.folder, self.domain, self.budget = folder, domain, budget

    def rows(self, workers: int, progress: Progress, tell: Callable[[str], object]) -> list[dict[str, Any]]:
        """All its rows, those played now that are not there."""
        policies = self.budget.policies(self.domain)
        done = {spec: cells for spec in policies if (cells := self.folder.row(self.domain, spec)) is not None}
        there = f", {len(done)} there already" if done else ""
        tell(f"{self.domain.name}: {len(policies)} rows{there}")
        missing = [spec for spec in policies if spec not in done]
        if missing:
            done |= self._played(missing, workers, progress)
        return [done[spec] for spec in policies]

    def _played(self, missing: list[str], workers: int, progress: Progress) -> dict[str, dict[str, Any]]:
        entries = self._entries(missing)
        parts = {name: self._parts(entry) for name, entry in entries.items()}
        each_part = [part for pieces in parts.values() for part in pieces]
        known = {part: played for part in each_part if (played := self.folder.part(self.domain, part)) is not None}
        waiting = playing.long_first(part for part in each_part if part not in known)
        rows: dict[str, dict[str, Any]] = {}

        def finish(name: str) -> None:
            if all(part in known for part in parts[name]):
                rows[name] = self._row(entries[name], [known[part] for part in parts[name]])

        for name in missing:
            finish(name)
        with Bar(progress, len(waiting), desc=self.domain.name, unit="part") as bar, _workers(workers) as where:
            for part, played in executor.each(where, playing.play, waiting, self.domain, name=_name, alike=False):
                self.folder.keep_part(self.domain, part, played)
                known[part] = played
                finish(part.policy)
                bar.update()
        return rows

    def _entries(self, specs: list[str]) -> dict[str, Entry]:
        made = {spec: spec if spec in NAMES else playing.policy_of(self.domain, spec) for spec in specs}
        return {entry.name: entry for entry in comparison.entries_of(self.domain, made, None, ENGINE)}

    def _parts(self, entry: Entry) -> list[Part]:
        if entry.policy is None:
            return []
        return playing.parts(entry.policy, entry.name, self.budget.episodes_of(entry.policy))

    def _row(self, entry: Entry, played: list[Played]) -> dict[str, Any]:
        """The columns of a row whose parts are all there; from now on it is there itself."""
        if entry.policy is None:
            cells, seconds = comparison.bound_cells(entry, playing.horizon(self.domain)), 0.0
        else:
            result, seconds = playing.joined(self.domain, entry.name, played)
            cells = comparison.played_cells(entry, result)
        origin = (seconds, date.today().isoformat(), self.domain.model_hash, executor.fingerprint())
        row = {**cells, **dict(zip(ORIGIN, origin, strict=True))}
        self.folder.keep_row(self.domain, entry.name, row)
        return row


@contextlib.contextmanager
def _workers(count: int) -> Iterator[Workers | None]:
    """Those of the surrounding cluster, else threads of this process."""
    if (found := executor.current()) is not None or count == 1:
        yield found
    else:
        with cluster.threads(count) as made:
            yield made


def _name(part: Part) -> str:
    return f"{part.policy}, episodes from {part.first:,}"
