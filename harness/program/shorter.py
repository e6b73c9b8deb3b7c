"""Programs with a piece less: what could be taken away from a program's text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

_STEP = "    "  # what the printer indents a block by


def candidates(lines: Sequence[str], at: int) -> Iterator[list[str]]:
    """Texts without something of the statement that begins on line ``at`` of a printed program (``Program.text``).

    First without the statement, then without its ``else``, then without its condition. Not all of them are programs:
    a block may have lost its last statement.
    """
    line = lines[at]
    indent = len(line) - len(line.lstrip())
    head, end = line[indent:], _end(lines, at, indent)
    if head == "loop" or head.startswith(("}", "else")):
        return
    yield [*lines[:at], *lines[end:]]
    then, other = _parts(lines, at, end, indent)
    if other < end:
        yield [*lines[:other], *([line[:indent] + "}"] if lines[other].lstrip()[0] == "}" else []), *lines[end:]]
    elif head.startswith("if"):
        yield [*lines[:at], *then, *lines[end:]]


def _end(lines: Sequence[str], at: int, indent: int) -> int:
    """The line after a statement, whose lines are indented more or begin with ``}`` or ``else``."""
    end = at + 1
    while end < len(lines) and (
        lines[end].startswith(" " * (indent + 1)) or lines[end][indent:].startswith(("}", "else"))
    ):
        end += 1
    return end


def _parts(lines: Sequence[str], at: int, end: int, indent: int) -> tuple[list[str], int]:
    """What the condition guards, as lines at the statement's own depth, and the line with its ``else`` (or ``end``)."""
    own = range(at + 1, end)
    other = next((i for i in own if lines[i][indent:].startswith(("else", "} else"))), end)
    if lines[at].endswith("{"):
        inside = lines[at + 1 : other if other < end else end - 1]
        return [each.removeprefix(_STEP) for each in inside], other
    return [lines[at][:indent] + lines[at][_after_condition(lines[at]) :].lstrip()], other


def _after_condition(line: str) -> int:
    """Where the parenthesis that opens first is closed again."""
    depth, i = 0, line.index("(")
    while True:
        depth += {"(": 1, ")": -1}.get(line[i], 0)
        i += 1
        if depth == 0:
            return i
