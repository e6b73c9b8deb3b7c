"""``report``: a page of results."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from harness.cli.arguments import natural


def register(commands: Any) -> None:
    """Add the command to the parser."""
    report = commands.add_parser("report", help="write one HTML page of tables, runs and sweeps, with replays")
    report.add_argument(
        "sources", nargs="+", type=Path, metavar="RUN_OR_TABLE",
        help="a table of compare (CSV or JSON), or a folder of evolve, tune or sweep",
    )  # fmt: skip
    report.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for index.html")
    report.add_argument(
        "--episodes", type=natural, default=3, metavar="N", help="to replay of each policy (default 3; 0: none)"
    )
    report.add_argument(
        "--seed", type=natural, metavar="N", help="of these episodes (default: the table's; for winners of runs 0)"
    )
    report.add_argument(
        "--domain", action="append", default=[], metavar="FILE",
        help="a domain of yours that results are of, as a snapshot (.npz) or a Julia file (.jl)",
    )  # fmt: skip
    report.add_argument(
        "--allow-code", action="store_true", help="read and run the files that the results name, for their replays"
    )
    report.set_defaults(run=_report)


def _report(options: argparse.Namespace) -> None:
    from harness.report import write_report

    path = write_report(
        options.sources,
        options.out,
        episodes=options.episodes,
        seed=options.seed,
        domains=options.domain,
        allow_code=options.allow_code,
    )
    print(f"{path}: {path.stat().st_size:,} bytes; open it in a browser")
