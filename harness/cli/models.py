"""``julia``, ``export``, ``solve``: what needs a Julia."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from harness.cli.arguments import domain_argument, positive, positive_number
from harness.errors import HarnessError

SOLVERS = ("qmdp", "sarsop", "native-sarsop", "mdp")


def register(commands: Any) -> None:
    """Add the commands to the parser."""
    julia = commands.add_parser("julia", help="say what of Julia is set up; set it up; test it")
    julia.add_argument("task", nargs="?", choices=("status", "setup", "test"), default="status", help="default: status")
    julia.set_defaults(run=_julia)

    export = commands.add_parser("export", help="export domains from Julia as snapshots")
    export.add_argument("domain", nargs="*", metavar="DOMAIN", help="named domains (default: all)")
    export.add_argument("--out", type=Path, metavar="FOLDER", help="default: the package's own snapshots")
    export.set_defaults(run=_export)

    solve = commands.add_parser("solve", help="solve a domain in Julia")
    domain_argument(solve)
    solve.add_argument("solver", metavar="SOLVER", choices=SOLVERS, help=", ".join(SOLVERS))
    solve.add_argument(
        "--timeout", type=positive_number, metavar="S", help="seconds of sarsop or native-sarsop (default 600)"
    )
    solve.add_argument(
        "--precision", type=positive_number, metavar="P", help="stop when the bounds are this close (default 0.001)"
    )
    solve.add_argument(
        "--keep-used", type=positive, metavar="N", help="keep only the vectors that N simulated episodes act by"
    )
    solve.add_argument("--out", type=Path, metavar="FILE", help="default: DOMAIN.SOLVER.npz here")
    solve.set_defaults(run=_solve)


def _julia(options: argparse.Namespace) -> int:
    from harness import bridge

    if options.task == "setup":
        bridge.setup()
    if options.task == "test":
        return bridge.run_tests()
    checks = bridge.status()
    for check in checks:
        print(f"{'ok     ' if check.ok else 'MISSING'}  {check.name}: {check.text}")
    ready = all(check.ok for check in checks)
    print(f"\nEngine: --engine auto means '{'julia' if ready else 'tables'}' here.")
    return 0 if ready else 1


def _export(options: argparse.Namespace) -> None:
    from harness import bridge, registry
    from harness.model import domain

    for name in options.domain or bridge.instance_names():
        path = (options.out / f"{name}.npz") if options.out else registry.snapshot_path(name)
        made = bridge.export(name)
        domain.save(made, path)
        print(f"{path}: {name} version {made.version}, model {made.model_hash[:12]}, {path.stat().st_size:,} bytes")


def _solve(options: argparse.Namespace) -> None:
    from harness import registry
    from harness.play.trimming import only_used
    from harness.solver import julia
    from harness.solver import solution as solutions

    if options.keep_used and options.solver == "mdp":
        raise HarnessError("mdp is a bound and has no alpha vectors to keep")
    domain = registry.load(options.domain)
    limits = {name: value for name in ("timeout", "precision") if (value := getattr(options, name)) is not None}
    solution = julia.solve(domain, options.solver, limits)
    if options.keep_used:
        solution = only_used(domain, solution, options.keep_used)
    path = options.out or Path(f"{domain.name}.{options.solver}.npz")
    solutions.save(path, domain, solution)
    record, vectors = solution.record, len(solution.arrays.get("actions", []))
    found = ", ".join(f"{k} {v:.6g}" for k, v in record.items() if isinstance(v, float))
    print(f"{path}: {found}" + (f", {vectors} alpha vectors" if vectors else ""))
    if "stopped" in record:
        print(f"stopped early {record['stopped']}: these are the bounds reached by then")
    if vectors:
        print(f"score it: harness compare {options.domain} --policy alpha:{path}")
