"""What the commands share: arguments, their types, and writing a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from harness import files
from harness.errors import HarnessError, quoted

_MOST = 2**61 - 1
"""Of every whole number: the greatest seed that meets no episode of training (:mod:`harness.engine.rng`)."""


def domain_argument(
    parser: argparse.ArgumentParser, *, resumable: bool = False, several: bool = False, all_by_default: bool = False
) -> None:
    """The positional argument DOMAIN, which may be left out where a run can be resumed; or several, or none for all."""
    more = "; may be left out with --resume" if resumable else " (default: all that ship)" if all_by_default else ""
    text = f"a named domain, a snapshot (.npz), a model file (.pomdp, .pomdpx) or a Julia file (.jl){more}"
    nargs = "?" if resumable else "*" if all_by_default else "+" if several else None
    argument = parser.add_argument("domain", nargs=nargs, metavar="DOMAIN", help=text)
    argument.completer = _domains  # type: ignore[attr-defined]  # where argcomplete looks


def _domains(**_: object) -> list[str]:
    """What a shell may complete DOMAIN to."""
    from harness import registry

    return registry.names()


def episode_arguments(parser: argparse.ArgumentParser, *, episodes: str = "", resumable: bool = False) -> None:
    """``--seed``, ``--horizon``, ``--engine`` and, where there is a help for it, ``--episodes``.

    Where a run can be resumed, None means that a number was not given.
    """
    seed, horizon = (None, None) if resumable else (0, 50)
    if episodes:
        parser.add_argument("--episodes", type=positive, metavar="N", help=episodes)
    parser.add_argument("--seed", type=natural, default=seed, metavar="N", help="default 0")
    parser.add_argument(
        "--horizon", type=positive, default=horizon, metavar="N", help="steps an episode lasts (default 50)"
    )
    engine_argument(parser)


def engine_argument(parser: argparse.ArgumentParser) -> None:
    """``--engine``."""
    parser.add_argument("--engine", default="auto", help="auto, tables or julia (default auto)")


def cluster_argument(parser: argparse.ArgumentParser) -> None:
    """``--cluster``; the ``harness`` command opens it around the command that it is given to."""
    parser.add_argument(
        "--cluster",
        metavar="WHERE",
        help="play there: tcp://HOST:PORT (Dask), local:N, processes:N, threads:N, slurm:FILE.toml, pbs:FILE.toml",
    )


def natural(text: str) -> int:
    """A whole number, 0 or more."""
    return _whole(text, 0)


def positive(text: str) -> int:
    """A whole number, 1 or more."""
    return _whole(text, 1)


def _whole(text: str, least: int) -> int:
    if not text.isdecimal() or len(text) > len(str(_MOST)) or not least <= int(text) <= _MOST:
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not a whole number from {least} to {_MOST:,}")
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
        files.named(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"cannot write {path}: {error.strerror}") from None
