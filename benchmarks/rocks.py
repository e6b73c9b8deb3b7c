"""What solving costs as the number of rocks grows: seconds and memory until the bounds are within 1 % of each other.

    python -m benchmarks.rocks --rocks 4,6,8,10,11 [--seconds 120] [--memory 4]

The board is that of rocksample-11x11 with the first so many of its rocks, and a twelfth one of ours.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path

from tabulate import tabulate

import harness

sys.path.append(str(Path(__file__).parent.parent))
from tests import models

TWELFTH = (8, 7)


def board(rocks: int) -> harness.Domain:
    """RockSample on 11 × 11 cells with so many rocks, up to twelve."""
    layout = harness.load("rocksample-11x11").layout
    places = [(x - 1, y - 1) for x, y in [*layout["rocks"], TWELFTH][:rocks]]
    return models.rocksample(layout["rows"], places, tuple(c - 1 for c in layout["start"]))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rocks", default="4,6,8,10,11,12")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--memory", type=float, default=4.0, help="GB")
    options = parser.parse_args()
    rows, counts = [], [int(text) for text in options.rocks.split(",")]
    for again, rocks in enumerate([min(counts), *counts]):  # the first one compiles
        seconds = options.seconds if again else 600.0
        history = harness.solve(board(rocks), gap=0.05, seconds=seconds, memory=options.memory).history
        near = history[history["upper"] - history["lower"] <= 0.01 * history["upper"]]
        last = (near if len(near) else history).iloc[0 if len(near) else -1]
        if again:
            shown = f"{last['seconds']:.2f}" if len(near) else f"> {last['seconds']:.0f}"
            rows.append([rocks, shown, last["megabytes"], last["nodes"], last["lower"], last["upper"]])
    growth = [f"{float(b[2]) / float(a[2]):.2f}" for a, b in itertools.pairwise(rows)]
    heads = ["rocks", "seconds to 1 %", "MB", "nodes", "lower", "upper"]
    print(tabulate(rows, heads, floatfmt=("g", "", ".0f", ".0f", ".4f", ".4f")))
    print(f"memory from one to the next: {', '.join(growth)}")


if __name__ == "__main__":
    main()
