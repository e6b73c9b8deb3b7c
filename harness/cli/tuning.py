"""``sweep`` and ``tune``: the numbers in a policy."""

from __future__ import annotations

import argparse
import inspect
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.cli.arguments import cluster_argument, domain_argument, episode_arguments, natural, positive
from harness.errors import HarnessError, quoted

if TYPE_CHECKING:
    import pandas as pd

    from harness.play.evaluation import Score
    from harness.tuning.outcome import Tuned

METHODS = ("gradient", "spsa", "score", "cmaes", "lines", "autodiff")
MEASURES = ("return", "discounted")

_SETTINGS = "SETTINGS"  # stands in the help for a text that takes the methods themselves


class _Help(argparse.RawDescriptionHelpFormatter):
    """Names the methods' settings where help is asked for, and only then: they take a second to load."""

    def add_text(self, text: str | None) -> None:
        super().add_text(_settings() if text == _SETTINGS else text)


def register(commands: Any) -> None:
    """Add the commands to the parser."""
    sweep = commands.add_parser("sweep", help="the return over one number of a policy")
    domain_argument(sweep, resumable=True)
    sweep.add_argument(
        "--policy",
        metavar="SPEC",
        help="a policy with a number: belief, program:FILE, a planner (pomcp, despot), a Tunable own.py:NAME",
    )
    sweep.add_argument("--parameter", metavar="NAME", help="which number, where the policy has several")
    sweep.add_argument("--from", dest="start", type=number, metavar="X", help="default: the number's lower bound")
    sweep.add_argument("--to", dest="stop", type=number, metavar="X", help="default: its upper bound")
    sweep.add_argument("--points", type=positive, metavar="N", help="default 51, with --log three a decade")
    sweep.add_argument("--log", action="store_const", const=True, help="steps of equal ratio: --from 10 --to 100000")
    episode_arguments(sweep, episodes="at each point (default 10000, of a planner 100)", resumable=True)
    _folder_arguments(sweep, "keep sweep.json, sweep.csv and sweep.png there")
    sweep.set_defaults(run=_sweep)

    tune = commands.add_parser(
        "tune", help="tune the numbers in a policy", formatter_class=_Help, epilog=_SETTINGS,
        description="Tune the numbers in a policy. The result is the best of the start and all that was visited.",
    )  # fmt: skip
    domain_argument(tune, resumable=True)
    tune.add_argument(
        "--policy",
        metavar="SPEC",
        help="the policy; its numbers are the start: belief:0.6, program:FILE, a Tunable own.py:NAME",
    )
    tune.add_argument("--method", choices=METHODS, help="default gradient")
    tune.add_argument("--measure", choices=MEASURES, help="what to maximise (default: return, undiscounted)")
    episode_arguments(tune, resumable=True)
    tune.add_argument("--set", action="append", type=setting, default=[], metavar="NAME=X", help="a setting, see below")
    _folder_arguments(tune, "keep config.json, history.csv and result.json there; of a program also best.txt")
    tune.set_defaults(run=_tune)


def _folder_arguments(parser: argparse.ArgumentParser, text: str) -> None:
    cluster_argument(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--out", type=Path, metavar="DIR", help=text)
    where.add_argument("--resume", type=Path, metavar="DIR", help="go on with the run there")


def _settings() -> str:
    """The settings of each method with their defaults, for the help."""
    from harness.tuning.method import settings_of
    from harness.tuning.run import COUNTS, METHODS

    lines = ["settings (--set NAME=X), with their defaults:"]
    known: dict[str, Mapping[str, float]] = {name: settings_of(kind) for name, kind in METHODS.items()}
    for name, defaults in {**known, "all": COUNTS}.items():
        text = " ".join(f"{setting}={value}" for setting, value in defaults.items())
        lines += textwrap.wrap(text, 88, initial_indent=f"  {name:<10}", subsequent_indent=" " * 12)
    return "\n".join(lines)


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not a number")
    return value


def setting(text: str) -> tuple[str, float]:
    """``NAME=X``: a name and a number, whole where it is written so."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not of the form NAME=X")
    return name, natural(value) if value.isdecimal() else number(value)


def _sweep(options: argparse.Namespace) -> None:
    folder = options.resume or options.out
    try:
        table = _swept(options)
    except KeyboardInterrupt:
        _say_how_to_go_on("sweep", options)
        raise
    print(_rows(table))
    if folder is not None:
        _draw_sweep(table, folder)


def _say_how_to_go_on(command: str, options: argparse.Namespace) -> None:
    """With what the folder does not bring: a domain's file, and a policy's code."""
    from harness.policy import names_code

    folder = options.resume or options.out
    if folder is not None:
        own = [options.domain] if Path(options.domain or "").suffix in (".jl", ".npz") else []
        own += ["--policy", options.policy] if options.policy and names_code(options.policy) else []
        print("harness: go on with: harness", command, "--resume", folder, *own, file=sys.stderr)


def _swept(options: argparse.Namespace) -> pd.DataFrame:
    from harness.tuning import sweeping

    named = ("parameter", "start", "stop", "points", "log", "episodes", "seed", "horizon")
    given = {name: value for name in named if (value := getattr(options, name)) is not None}
    execution = {"policy": options.policy, "engine": options.engine, "progress": True}
    if options.resume is not None:
        if given:
            raise HarnessError(
                f"--resume goes on with what {options.resume} was told; {next(iter(given))} cannot be changed "
                f"(only DOMAIN, --policy and --engine can be given)"
            )
        return sweeping.resume(options.resume, options.domain, **execution)
    if options.domain is None or options.policy is None:
        raise HarnessError("sweep needs a DOMAIN and a --policy (or --resume DIR)")
    return sweeping.sweep(options.domain, **given, **execution, out=options.out)


def _rows(table: pd.DataFrame) -> str:
    from tabulate import tabulate

    name = table.columns[1]
    best = table.iloc[int(table["mean"].argmax())]
    lines = [
        [f"{r[name]:g}", f"{r['mean']:.2f} ± {r['sem']:.2f}", f"{r['discounted_mean']:.2f} ± {r['discounted_sem']:.2f}"]
        for _, r in table.iterrows()
    ]
    headers = [name, "return", "discounted"]
    if "milliseconds" in table:
        headers.append("ms an action")
        lines = [[*line, f"{took:.3g}"] for line, took in zip(lines, table["milliseconds"], strict=True)]
    text = tabulate(lines, headers=headers, disable_numparse=True, stralign="right")
    by = f"{name} = {best[name]:g}" if "\n" in best["policy"] else best["policy"]
    return f"{text}\n\nhighest return: {best['mean']:.2f} ± {best['sem']:.2f} by {by}"


def _draw_sweep(table: pd.DataFrame, folder: Path) -> None:
    from harness.show import drawing
    from harness.tuning import figures, journal
    from harness.tuning.rows import SWEEP

    run = journal.read_parameters(folder, SWEEP)
    word = "program" if "\n" in run["policy"] else run["policy"].partition(":")[0]
    title = f"{word} on {run['domain']}, horizon {run['horizon']}"
    drawing.save(figures.sweep_figure(table, title), folder / "sweep.png")
    print(f"{folder / 'sweep.csv'} and sweep.png are written")


def _tune(options: argparse.Namespace) -> None:
    folder = options.resume or options.out
    named = ("method", "measure", "seed", "horizon")
    given = {name: value for name in named if (value := getattr(options, name)) is not None}
    for name, value in options.set:
        if name in _arguments_of_tune():
            mend = f"; use --{name}" if hasattr(options, name) and name != "domain" else ""
            raise HarnessError(f"{name} is no setting of a method{mend}")
        given[name] = value
    try:
        result = _run(options, given)
    except KeyboardInterrupt:
        _say_how_to_go_on("tune", options)
        raise
    print(_summary(result))
    if folder is not None:
        from harness.show import drawing

        drawing.save(result.plot(), folder / "history.png")
        more = ", best.txt" if (folder / "best.txt").exists() else ""
        print(f"{folder}: config.json, history.csv, history.png{more} and result.json are written")


def _arguments_of_tune() -> set[str]:
    """Those that are no setting of a method."""
    from harness.tuning.run import COUNTS, tune

    return set(inspect.signature(tune).parameters) - COUNTS.keys() - {"settings"}


def _run(options: argparse.Namespace, given: dict[str, Any]) -> Tuned:
    from harness.tuning import resume, tune

    if options.resume is not None:
        named = {name: value for name in ("domain", "policy") if (value := getattr(options, name)) is not None}
        return resume(options.resume, engine=options.engine, progress=True, **named, **given)
    if options.domain is None or options.policy is None:
        raise HarnessError("tune needs a DOMAIN and a --policy (or --resume DIR)")
    return tune(options.domain, options.policy, engine=options.engine, out=options.out, progress=True, **given)


def _summary(result: Tuned) -> str:
    from harness.tuning.outcome import brief

    run = result.config["run"]
    kind = "discounted" if run["measure"] == "discounted" else "undiscounted"
    points, episodes = len(result.history), result.history["episodes"].iloc[0]
    evaluations = "smooth returns" if run["method"] == "autodiff" else f"evaluations of {episodes:,} episodes"
    return "\n".join(
        [
            f"{run['method']} on {run['domain']} from {brief(run['policy'])}, {kind} return, seed {run['seed']}: "
            f"{points:,} {evaluations}",
            f"stopped: {result.stopped}",
            "",
            *(f"  {line}" for line in result.best.policy.splitlines()),
            *(
                f"  {what:<29} return {s.mean:.2f} ± {s.sem:.2f}   discounted {s.discounted_mean:.2f} ± "
                f"{s.discounted_sem:.2f}   ({s.episodes:,} episodes)"
                for what, s in _lines(result)
            ),
            _gain(result),
        ]
    )


def _lines(result: Tuned) -> list[tuple[str, Score]]:
    shown = [
        ("on the last training episodes", result.best.training),
        ("on fresh episodes", result.best.score),
        ("the start there", result.start.score),
    ]
    moved_on = result.ended.policy not in (result.best.policy, result.start.policy)
    return [*shown, ("the end of the method there", result.ended.score)] if moved_on else shown


def _gain(result: Tuned) -> str:
    gain = result.gain
    if not result.moved:
        return "the start was the best: nothing that was visited did better on the validation episodes"
    return (
        f"more than the start: {gain.mean:+.2f} ± {gain.sem:.2f}, discounted {gain.discounted_mean:+.2f} ± "
        f"{gain.discounted_sem:.2f} (paired, fresh episodes)"
    )
