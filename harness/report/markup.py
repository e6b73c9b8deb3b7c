"""HTML from values. All text is escaped here, and only here."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def escape(text: object) -> str:
    """Text as HTML shows it, in an element or in an attribute."""
    return html.escape(str(text), quote=True)


def data(value: Any) -> str:
    """A value for the page's scripts. No text in it can end the element: JSON may spell ``<`` as ``\\u003c``."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return f'<script type="application/json">{text}</script>'


def facts(pairs: Mapping[str, object]) -> str:
    """Names and values, those without a value left out."""
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
        for name, value in pairs.items()
        if value not in (None, "")
    )
    return f'<dl class="facts">{items}</dl>'


def listed(pairs: object) -> str:
    """Names and values on one line; nothing where a file has something else there."""
    return ", ".join(f"{name} {value}" for name, value in pairs.items()) if isinstance(pairs, Mapping) else ""


def note(text: str) -> str:
    """A remark."""
    return f'<p class="note">{escape(text)}</p>'


def details(summary: str, body: str, *, opened: bool = False) -> str:
    """What is shown when asked for; ``body`` is HTML."""
    return f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>{body}</details>"


def plain_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of numbers, the first column being what the row is about."""
    header = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    lines = "".join(
        f'<tr><th scope="row">{escape(number(row[0]))}</th>'
        + "".join(f"<td>{escape(number(cell))}</td>" for cell in row[1:])
        + "</tr>"
        for row in rows
    )
    inside = f"{caption_of(caption)}<thead><tr>{header}</tr></thead><tbody>{lines}</tbody>"
    return scrolled(caption, f"<table>{inside}</table>")


def caption_of(text: str) -> str:
    """A table's caption; the span is what stays in view while the table scrolls."""
    return f"<caption><span>{escape(text)}</span></caption>"


def scrolled(label: str, table: str) -> str:
    """A wide table scrolls by itself, also by keyboard; the page does not."""
    return f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(label)}">{table}</div>'


def number(value: object) -> str:
    """A value to be read: up to six significant digits, nothing for not-a-number."""
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else ""
    return "" if value is None else str(value)


def plus_minus(mean: float, error: float) -> str:
    """A mean and its standard error."""
    return f"{mean:.2f} ± {error:.2f}"
