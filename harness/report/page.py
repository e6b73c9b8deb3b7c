"""The page: a template, a style sheet and a script, put together in one file that needs nothing else."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from harness import host
from harness.report.markup import data, escape, note

STATIC = Path(__file__).resolve().parent / "static"
SCRIPTS = ("base.js", "tables.js", "charts.js", "bars.js", "grids.js", "player.js", "main.js")
"""In the order in which they become one module."""


class Section(NamedTuple):
    """A part of the page: HTML, what the player needs, and remarks on what it cannot play."""

    title: str
    source: str
    body: str
    replays: dict[str, Any] | None
    missing: Sequence[str]


def page(title: str, made: date, sections: Sequence[Section]) -> str:
    """The whole page; ``made`` is the day that it says it was made on."""
    style = _static("report.css")
    script = "\n".join(_static(name) for name in SCRIPTS)
    contents = "".join(
        f'<li><a href="#section-{k}">{escape(each.title)}</a> <span>{escape(each.source)}</span></li>'
        for k, each in enumerate(sections, 1)
    )
    return Template(_static("page.html")).substitute(
        title=escape(title),
        # Nothing may be loaded, and no script may run but the one below: a second line of defence behind escaping.
        policy=escape(
            f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
            "base-uri 'none'; form-action 'none'"
        ),
        style=style,
        script=script,
        made=f'Made on <time datetime="{made}">{made}</time> by pomdp-harness {_version()}',
        contents=contents,
        sections="\n".join(_section(k, each) for k, each in enumerate(sections, 1)),
    )


def _section(k: int, section: Section) -> str:
    heading = f'<h2 id="section-{k}-title">{escape(section.title)}</h2><p class="source">{escape(section.source)}</p>'
    notes = "".join(note(text) for text in section.missing)
    player = f'<div class="player">{data(section.replays)}</div>' if section.replays else ""
    episodes = f"<h3>Episodes, step by step</h3>{player}{notes}" if player or notes else ""
    label = f'id="section-{k}" aria-labelledby="section-{k}-title"'
    return f"<section {label}>{heading}{section.body}{episodes}</section>"


def _version() -> str:
    return escape(host.versions()["pomdp-harness"])


def _static(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """As a content security policy names an inline script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
