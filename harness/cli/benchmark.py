"""``suite``: all domains × all policies."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from harness.cli.arguments import cluster_argument, domain_argument, positive


def register(commands: Any) -> None:
    """Add the command to the parser."""
    suite = commands.add_parser(
        "suite",
        help="play all policies on all domains: a table, a figure a policy, a page",
        description="Play all policies that make sense on all domains, and write a table (suite.csv), what each policy "
        "earns over its domains (coverage.csv), a page (index.html), and a list for harness check (scores.toml). "
        "Stopped at any moment, the same command goes on.",
    )
    domain_argument(suite, all_by_default=True)
    suite.add_argument(
        "--budget", choices=("quick", "full"), default="quick", help="quick: minutes (default); full: an hour or two"
    )
    suite.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder; goes on with what is there")
    suite.add_argument("--workers", type=positive, metavar="N", help="threads (default: one a core)")
    cluster_argument(suite)
    suite.set_defaults(run=_suite)


def _suite(options: argparse.Namespace) -> None:
    from harness.benchmark.suite import suite
    from harness.score import rendering

    try:
        found = suite(
            options.out,
            options.budget,
            domains=options.domain or None,
            workers=options.workers,
            progress=True,
            tell=lambda line: print(line, flush=True),
        )
    except KeyboardInterrupt:
        again = " ".join([*options.domain, f"--budget {options.budget}", f"--out {options.out}"])
        print(f"harness: go on with: harness suite {again}", file=sys.stderr)
        raise
    print(f"\n{rendering.grid(rendering.covered(found.coverage), 'table')}\n\n{rendering.COVERED}")
    print(f"\n{options.out}: suite.csv, coverage.csv, index.html, scores.toml")
