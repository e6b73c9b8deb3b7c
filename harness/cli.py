"""The ``harness`` command: nothing but the handling of arguments."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from harness.errors import HarnessError

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("table", "markdown", "csv", "json")
SOLVERS = ("qmdp", "sarsop", "native-sarsop", "mdp")


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

    compare = commands.add_parser("compare", help="score policies on a domain side by side")
    _domain_argument(compare)
    compare.add_argument(
        "--policy", action="append", metavar="SPEC", help="a policy, as often as wanted (default: all of the domain's)"
    )
    compare.add_argument("--episodes", type=_positive, metavar="N", help="default: 10000, for rollout 1000")
    _episode_arguments(compare)
    compare.add_argument("--format", choices=FORMATS, default="table", help="default: table")
    compare.add_argument("--out", type=Path, metavar="FILE", help="write there instead of to the terminal")
    compare.set_defaults(run=_compare)

    domains = commands.add_parser("domains", help="list the domains with sizes and provenance")
    domains.set_defaults(run=_domains)

    policies = commands.add_parser("policies", help="list the policies of a domain")
    _domain_argument(policies)
    policies.set_defaults(run=_policies)

    show = commands.add_parser("show", help="replay one episode step by step")
    _domain_argument(show)
    show.add_argument("policy", metavar="POLICY", help="a policy, such as belief:0.84")
    show.add_argument("--episode", type=_natural, default=0, metavar="K", help="which episode of the seed (default 0)")
    _episode_arguments(show)
    show.set_defaults(run=_show)

    check = commands.add_parser("check-domain", help="check a domain, and an engine against it")
    _domain_argument(check)
    check.add_argument("--engine", default="auto", help="auto, tables or julia (default auto)")
    check.set_defaults(run=_check_domain)

    julia = commands.add_parser("julia", help="say what of Julia is set up; set it up; test it")
    julia.add_argument("task", nargs="?", choices=("status", "setup", "test"), default="status", help="default: status")
    julia.set_defaults(run=_julia)

    export = commands.add_parser("export", help="export domains from Julia as snapshots")
    export.add_argument("domain", nargs="*", metavar="DOMAIN", help="named domains (default: all)")
    export.add_argument("--out", type=Path, metavar="FOLDER", help="default: the package's own snapshots")
    export.set_defaults(run=_export)

    solve = commands.add_parser("solve", help="solve a domain in Julia")
    _domain_argument(solve)
    solve.add_argument("solver", metavar="SOLVER", choices=SOLVERS, help=", ".join(SOLVERS))
    solve.add_argument(
        "--timeout", type=_positive_number, metavar="S", help="seconds of sarsop or native-sarsop (default 600)"
    )
    solve.add_argument(
        "--precision", type=_positive_number, metavar="P", help="stop when the bounds are this close (default 0.001)"
    )
    solve.add_argument(
        "--keep-used", type=_positive, metavar="N", help="keep only the vectors that N simulated episodes act by"
    )
    solve.add_argument("--out", type=Path, metavar="FILE", help="default: DOMAIN.SOLVER.npz here")
    solve.set_defaults(run=_solve)
    return parser


def _domain_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("domain", metavar="DOMAIN", help="a named domain, a snapshot (.npz) or a Julia file (.jl)")


def _episode_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=_natural, default=0, metavar="N", help="default 0")
    parser.add_argument(
        "--horizon", type=_positive, default=50, metavar="N", help="steps an episode lasts (default 50)"
    )
    parser.add_argument("--engine", default="auto", help="auto, tables or julia (default auto)")


def _natural(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, 0 or more")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, 1 or more")
    return int(text)


def _positive_number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0")
    return value


# The commands import what they need when they run, so that --help and misuse answer at once.


def _compare(options: argparse.Namespace) -> None:
    from harness import comparison

    def write(table: pd.DataFrame) -> None:
        text = comparison.render(table, options.format)
        if options.out is None:
            print(text, end="")
        else:
            _write(options.out, text)

    try:
        table = comparison.compare(
            options.domain,
            options.policy,
            episodes=options.episodes,
            seed=options.seed,
            horizon=options.horizon,
            engine=options.engine,
            progress=True,
        )
    except comparison.Interrupted as stop:
        if len(stop.table):
            write(stop.table)
        raise
    write(table)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"cannot write {path}: {error.strerror}") from None


def _domains(options: argparse.Namespace) -> None:
    from tabulate import tabulate

    from harness import registry

    lines: list[list[Any]] = []
    for name in registry.names():
        d = registry.load(name)
        versions = d.provenance["versions"]
        source = f"{d.provenance['exported']}, Julia {versions['julia']}, POMDPs.jl {versions['POMDPs']}"
        sizes = (f"{d.n_states:,}", d.n_actions, d.n_observations, d.discount)
        lines.append([name, d.version, *sizes, ", ".join(d.shapings), source, d.title])
    headers = ["domain", "version", "states", "actions", "observations", "discount", "shapings", "exported", "what"]
    print(tabulate(lines, headers=headers, disable_numparse=True))


def _policies(options: argparse.Namespace) -> None:
    from tabulate import tabulate

    from harness import policy, registry

    print(tabulate(list(policy.specs(registry.load(options.domain)).items()), headers=["policy", "what it does"]))


def _show(options: argparse.Namespace) -> None:
    from harness.show import replay

    for block in replay(
        options.domain,
        options.policy,
        seed=options.seed,
        episode=options.episode,
        horizon=options.horizon,
        engine=options.engine,
    ):
        print(block, end="\n\n")


def _check_domain(options: argparse.Namespace) -> int:
    from harness.check import ConformanceError, check_domain

    try:
        check_domain(options.domain, options.engine)
    except ConformanceError as error:
        print(error)
        return 1
    print(f"{options.domain}: all checks passed")
    return 0


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
    from harness import bridge, domain, registry

    for name in options.domain or bridge.instance_names():
        path = (options.out / f"{name}.npz") if options.out else registry.snapshot_path(name)
        made = bridge.export(name)
        domain.save(made, path)
        print(f"{path}: {name} version {made.version}, model {made.model_hash[:12]}, {path.stat().st_size:,} bytes")


def _solve(options: argparse.Namespace) -> None:
    from harness import registry, solving
    from harness.policy import alpha

    domain = registry.load(options.domain)
    limits = {name: value for name in ("timeout", "precision") if (value := getattr(options, name)) is not None}
    solution = solving.solve(domain, options.solver, limits, options.keep_used)
    path = options.out or Path(f"{domain.name}.{options.solver}.npz")
    alpha.save(path, domain, solution)
    record, vectors = solution.record, len(solution.arrays.get("actions", []))
    found = ", ".join(f"{k} {v:.6g}" for k, v in record.items() if isinstance(v, float))
    print(f"{path}: {found}" + (f", {vectors} alpha vectors" if vectors else ""))
    if "stopped" in record:
        print(f"stopped early {record['stopped']}: these are the bounds reached by then")
    if vectors:
        print(f"score it: harness compare {options.domain} --policy alpha:{path}")
