"""The ``harness`` command: nothing but the handling of arguments.

Each module here adds a few commands; the commands import what they need when they run, so that ``--help`` and a misuse
answer at once.
"""

from __future__ import annotations

import argparse
import io
import logging
import os
import re
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NoReturn

import harness
from harness.cli import (
    benchmark,
    checks,
    evolution,
    literature,
    models,
    programs,
    reporting,
    reproduction,
    scores,
    tuning,
)
from harness.errors import LONGEST_QUOTE, HarnessError, quoted, sentence


class _Parser(argparse.ArgumentParser):
    """Says what was wrong in one sentence; exit status 2."""

    def error(self, message: str) -> NoReturn:
        short = re.sub(rf"(\S{{{LONGEST_QUOTE - 2}}})\S{{3,}}", r"\1 …", message)  # argparse repeats the input as it is
        print(f"harness: {sentence(f'{short} (see: {self.prog} --help)')}", file=sys.stderr)
        raise SystemExit(2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status: 0, 1 when a check failed, 2 for a misuse, 130 after Ctrl-C."""
    _print_anywhere()
    try:
        return _run(arguments)
    except HarnessError as error:
        print(f"harness: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("harness: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output (head, less) has gone
        _drop_output()
        return 0
    except OSError as error:  # most have a sentence of their own where they arise; a full disk may strike anywhere
        where = quoted(error.filename) if error.filename else "the output"
        print(f"harness: cannot read or write {where}: {error.strerror}", file=sys.stderr)
        _drop_output()
        return 2


def _run(arguments: Sequence[str] | None) -> int:
    try:
        parser, words = _parsers()[0], sys.argv[1:] if arguments is None else arguments
        if "_ARGCOMPLETE" in os.environ:  # a shell asks how the line may go on
            import argcomplete

            argcomplete.autocomplete(parser)
        for word in words:
            if word.startswith("--") and word.endswith("=--"):  # argparse would take that for an empty list
                parser.error(f"{word[:-3]} needs a value, not '--'")
        options = parser.parse_args(words)
        _tell_of_model_files()
        with _on(getattr(options, "cluster", None)):
            return int(options.run(options) or 0)
    finally:
        print(end="", flush=True)  # here, where a reader that has gone is still no error


def _on(cluster: str | None) -> AbstractContextManager[None]:
    """Where the command plays."""
    if cluster is None:
        return nullcontext()
    from harness.play.cluster import cluster as opened

    return opened(cluster)


def _tell_of_model_files() -> None:
    """Print what reading a model file has made of it, which the room of formats logs."""
    log = logging.getLogger("harness.formats")
    if not log.handlers:
        log.addHandler(logging.StreamHandler())
        log.setLevel(logging.INFO)
        log.propagate = False


def _print_anywhere() -> None:
    """Print a sign that the encoding of a terminal or a redirect lacks as an escape (in cp1252 γ is a ``\\u03b3``)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a caller may have put something else there
            stream.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """What is still buffered cannot be written: Python shall not try again, and complain, when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def help_texts() -> dict[str, str]:
    """What ``--help`` prints, by command; of ``""`` what ``harness --help`` prints. For the documentation."""
    parser, commands = _parsers()
    return {"": parser.format_help()} | {name: each.format_help() for name, each in commands.items()}


def _parsers() -> tuple[_Parser, dict[str, _Parser]]:
    """The parser, and those of its commands by name."""
    parser = _Parser(prog="harness", description="Benchmark of evolved, heuristic and solved POMDP policies.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {harness.__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)
    rooms = (scores, benchmark, literature, evolution, programs, tuning, reproduction, reporting, checks, models)
    for room in rooms:
        room.register(commands)
    return parser, commands.choices
