"""``julia``, ``export``, ``solve``: what needs a Julia, and solving."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from harness.cli.arguments import domain_argument, positive, positive_number
from harness.errors import HarnessError, quoted

FORMATS = ("pomdp", "pomdpx")
OWN = "solved"
SOLVERS = ("qmdp", "sarsop", "native-sarsop", "mdp")


class _Solvers(tuple[str, ...]):
    """Names that a shell completes; a Julia file is a choice too."""

    def __contains__(self, text: object) -> bool:
        return super().__contains__(text) or str(text).endswith(".jl")


def register(commands: Any) -> None:
    """Add the commands to the parser."""
    julia = commands.add_parser("julia", help="say what of Julia is set up; set it up; test it")
    julia.add_argument("task", nargs="?", choices=("status", "setup", "test"), default="status", help="default: status")
    julia.set_defaults(run=_julia)

    export = commands.add_parser("export", help="export domains from Julia as snapshots, or any domain as a model file")
    export.add_argument(
        "domain", nargs="*", metavar="DOMAIN", help="named domains (default: all); with --format one, of any kind"
    )
    export.add_argument("--format", choices=FORMATS, help="write a model file, without Julia")
    export.add_argument(
        "--out", type=Path, metavar="PATH", help="a folder for snapshots (default: the package's own); with --format "
        "a file, packed if its name ends in .gz (default: DOMAIN.FORMAT here)",
    )  # fmt: skip
    export.set_defaults(run=_export)

    solve = commands.add_parser(
        "solve", help="find bounds of what there is to earn, and a policy that earns the lower one"
    )
    domain_argument(solve)
    solve.add_argument(
        "--solver", metavar="NAME", choices=_Solvers((OWN, *SOLVERS)), default=OWN,
        help=f"{OWN} (default; needs no Julia), or in Julia {', '.join(SOLVERS)}, or FILE.jl that ends in a solver",
    )  # fmt: skip
    solve.add_argument("--gap", type=positive_number, metavar="X", help="end when the bounds are this close (0.01)")
    solve.add_argument("--time", type=positive_number, metavar="S", help="end after so many seconds (in Julia 600)")
    solve.add_argument("--memory", type=positive_number, metavar="GB", help=f"the most that {OWN} may take (2)")
    solve.add_argument(
        "--keep-used",
        type=positive,
        metavar="N",
        help="of alpha vectors: keep those that N simulated episodes act by",
    )
    solve.add_argument(
        "--resume", type=Path, metavar="FILE", help=f"keep the state of {OWN} in FILE, and go on from it if it is there"
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
    if options.format:
        _export_model(options)
    else:
        _export_snapshots(options)


def _export_model(options: argparse.Namespace) -> None:
    from harness import formats, registry

    if len(options.domain) != 1:
        raise HarnessError("--format writes one domain at a time; name one DOMAIN")
    domain = registry.load(options.domain[0])
    path = options.out or Path(f"{domain.name.removesuffix('.' + options.format)}.{options.format}")
    if not path.name.removesuffix(".gz").endswith(f".{options.format}"):
        raise HarnessError(
            f"{quoted(path)} does not end in .{options.format} or .{options.format}.gz; give another --out"
        )
    lost = formats.write_model(domain, path)
    print(f"{path}: {domain.name} version {domain.version}, {path.stat().st_size:,} bytes")
    if lost:
        print(f"not in the file: {'; '.join(lost)}")


def _export_snapshots(options: argparse.Namespace) -> None:
    from harness import bridge, registry
    from harness.model import domain

    for name in options.domain or bridge.instance_names():
        path = (options.out / f"{name}.npz") if options.out else registry.snapshot_path(name)
        made = bridge.export(name)
        domain.save(made, path)
        print(f"{path}: {name} version {made.version}, model {made.model_hash[:12]}, {path.stat().st_size:,} bytes")


def _solve(options: argparse.Namespace) -> None:
    if options.solver == OWN:
        _solve_here(options)
    else:
        _solve_in_julia(options)


def _solve_here(options: argparse.Namespace) -> None:
    from tqdm import tqdm

    from harness.play.trimming import only_used
    from harness.solver import solution as solutions
    from harness.solver import solving

    limits = {"gap": options.gap, "memory": options.memory}
    with tqdm(desc=f"solving {options.domain}", bar_format="{desc} {elapsed} {postfix}", disable=None) as bar:
        bar.set_postfix_str("compiling, where this is the first time")

        def watch(seconds: float, lower: float, upper: float) -> None:
            bar.set_postfix_str(f"lower {lower:.4f} upper {upper:.4f}")

        given = {name: value for name, value in limits.items() if value is not None}
        solved = solving.solve(options.domain, seconds=options.time, resume=options.resume, watch=watch, **given)
    path, found = options.out or Path(f"{solved.domain.name}.{OWN}.npz"), solved.solution
    word = "graph" if found.kind == solutions.GRAPH_KIND else "alpha"
    if options.keep_used and word == "alpha":  # a graph holds nothing that its policy does not need
        found = only_used(solved.domain, found, options.keep_used)
    solutions.save(path, solved.domain, found)
    seconds = solved.history["seconds"].iloc[-1]
    print(f"{path}: lower {solved.lower:.6g}, upper {solved.upper:.6g}, {seconds:.1f} seconds; ended {solved.stopped}")
    print(f"score it: harness compare {options.domain} --policy {word}:{path}")


def _solve_in_julia(options: argparse.Namespace) -> None:
    from harness import registry
    from harness.play.trimming import only_used
    from harness.solver import julia
    from harness.solver import solution as solutions

    if options.keep_used and options.solver == "mdp":
        raise HarnessError("mdp is a bound and has no alpha vectors to keep")
    domain = registry.load(options.domain)
    if options.memory is not None:
        raise HarnessError(f"--memory is of the solver {OWN}; the solvers in Julia have none")
    if options.resume is not None:
        raise HarnessError(f"--resume is of the solver {OWN}; the solvers in Julia cannot go on from a file")
    given = {"timeout": options.time, "precision": options.gap}
    limits = {name: value for name, value in given.items() if value is not None}
    solution = julia.solve(domain, options.solver, limits)
    if options.keep_used:
        solution = only_used(domain, solution, options.keep_used)
    path = options.out or Path(f"{domain.name}.{Path(options.solver).stem}.npz")
    solutions.save(path, domain, solution)
    record, vectors = solution.record, len(solution.arrays.get("actions", []))
    found = ", ".join(f"{k} {v:.6g}" for k, v in record.items() if isinstance(v, float))
    print(f"{path}: {found}" + (f", {vectors} alpha vectors" if vectors else ""))
    if "stopped" in record:
        print(f"stopped early {record['stopped']}: these are the bounds reached by then")
    if vectors:
        print(f"score it: harness compare {options.domain} --policy alpha:{path}")
