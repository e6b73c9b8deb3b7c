"""``check``: scores under regression control."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.cli.arguments import cluster_argument, natural, write
from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.regression.judging import ScoreCheck


def register(commands: Any) -> None:
    """Add the command to the parser."""
    check = commands.add_parser(
        "check",
        help="score a list again and compare with the stored scores",
        description="Score the rows of a file again and compare with the scores stored in it. Exit status 0: none got "
        "worse; 1: one did, or could not be compared; 2: a misuse.",
    )
    check.add_argument(
        "file", nargs="?", type=Path, default=Path("scores.toml"), metavar="FILE", help="default: scores.toml"
    )
    check.add_argument("--update", action="store_true", help="store the scores of now, and print what moved")
    check.add_argument("--exact", action="store_true", help="fail unless every episode comes out as stored")
    check.add_argument("--seed", type=natural, metavar="N", help="other episodes, compared by Welch's test")
    check.add_argument("--engine", metavar="ENGINE", help="auto, tables or julia (default: what each row says)")
    check.add_argument("--allow-code", action="store_true", help="read and run the files that the rows name")
    check.add_argument("--junit", type=Path, metavar="FILE", help="write the outcomes as JUnit XML too")
    check.add_argument(
        "--github", action="store_true", help="print annotations too, and append to the file $GITHUB_STEP_SUMMARY"
    )
    cluster_argument(check)
    check.set_defaults(run=_check)


def _check(options: argparse.Namespace) -> int:
    from harness.regression import checking

    if options.update:
        return _update(options)
    try:
        check = checking.check_scores(
            options.file,
            exact=options.exact,
            seed=options.seed,
            engine=options.engine,
            allow_code=options.allow_code,
            progress=True,
        )
    except checking.Interrupted as stop:
        if stop.check.outcomes:
            _put(stop.check, options)
        raise
    _put(check, options)
    return 0 if check.passed else 1


def _put(check: ScoreCheck, options: argparse.Namespace) -> None:
    from harness.regression import ci, reports

    print(reports.text(check), end="")
    if options.junit:
        write(options.junit, ci.junit(check))
    if options.github:
        print(ci.github_annotations(check), end="")
        if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
            ci.append_summary(check, Path(summary))


def _update(options: argparse.Namespace) -> int:
    from harness.regression import checking, reports

    for name in ("exact", "seed", "engine", "junit", "github"):
        if getattr(options, name) not in (None, False):
            raise HarnessError(f"--update scores what the file says, and nothing else; leave out --{name}")
    print(reports.moves(checking.update_scores(options.file, allow_code=options.allow_code, progress=True)), end="")
    return 0
