"""What is shown of an object: one line in a terminal, a small card in a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape


def line(kind: str, title: str, facts: Mapping[str, object]) -> str:
    """``<Kind title: name value, …>``, for ``__repr__``."""
    listed = ", ".join(f"{name} {value}" for name, value in facts.items())
    return f"<{kind} {title}: {listed}>"


def card(kind: str, title: str, facts: Mapping[str, object], text: str = "") -> str:
    """The same as HTML, for ``_repr_html_``; ``text`` is a program."""
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in facts.items())
    program = f"<pre>{escape(text)}</pre>" if text else ""
    return f"<p>{escape(kind)} <b>{escape(title)}</b></p><table>{rows}</table>{program}"


def plus_minus(mean: float, error: float) -> str:
    """A mean and its standard error."""
    return f"{mean:.2f} ± {error:.2f}"


def brief(text: str, width: int = 40) -> str:
    """A text on one line of at most ``width`` characters."""
    flat = "; ".join(text.split("\n")).strip("; ")
    return flat if len(flat) <= width else f"{flat[: width - 2]} …"
