"""Programs as they are read: numbered lines, and what has changed from one to another."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher

from harness.report.markup import escape, note

_CONTEXT = 2  # lines that stay the same, shown around those that do not
_MOST_LINES, _MOST_WORDS = 1_000, 100  # a comparison takes time that grows with their square
_ALIKE = 0.6  # share of words in common, from which on a line is another one altered
_TOKEN = re.compile(r"\s+|[\w.]+|.")


def lines_of(text: str) -> list[str]:
    """A program's lines. Only a line feed ends one: readings may be called anything else."""
    return text.removesuffix("\n").split("\n")


def listing(text: str) -> str:
    """A program with numbered lines (numbers are no part of the text) and a button that copies it."""
    shown = "\n".join(f'<span class="line">{escape(line)}</span>' for line in lines_of(text))
    return (
        '<div class="program"><button type="button" class="copy" hidden>Copy</button>'
        f'<pre class="numbered" tabindex="0"><code>{shown}</code></pre></div>'
    )


def difference(old: str, new: str) -> str:
    """What is in a program that was not in an older one, and what is no longer: - before the old lines, + before the
    new ones, and where a line was only altered, its altered words marked."""
    before, after = lines_of(old), lines_of(new)
    if _too_long(before, after):
        return note(f"Programs of more than {_MOST_LINES:,} lines are not compared.")
    pieces = [_hunk(before, after, group) for group in _matcher(before, after).get_grouped_opcodes(_CONTEXT)]
    gap = '<span class="gap">  ⋯</span>\n'
    return f'<pre class="diff" tabindex="0"><code>{gap.join(pieces)}</code></pre>' if pieces else note("No line.")


def changes(old: str, new: str) -> str:
    """How many lines differ, in words: ``3 lines gone, 2 new``."""
    before, after = lines_of(old), lines_of(new)
    if _too_long(before, after):
        return f"{len(before):,} lines before, {len(after):,} now"
    codes = [code for code in _matcher(before, after).get_opcodes() if code[0] != "equal"]
    gone, come = sum(code[2] - code[1] for code in codes), sum(code[4] - code[3] for code in codes)
    return f"{gone} {'line' if gone == 1 else 'lines'} gone, {come} new"


def _too_long(before: Sequence[str], after: Sequence[str]) -> bool:
    return max(len(before), len(after)) > _MOST_LINES


def _matcher(before: Sequence[str], after: Sequence[str]) -> SequenceMatcher[str]:
    return SequenceMatcher(None, before, after, autojunk=False)


def _hunk(before: Sequence[str], after: Sequence[str], group: Sequence[tuple[str, int, int, int, int]]) -> str:
    return "".join(f"{line}\n" for kind, *ends in group for line in _lines(kind, before, after, *ends))


def _lines(kind: str, before: Sequence[str], after: Sequence[str], i: int, j: int, k: int, m: int) -> Iterator[str]:
    if kind == "equal":
        yield from (f'<span class="same">  {escape(line)}</span>' for line in before[i:j])
        return
    old, new = before[i:j], after[k:m]
    paired = len(old) == len(new)  # most likely the same lines, altered
    yield from (f"<del>- {line}</del>" for line in _marked(old, new if paired else ()))
    yield from (f"<ins>+ {line}</ins>" for line in _marked(new, old if paired else ()))


def _marked(lines: Sequence[str], others: Sequence[str]) -> list[str]:
    """The lines as HTML, with what is not in the line beside each of them marked."""
    if not others:
        return [escape(line) for line in lines]
    return [_words(line, other) for line, other in zip(lines, others, strict=True)]


def _words(line: str, other: str) -> str:
    own, its = _TOKEN.findall(line), _TOKEN.findall(other)
    if max(len(own), len(its)) > _MOST_WORDS:
        return escape(line)
    matcher = _matcher(own, its)
    if matcher.ratio() < _ALIKE:
        return escape(line)
    parts = [(kind, escape("".join(own[i:j]))) for kind, i, j, _, _ in matcher.get_opcodes() if i < j]
    return "".join(part if kind == "equal" else f"<mark>{part}</mark>" for kind, part in parts)
