"""The file of scores: ``[[score]]`` tables that people write, ``[[stored]]`` tables that ``--update`` writes.

The two are kept apart so that their sets of rows can be compared: a row that vanished from the list is noticed, and
comments and order of the list survive every update.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from harness import files
from harness.errors import HarnessError, nearest, quoted
from harness.regression.rows import AnyScore, FieldFault, Key, Limits, Row, StoredExact, StoredScore, from_table
from harness.score.table import EXACT, SAMPLED

SECTIONS = ("check", "score", "stored")
NOTE = "# Stored scores, written by `harness check --update` and by nobody's hand."

_T = TypeVar("_T")


@dataclass(frozen=True)
class ScoreFile:
    """A file of scores as read."""

    path: Path
    rows: tuple[Row, ...] = ()
    lines: tuple[int, ...] = ()
    """Line in the file of each row."""
    limits: Limits = field(default_factory=Limits)
    stored: dict[Key, AnyScore] = field(default_factory=dict)
    damaged: dict[Key, str] = field(default_factory=dict)
    """Stored scores that cannot be used, each with what is wrong with it."""
    stored_lines: dict[Key, int] = field(default_factory=dict)
    """Line of each stored score, of the damaged ones too."""


def read(path: Path) -> ScoreFile:
    """Read a file of scores.

    A stored score with a column too few or too many, or a value that is no number, does not stop the others from
    being checked: it is kept in ``damaged``.

    Raises:
        HarnessError: no such file, one of over :data:`harness.files.LARGEST_SOURCE`, no TOML, a misspelt key, a wrong
            type, a row listed twice; names file and line.
    """
    if not path.exists():
        raise HarnessError(f"{path}: no such file; list what to score in it, as [[score]] tables")
    text = files.read_source(path)
    try:
        tables = files.toml(text)
    except ValueError as error:
        raise HarnessError(f"{path}: not TOML: {error}") from None
    return _Reader(path, text, tables).file()


class _Reader:
    """Turns tables into rows; knows the lines, for messages."""

    def __init__(self, path: Path, text: str, tables: dict[str, Any]) -> None:
        self.path, self.tables = path, tables
        self.text = text.splitlines()
        self._headers: dict[str, list[int]] = {}

    def file(self) -> ScoreFile:
        for name in self.tables:
            if name not in SECTIONS:
                hint = nearest(name, SECTIONS)
                raise HarnessError(f"{self.path}:{self._find(name, 1)}: no section {quoted(name)} is known here{hint}")
        limits = self._parse(Limits, "check", 0, self.tables.get("check", {}))
        rows = tuple(self._parse(Row, "score", i, table) for i, table in enumerate(self._list("score")))
        lines = tuple(self.line("score", i) for i in range(len(rows)))
        seen: dict[Key, int] = {}
        for row, line in zip(rows, lines, strict=True):
            if row.key in seen:
                raise HarnessError(
                    f"{self.path}:{line}: {row.policy} on {row.domain} is listed twice (first in line {seen[row.key]})"
                )
            seen[row.key] = line
        return ScoreFile(self.path, rows, lines, limits, *self._stored())

    def _stored(self) -> tuple[dict[Key, AnyScore], dict[Key, str], dict[Key, int]]:
        stored: dict[Key, AnyScore] = {}
        damaged: dict[Key, str] = {}
        lines: dict[Key, int] = {}
        for i, table in enumerate(self._list("stored")):
            key = _key(table)
            line = self.line("stored", i)
            if key in lines:
                damaged[key] = f"two scores are stored for it, in lines {lines[key]} and {line}"
                continue
            lines[key] = line
            try:
                stored[key] = from_table(StoredExact, table) if key[3] == EXACT else from_table(StoredScore, table)
            except FieldFault as fault:
                damaged[key] = f"its stored score in line {line} cannot be used: {fault}"
        return stored, damaged, lines

    def _list(self, section: str) -> list[dict[str, Any]]:
        tables = self.tables.get(section, [])
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise HarnessError(f"{self.path}:{self._find(section, 1)}: '{section}' must be written [[{section}]]")
        return tables

    def _parse(self, kind: type[_T], section: str, index: int, table: Any) -> _T:
        if not isinstance(table, dict):
            raise HarnessError(f"{self.path}:{self._find(section, 1)}: '{section}' must be written [{section}]")
        try:
            return from_table(kind, table)
        except FieldFault as fault:
            line = self.line(section, index)
            raise HarnessError(f"{self.path}:{self._find(fault.key, line)}: {fault}") from None

    def line(self, section: str, index: int) -> int:
        """Line of the index-th header of a section; 1 where the tables are written in another way."""
        if section not in self._headers:
            header = re.compile(rf"\s*\[?\[\s*{section}\s*\]")
            self._headers[section] = [number for number, text in enumerate(self.text, 1) if header.match(text)]
        found = self._headers[section]
        return found[index] if index < len(found) else 1

    def _find(self, key: str, start: int) -> int:
        """Line of a key or section at or after a line; that line where it is not found."""
        pattern = re.compile(rf"\s*\[*\s*[\"']?{re.escape(key)}[\"']?\s*[=\]]")
        hits = (n for n, text in enumerate(self.text[start - 1 :], start) if key and pattern.match(text))
        return next(hits, start)


def _key(table: dict[str, Any]) -> Key:
    """What a stored score belongs to, even where it is damaged."""
    horizon = table.get("horizon")
    how = EXACT if "how" in table else SAMPLED
    return str(table.get("domain")), str(table.get("policy")), horizon if isinstance(horizon, int) else 0, how


def write(path: Path, scores: Iterable[AnyScore]) -> None:
    """Write the stored scores into a file of scores, atomically; all else in it stays as it is.

    Raises:
        HarnessError: the file cannot be written.
    """
    text = _without_stored(path.read_text(encoding="utf-8")) if path.exists() else ""
    blocks = "\n".join(_block(score) for score in scores)
    head = f"{text.rstrip()}\n\n" if text.strip() else ""
    files.replace_text(path, f"{head}{NOTE}\n\n{blocks}")


def _block(score: AnyScore) -> str:
    """JSON's texts and numbers are TOML's too, as long as they are finite."""
    values = dataclasses.asdict(score).items()
    return "[[stored]]\n" + "".join(f"{key} = {json.dumps(value, allow_nan=False)}\n" for key, value in values)


def _without_stored(text: str) -> str:
    """The text without its ``[[stored]]`` tables, wherever they stand; what people wrote between them is kept."""
    kept: list[str] = []
    inside = False
    for line in text.splitlines():
        if re.match(r"\s*\[\[\s*stored\s*\]\]", line):
            inside = True
        elif inside and re.match(r"\s*(\w+\s*=.*)?$", line):
            continue  # a value of the table, or an empty line
        elif line.strip() != NOTE:
            inside = False
            kept.append(line)
    return "\n".join(kept)
