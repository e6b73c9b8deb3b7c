"""What the commands share: arguments, their types, and writing a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from harness.errors import HarnessError, quoted


def domain_argument(parser: argparse.ArgumentParser, nargs: str | None = None) -> None:
    """The positional argument DOMAIN."""
    argument = parser.add_argument(
        "domain", nargs=nargs, metavar="DOMAIN", help="a named domain, a snapshot (.npz) or a Julia file (.jl)"
    )
    argument.completer = _domains  # type: ignore[attr-defined]  # where argcomplete looks


def _domains(**_: object) -> list[str]:
    """What a shell may complete DOMAIN to."""
    from harness import registry

    return registry.names()


def episode_arguments(parser: argparse.ArgumentParser) -> None:
    """``--seed``, ``--horizon`` and ``--engine``."""
    parser.add_argument("--seed", type=natural, default=0, metavar="N", help="default 0")
    parser.add_argument("--horizon", type=positive, default=50, metavar="N", help="steps an episode lasts (default 50)")
    parser.add_argument("--engine", default="auto", help="auto, tables or julia (default auto)")


def natural(text: str) -> int:
    """A whole number, 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not a whole number, 0 or more")
    return int(text)


def positive(text: str) -> int:
    """A whole number, 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not a whole number, 1 or more")
    return int(text)


def positive_number(text: str) -> float:
    """A number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not a number above 0")
    return value


def write(path: Path, text: str) -> None:
    """Write a text file; a HarnessError where that cannot be done."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"cannot write {path}: {error.strerror}") from None
