"""The ``harness`` command: nothing but the handling of arguments.

Each module here adds a few commands; the commands import what they need when they run, so that ``--help`` and a misuse
answer at once.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from harness.cli import checks, evolution, models, reporting, reproduction, scores, tuning
from harness.errors import HarnessError


class _Parser(argparse.ArgumentParser):
    """Says what was wrong in one sentence, with the nearest spelling; exit status 2."""

    def error(self, message: str) -> NoReturn:
        print(f"harness: {message} (see: {self.prog} --help)", file=sys.stderr)
        raise SystemExit(2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status: 0, 1 when a check failed, 2 for a misuse, 130 after Ctrl-C."""
    options = _parser().parse_args(arguments)
    try:
        status = int(options.run(options) or 0)
        sys.stdout.flush()  # here, where a reader that has gone is still no error
        return status
    except HarnessError as error:
        print(f"harness: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("harness: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output (head, less) has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="harness", description="Benchmark of evolved, heuristic and solved POMDP policies.")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)
    for room in (scores, evolution, tuning, reproduction, reporting, checks, models):
        room.register(commands)
    return parser
