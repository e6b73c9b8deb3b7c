"""``reproduce``: everything that the paper shows."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from harness.cli.arguments import cluster_argument, positive


def register(commands: Any) -> None:
    """Add the command to the parser."""
    reproduce = commands.add_parser("reproduce", help="regenerate the paper's tables and figures, beside ours")
    reproduce.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder; goes on with what is there")
    reproduce.add_argument("--quick", action="store_true", help="smaller sizes, under two minutes (the report says so)")
    reproduce.add_argument("--engine", default="tables", help="tables, julia or auto (default tables)")
    reproduce.add_argument("--workers", type=positive, metavar="N", help="processes and threads (default: one a core)")
    cluster_argument(reproduce)
    reproduce.set_defaults(run=_reproduce)


def _reproduce(options: argparse.Namespace) -> None:
    from harness.reproduction import FULL, QUICK, reproduce

    try:
        report = reproduce(
            options.out,
            QUICK if options.quick else FULL,
            engine=options.engine,
            workers=options.workers,
            progress=True,
            tell=lambda line: print(line, flush=True),
        )
    except KeyboardInterrupt:
        quick = " --quick" if options.quick else ""
        print(f"harness: go on with: harness reproduce{quick} --out {options.out}", file=sys.stderr)
        raise
    print(f"{report} is written")
