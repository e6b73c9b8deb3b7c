"""``literature``: the published figures, with ours beside them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from harness.cli.arguments import write
from harness.cli.scores import FORMATS


def register(commands: Any) -> None:
    """Add the command to the parser."""
    literature = commands.add_parser(
        "literature",
        help="list published figures, with ours on the same rules and a verdict",
        description="List every published figure that was found, what ours gives on the same rules, and a verdict: "
        "reproduced, not reproduced (by how much), undecided, other rules, not run. Nothing is played.",
    )
    literature.add_argument("--domain", metavar="D", help="a domain, or a problem by its published name (default: all)")
    literature.add_argument("--format", choices=FORMATS, default="table", help="default: table; csv has all columns")
    literature.add_argument("--out", type=Path, metavar="FILE", help="write there instead of to the terminal")
    literature.set_defaults(run=_literature)


def _literature(options: argparse.Namespace) -> None:
    from harness.score import listing
    from harness.score.literature import literature

    text = listing.render(literature(options.domain), options.format)
    if options.out is None:
        print(text, end="")
    else:
        write(options.out, text)
