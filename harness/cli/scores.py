"""``compare``, ``domains``, ``policies``, ``show``, ``check-domain``, ``check-policy``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.cli.arguments import (
    cluster_argument,
    domain_argument,
    engine_argument,
    episode_arguments,
    natural,
    positive,
    write,
)

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("table", "markdown", "latex", "csv", "json")


def register(commands: Any) -> None:
    """Add the commands to the parser."""
    compare = commands.add_parser("compare", help="score policies on a domain, or on several, side by side")
    domain_argument(compare, several=True)
    compare.add_argument(
        "--policy", action="append", metavar="SPEC", help="a policy, as often as wanted (default: all of the domain's)"
    )
    compare.add_argument(
        "--against", metavar="SPEC", help="a policy that every other one is compared with, episode by episode"
    )
    compare.add_argument(
        "--exact", action="store_true", help="compute expected returns instead of sampling them, where that is possible"
    )
    episode_arguments(compare, episodes="default: 10000, for rollout 1000")
    cluster_argument(compare)
    compare.add_argument("--format", choices=FORMATS, default="table", help="default: table")
    compare.add_argument("--out", type=Path, metavar="FILE", help="write there instead of to the terminal")
    compare.add_argument("--figure", type=Path, metavar="FILE", help="draw the returns too, as .png, .pdf or .svg")
    compare.set_defaults(run=_compare)

    domains = commands.add_parser("domains", help="list the domains with sizes and provenance")
    domains.set_defaults(run=_domains)

    policies = commands.add_parser("policies", help="list the policies of a domain")
    domain_argument(policies)
    policies.set_defaults(run=_policies)

    show = commands.add_parser("show", help="replay one episode step by step")
    domain_argument(show)
    show.add_argument("policy", metavar="POLICY", help="a policy, such as belief:0.84")
    show.add_argument("--episode", type=natural, default=0, metavar="K", help="which episode of the seed (default 0)")
    episode_arguments(show)
    show.set_defaults(run=_show)

    check = commands.add_parser("check-domain", help="check a domain, and an engine against it")
    domain_argument(check)
    engine_argument(check)
    check.set_defaults(run=_check_domain)

    check = commands.add_parser("check-policy", help="check that a policy acts alike in every batch and thread")
    domain_argument(check)
    check.add_argument("policy", metavar="POLICY", help="a policy, such as belief:0.84")
    check.add_argument("--episodes", type=positive, default=1000, metavar="N", help="default 1000")
    check.set_defaults(run=_check_policy)


def _compare(options: argparse.Namespace) -> None:
    from harness.score import comparison
    from harness.score.rendering import render

    if options.figure is not None:
        from harness.show import drawing, figures

        drawing.check_ending(options.figure)

    def put(table: pd.DataFrame) -> None:
        text = render(table, options.format)
        if options.out is None:
            print(text, end="")
        else:
            write(options.out, text)

    try:
        table = comparison.compare(
            options.domain,
            options.policy,
            against=options.against,
            episodes=options.episodes,
            seed=options.seed,
            horizon=options.horizon,
            engine=options.engine,
            exact=options.exact,
            progress=True,
        )
    except comparison.Interrupted as stop:
        if len(stop.table):
            put(stop.table)
        raise
    put(table)
    if options.figure is not None:
        drawing.save(figures.compare_figure(table), options.figure)


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
    from harness.show.replay import replay

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
    from harness.play.conformance import ConformanceError, check_domain

    try:
        check_domain(options.domain, options.engine)
    except ConformanceError as error:
        print(error)
        return 1
    print(f"{options.domain}: all checks passed")
    return 0


def _check_policy(options: argparse.Namespace) -> int:
    from harness.play.conformance import ConformanceError, check_policy

    try:
        check_policy(options.policy, options.domain, options.episodes)
    except ConformanceError as error:
        print(error)
        return 1
    print(f"{options.policy} on {options.domain}: all checks passed")
    return 0
