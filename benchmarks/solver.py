"""Seconds until the bounds of the optimal value are so close: our solver, beside APPL's pomdpsol and NativeSARSOP.jl.

    python -m benchmarks.solver --seconds 60 [--appl rocksample-7x8=RockSample_7_8.pomdpx] [--native] [--out FOLDER]

In the manner of COCO (Hansen et al. 2021): the time to targets, here gaps as shares of the upper bound, not the bounds
after a time. Compiled code is in the cache before the clock runs. NativeSARSOP.jl tells its bounds at the end only, so
that it is run anew for 1, 2, 4, … seconds. With ``--out`` also a table and a picture of all
bounds over the time.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from tabulate import tabulate

import harness
from harness.solver import julia

GAPS = (0.1, 0.03, 0.01, 0.003, 0.001)
OURS, APPL, NATIVE = "harness", "pomdpsol", "native-sarsop"
DOMAINS = ("rocksample-7x8", "rocksample-11x11", "rocksample-15x15", "bordercross-7x8", "bordercross-7x8-random")
_LINE = re.compile(r"^ *([\d.e+-]+) +\d+ +\d+ +([\d.e+-]+) +([\d.e+-]+) ")
"""Of pomdpsol: time, trials, backups, lower bound, upper bound"""


def ours(domain: str, seconds: float, memory: float) -> pd.DataFrame:
    """The history of solving a domain: ``seconds``, ``lower``, ``upper``."""
    harness.solve(domain, gap=1e9)  # compiles the beginning
    return harness.solve(domain, gap=1e-4, seconds=seconds, memory=memory).history


def appl(model: Path, seconds: float) -> pd.DataFrame:
    """What pomdpsol prints of a model file as it goes on."""
    command = ["pomdpsol", "--timeout", f"{seconds:g}", "--output", "/dev/null", str(model)]
    text = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    rows = [[float(each) for each in found.groups()] for found in map(_LINE.match, text.splitlines()) if found]
    return pd.DataFrame(rows, columns=["seconds", "lower", "upper"])


def native(domain: str, seconds: float) -> pd.DataFrame:
    """The bounds of NativeSARSOP.jl when it is given 1, 2, 4, … seconds."""
    limits = [2.0**k for k in range(20) if 2**k <= seconds]
    julia.solve(harness.load(domain), NATIVE, {"timeout": 1.0})  # compiles
    rows = [julia.solve(harness.load(domain), NATIVE, {"timeout": limit}).record for limit in limits]
    return pd.DataFrame(rows)[["seconds", "lower", "upper"]]


def times(history: pd.DataFrame) -> list[float]:
    """Seconds to each of :data:`GAPS`, NaN where it was not reached."""
    gap = (history["upper"] - history["lower"]) / history["upper"].abs()
    return [float(history["seconds"][gap <= target].min()) for target in GAPS]


def picture(runs: Mapping[tuple[str, str], pd.DataFrame]) -> Figure:
    """All bounds over the time, a panel a domain."""
    names = list(dict.fromkeys(domain for domain, _ in runs))
    figure = Figure(figsize=(6, 3 * len(names)), layout="constrained")
    for axes, name in zip(figure.subplots(len(names), squeeze=False)[:, 0], names, strict=True):
        for k, (domain, solver) in enumerate(runs):
            if domain == name:
                for bound in ("lower", "upper"):
                    history = runs[domain, solver]
                    label = solver if bound == "lower" else None
                    axes.step(history["seconds"], history[bound], where="post", color=f"C{k % 10}", label=label)
        axes.set(xscale="log", title=name, xlabel="seconds", ylabel="discounted value")
        axes.legend(frameon=False)
    return figure


def main() -> None:
    """Run, print, and write where asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--domain", action="append", help="default: all")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--memory", type=float, default=2.0, help="GB")
    parser.add_argument("--appl", action="append", default=[], metavar="DOMAIN=FILE", help="a model file of the domain")
    parser.add_argument("--native", action="store_true", help="NativeSARSOP.jl too, in Julia")
    parser.add_argument("--out", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    files = dict(each.split("=", 1) for each in options.appl)
    if files and not shutil.which("pomdpsol"):
        parser.error("pomdpsol is not on the PATH")
    runs = {}
    for domain in options.domain or DOMAINS:
        runs[domain, OURS] = ours(domain, options.seconds, options.memory)
        if domain in files:
            runs[domain, APPL] = appl(Path(files[domain]), options.seconds)
        if options.native:
            runs[domain, NATIVE] = native(domain, options.seconds)
    rows = [[*key, *times(run), run["lower"].iloc[-1], run["upper"].iloc[-1]] for key, run in runs.items() if len(run)]
    heads = ["domain", "solver", *(f"{gap:.1%}" for gap in GAPS), "lower", "upper"]
    print(tabulate(rows, heads, floatfmt=(*["g"] * 2, *[".2f"] * len(GAPS), ".4f", ".4f")))
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        picture(runs).savefig(options.out / "bounds.png", dpi=150)
        parts = [run.assign(domain=domain, solver=solver) for (domain, solver), run in runs.items()]
        pd.concat(parts).to_csv(options.out / "bounds.csv", index=False)


if __name__ == "__main__":
    main()
