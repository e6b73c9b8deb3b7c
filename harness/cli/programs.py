"""``simplify`` and ``controller``: a program without what changes nothing, and as a finite-state controller."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from harness.cli.arguments import domain_argument, natural, positive, write


def register(commands: Any) -> None:
    """Add the command to the parser."""
    simplify = commands.add_parser(
        "simplify",
        help="take out of a program what changes nothing",
        description="Take out of a program every statement, else part and condition without which it earns no less: by "
        "its expected return, or on episodes where that takes too long. Each line is shown with how often it acts.",
    )
    domain_argument(simplify)
    simplify.add_argument("program", metavar="PROGRAM", help="a program: program:FILE, ge, ge-feedback")
    simplify.add_argument("--episodes", type=positive, metavar="N", help="judge on so many, not by the expected return")
    simplify.add_argument("--seed", type=natural, default=0, metavar="N", help="of these episodes (default 0)")
    simplify.add_argument(
        "--horizon", type=positive, default=50, metavar="N", help="steps an episode lasts (default 50)"
    )
    simplify.add_argument("--workers", type=positive, metavar="N", help="threads (default: one a core)")
    simplify.add_argument("--out", type=Path, metavar="FILE", help="write the program there")
    simplify.set_defaults(run=_simplify)

    controller = commands.add_parser(
        "controller",
        help="write a program as a finite-state controller",
        description="Write a program that asks for no beliefs as a finite-state controller, a policy fsc:FILE.json.",
    )
    domain_argument(controller)
    controller.add_argument("program", metavar="PROGRAM", help="a program: program:FILE, ge, ge-feedback")
    controller.add_argument("--out", type=Path, metavar="FILE", required=True, help="the JSON file")
    controller.set_defaults(run=_controller)


def _simplify(options: argparse.Namespace) -> None:
    from harness import registry
    from harness.ge import simplifying

    domain = registry.load(options.domain)
    found = simplifying.simplify(
        domain,
        options.program,
        episodes=options.episodes,
        seed=options.seed,
        horizon=options.horizon,
        workers=options.workers,
        progress=True,
    )
    acts = simplifying.acting(domain, found.program, seed=options.seed, horizon=options.horizon)
    lines = found.program.text.splitlines()
    for line, often in zip(lines, acts, strict=True):
        print(f"{often:6.2f}  {line}" if line.endswith(")") else f"        {line}")
    print(
        f"\n{found.original.length} statements are now {found.program.length}; the return was {found.before:.4f} and "
        f"is {found.after:.4f} (judged {found.how}).\nBefore each line: how often it acts in an episode."
    )
    if options.out is not None:
        write(options.out, found.program.text)


def _controller(options: argparse.Namespace) -> None:
    from harness import files, registry
    from harness.expectation.chain import endless
    from harness.ge.simplifying import program_of
    from harness.policy import fsc
    from harness.policy.converting import controller_of

    domain = registry.load(options.domain)
    nodes = controller_of(program_of(domain, options.program), domain)
    files.replace_json(files.named(options.out), fsc.to_record(nodes, domain))
    found = f"{options.out}: {len(nodes.action):,} nodes"
    if domain.discount < 1:
        worth = endless(domain, fsc.FileController(domain, nodes))
        found += f"; discounted return without a horizon {worth.value:.4f}"
    print(found)
