"""``sweep`` and ``tune``: the numbers in a policy."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.cli.arguments import domain_argument, episode_arguments, natural, positive
from harness.errors import HarnessError

if TYPE_CHECKING:
    import pandas as pd

    from harness.tuning.outcome import Tuned

METHODS = ("gradient", "spsa", "score", "cmaes", "lines")
MEASURES = ("return", "discounted")


def register(commands: Any) -> None:
    """Add the commands to the parser."""
    sweep = commands.add_parser("sweep", help="the return over one number of a policy")
    domain_argument(sweep)
    sweep.add_argument("--policy", required=True, metavar="SPEC", help="a policy with a number, such as belief")
    sweep.add_argument("--parameter", metavar="NAME", help="which number, where the policy has several")
    sweep.add_argument("--from", dest="start", type=number, metavar="X", help="default: the number's lower bound")
    sweep.add_argument("--to", dest="stop", type=number, metavar="X", help="default: its upper bound")
    sweep.add_argument("--points", type=positive, default=51, metavar="N", help="default 51")
    sweep.add_argument("--episodes", type=positive, default=10_000, metavar="N", help="at each point (default 10000)")
    episode_arguments(sweep)
    sweep.add_argument("--out", type=Path, metavar="DIR", help="write sweep.csv and sweep.png there")
    sweep.set_defaults(run=_sweep)

    tune = commands.add_parser("tune", help="tune the numbers in a policy")
    tune.add_argument("domain", nargs="?", metavar="DOMAIN", help="a domain; may be left out with --resume")
    tune.add_argument(
        "--policy", metavar="SPEC", help="the policy; its numbers are the start: belief:0.6, program:FILE"
    )
    tune.add_argument("--method", choices=METHODS, help="default gradient")
    tune.add_argument("--measure", choices=MEASURES, help="what to maximise (default: return, undiscounted)")
    tune.add_argument("--seed", type=natural, metavar="N", help="default 0")
    tune.add_argument("--horizon", type=positive, metavar="N", help="steps an episode lasts (default 50)")
    tune.add_argument("--engine", default="auto", help="auto, tables or julia (default auto)")
    tune.add_argument(
        "--set", action="append", type=setting, default=[], metavar="NAME=X", help="a setting of the method"
    )
    where = tune.add_mutually_exclusive_group()
    where.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="keep config.json, history.csv and result.json there; of a program also best.txt",
    )
    where.add_argument("--resume", type=Path, metavar="DIR", help="go on with the run there")
    tune.set_defaults(run=_tune)


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value


def setting(text: str) -> tuple[str, float]:
    """``NAME=X``: a name and a number, whole where it is written so."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form NAME=X")
    return name, int(value) if value.isdecimal() else number(value)


def _sweep(options: argparse.Namespace) -> None:
    from harness.tuning import sweep

    table = sweep(
        options.domain,
        options.policy,
        parameter=options.parameter,
        start=options.start,
        stop=options.stop,
        points=options.points,
        episodes=options.episodes,
        seed=options.seed,
        horizon=options.horizon,
        engine=options.engine,
        progress=True,
    )
    print(_rows(table))
    if options.out is not None:
        _keep_sweep(table, options)


def _rows(table: pd.DataFrame) -> str:
    from tabulate import tabulate

    name = table.columns[1]
    best = table.iloc[int(table["mean"].argmax())]
    lines = [
        [f"{r[name]:g}", f"{r['mean']:.2f} ± {r['sem']:.2f}", f"{r['discounted_mean']:.2f} ± {r['discounted_sem']:.2f}"]
        for _, r in table.iterrows()
    ]
    text = tabulate(lines, headers=[name, "return", "discounted"], disable_numparse=True, stralign="right")
    by = f"{name} = {best[name]:g}" if "\n" in best["policy"] else best["policy"]
    return f"{text}\n\nhighest return: {best['mean']:.2f} ± {best['sem']:.2f} by {by}"


def _keep_sweep(table: pd.DataFrame, options: argparse.Namespace) -> None:
    from harness import files
    from harness.show import drawing
    from harness.tuning import figures

    path = options.out / "sweep.csv"
    files.replace_text(path, table.to_csv(index=False, lineterminator="\n"))
    title = f"{options.policy.partition(':')[0]} on {options.domain}, horizon {options.horizon}"
    drawing.save(figures.sweep_figure(table, title), options.out / "sweep.png")
    print(f"{path} and sweep.png are written")


def _tune(options: argparse.Namespace) -> None:
    folder = options.resume or options.out
    named = ("method", "measure", "seed", "horizon")
    given = {name: value for name in named if (value := getattr(options, name)) is not None}
    for name, value in options.set:
        if hasattr(options, name) or name in ("workers", "progress"):
            raise HarnessError(f"{name} is no setting of a method{f'; use --{name}' if hasattr(options, name) else ''}")
        given[name] = value
    try:
        result = _run(options, given)
    except KeyboardInterrupt:
        if folder is not None:
            print(f"harness: go on with: harness tune --resume {folder}", file=sys.stderr)
        raise
    print(_summary(result))
    if folder is not None:
        from harness.show import drawing

        drawing.save(result.plot(), folder / "history.png")
        more = ", best.txt" if (folder / "best.txt").exists() else ""
        print(f"{folder}: config.json, history.csv, history.png{more} and result.json are written")


def _run(options: argparse.Namespace, given: dict[str, Any]) -> Tuned:
    from harness.tuning import resume, tune

    if options.resume is not None:
        named = {name: value for name in ("domain", "policy") if (value := getattr(options, name)) is not None}
        return resume(options.resume, engine=options.engine, progress=True, **named, **given)
    if options.domain is None or options.policy is None:
        raise HarnessError("tune needs a DOMAIN and a --policy (or --resume DIR)")
    return tune(options.domain, options.policy, engine=options.engine, out=options.out, progress=True, **given)


def _summary(result: Tuned) -> str:
    from harness.tuning.run import brief

    run, best = result.config["run"], result.best
    kind = "discounted" if run["measure"] == "discounted" else "undiscounted"
    points = len(result.history)
    return "\n".join(
        [
            f"{run['method']} on {run['domain']} from {brief(run['policy'])}, {kind} return, seed {run['seed']}: "
            f"{points:,} evaluations of {result.history['episodes'].iloc[0]:,} episodes",
            f"stopped: {result.stopped}",
            "",
            *(f"  {line}" for line in best.policy.splitlines()),
            *(
                f"  {what:<28} return {s.mean:.2f} ± {s.sem:.2f}   discounted {s.discounted_mean:.2f} ± "
                f"{s.discounted_sem:.2f}   ({s.episodes:,} episodes)"
                for what, s in (("on the last training episodes", best.training), ("on fresh episodes", best.score))
            ),
        ]
    )
