"""``evolve``: grammatical evolution; ``grammar``: what it searches."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from harness.cli.arguments import cluster_argument, domain_argument, natural, positive
from harness.errors import HarnessError
from harness.ge.parameters import SAMPLED, Parameters

_KINDS = {int: natural, float: float, str: str}


def register(commands: Any) -> None:
    """Add the command to the parser."""
    evolve = commands.add_parser("evolve", help="evolve a program by grammatical evolution")
    domain_argument(evolve, resumable=True)
    evolve.add_argument(
        "--grammar", metavar="FILE", help="a BNF file or a shipped grammar (default: as harness grammar)"
    )
    evolve.add_argument("--out", type=Path, metavar="DIR", help="folder for the run's files, needed for a new run")
    evolve.add_argument("--resume", type=Path, metavar="DIR", help="go on with a run (with --generations: for longer)")
    evolve.add_argument(
        "--runs", type=positive, default=1, metavar="K", help="independent runs, with seeds from --seed on"
    )
    evolve.add_argument("--engine", help="tables, julia or auto (default tables: the same, faster)")
    evolve.add_argument("--workers", type=positive, metavar="N", help="threads of one run, processes of many")
    cluster_argument(evolve)
    evolve.add_argument(
        "--parameters", type=Path, metavar="FILE", help="a TOML file of the parameters below; options go before it"
    )
    evolve.add_argument("--allow-code", action="store_true", help="with --resume: load the file that the run is on")
    evolve.add_argument(
        "--preset",
        metavar="WORD",
        help="parameters to begin with: paper (Table 2, the default) or best; others go before it",
    )
    group = evolve.add_argument_group("parameters of the run (defaults: the paper's Table 2 where it gives one)")
    for f in fields(Parameters):
        option, help_text = f"--{f.name.replace('_', '-')}", f.metadata["help"]
        if isinstance(f.default, bool):
            group.add_argument(option, action="store_true", default=None, help=help_text)
            continue
        choices = f" ({', '.join(f.metadata['choices'])})" if f.metadata["choices"] else ""
        kind = _KINDS[type(f.default)]
        metavar = "WORD" if kind is str else "N"
        group.add_argument(option, type=kind, metavar=metavar, help=f"{help_text}{choices}; default {f.default}")
    evolve.set_defaults(run=_evolve)

    grammar = commands.add_parser(
        "grammar",
        help="print the grammar of a domain's programs",
        description="Print the grammar of a domain's programs as BNF, which evolve --grammar FILE takes: the one that "
        "was written by hand where there is one, else one derived from the domain's actions, readings and features.",
    )
    domain_argument(grammar)
    grammar.add_argument("--feedback", action="store_true", help="with blocks, loops and joined conditions")
    grammar.set_defaults(run=_grammar)


def _grammar(options: argparse.Namespace) -> None:
    from harness.ge import defaults

    print(defaults.grammar(options.domain, feedback=options.feedback), end="")


def _evolve(options: argparse.Namespace) -> None:
    from harness.ge import runs
    from harness.ge.results import Evolution

    given = {f.name: value for f in fields(Parameters) if (value := getattr(options, f.name)) is not None}
    if options.parameters is not None and options.resume is None:
        from harness.ge import parameter_file

        given = {**parameter_file.read(options.parameters), **given}
    execution = {"workers": options.workers, "progress": True}
    folder = options.resume or options.out
    try:
        if options.resume:
            _refuse_changes(options, given)
            result = runs.resume(
                options.resume, generations=given.get("generations"), allow_code=options.allow_code, **execution
            )
        else:
            if options.domain is None or options.out is None:
                raise HarnessError("evolve needs a DOMAIN and --out DIR for the run's files, or --resume DIR")
            result = runs.evolve(
                options.domain,
                options.grammar,
                runs=options.runs,
                out=options.out,
                engine=options.engine or "tables",
                preset=options.preset or "paper",
                **execution,
                **given,
            )
    except KeyboardInterrupt:
        if runs.begun(folder):
            own = options.allow_code or Path(options.domain or "").suffix in (".jl", ".npz")
            print(f"stopped; go on with: harness evolve --resume {folder}{' --allow-code' if own else ''}")
        raise
    if isinstance(result, Evolution):
        _report_one(result, folder)
    else:
        _report_many(result, folder)


def _refuse_changes(options: argparse.Namespace, given: dict[str, Any]) -> None:
    changed = [name for name in given if name != "generations"]
    changed += [
        name
        for name in ("domain", "grammar", "out", "engine", "preset", "parameters")
        if getattr(options, name) is not None
    ]
    changed += ["runs"] if options.runs != 1 else []
    if changed:
        raise HarnessError(
            f"--resume goes on with what {options.resume} was told; {changed[0].replace('_', '-')} cannot be changed "
            f"(only --generations, --workers and --cluster can)"
        )


def _report_one(result: Any, folder: Path) -> None:
    best, p = result.best, result.parameters
    score = best.score
    print(best.text)
    sampled = p.fitness == SAMPLED
    if best.fitness == best.fitness:  # else its constants were tuned after the last generation
        origin = f"chosen by these {p.episodes} episodes: lucky" if sampled else p.fitness
        print(f"fitness in the last generation   {best.fitness:9.2f}   ({origin})")
    origin = f"{p.validation_episodes:,} other episodes" if sampled else p.fitness
    print(f"fitness among the finalists      {best.validation:9.2f}   ({origin})")
    more = f"discounted {score.discounted_mean:.2f} ± {score.discounted_sem:.2f}, success {score.success_rate:.1%}"
    print(
        f"return on fresh episodes         {score.mean:9.2f} ± {score.sem:.2f}   ({score.episodes:,} episodes; {more})"
    )
    _print_front(result.front)
    _simplified(result, folder)
    print(f"\n{folder}: history.csv, best.txt, best.json, simplified.txt, acts.csv, front.csv, finalists.csv")
    print(f"score it: harness compare {result.domain} --policy program:{folder / 'best.txt'}")


def _print_front(front: Any) -> None:
    from tabulate import tabulate

    shown = front.assign(file=[f"front-{length}.txt" for length in front["length"]])
    heads = {"length": "statements", "validation": "earns", "validation_sem": "± s.e.", "file": "file"}
    print("\nThe best of so many statements or fewer, compared on episodes that no generation has seen:\n")
    print(tabulate(shown[list(heads)].values.tolist(), headers=list(heads.values()), floatfmt=".2f"))


def _simplified(result: Any, folder: Path) -> None:
    """The winner's twin without what changes nothing, and how often the lines of both act."""
    from harness.cli.arguments import write
    from harness.ge import simplifying

    program, p = result.best.program, result.parameters
    domain = program.words.domain.shaped("none")
    found = simplifying.simplify(domain, program, seed=p.seed, horizon=p.horizon, progress=True)
    write(folder / "simplified.txt", found.program.text)
    acts = simplifying.acts(domain, {"best": program, "simplified": found.program}, seed=p.seed, horizon=p.horizon)
    write(folder / "acts.csv", acts.to_csv(index=False, lineterminator="\n"))
    print(
        f"\nsimplified.txt: {found.program.length} statements for {found.original.length}, return {found.after:.4f} "
        f"for {found.before:.4f} (judged {found.how})"
    )


def _report_many(result: Any, folder: Path) -> None:
    from tabulate import tabulate

    shown = ["seed", "fitness", "validation", "mean", "sem", "discounted_mean", "success_rate", "length"]
    print(tabulate(result.table[shown].to_dict("list"), headers="keys", floatfmt=".2f"))
    low, middle, high = result.table["mean"].quantile([0.25, 0.5, 0.75])
    print(
        f"\nreturn on fresh episodes (mean): median {middle:.2f}, quartiles {low:.2f} and {high:.2f} over "
        f"{len(result.runs)} runs"
    )
    print(f"{folder}: runs.csv, curve.csv, and a folder for each run")
