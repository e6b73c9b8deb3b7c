"""The sections of runs of evolution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pandas as pd

from harness.ge.results import quartiles
from harness.report import charts
from harness.report.charts import Chart, Series
from harness.report.inputs import Run, Runs
from harness.report.markup import details, escape, facts, listed, note, plain_table, plus_minus
from harness.report.programs import changes, difference, listing
from harness.report.replays import Wanted

_FRESH = "the best on fresh episodes"
_MOST_IMPROVEMENTS = 12  # the largest are shown


def title(found: Run | Runs) -> str:
    """The section's heading."""
    first = found if isinstance(found, Run) else found.runs[0]
    many = f", {len(found.runs)} runs" if isinstance(found, Runs) else ""
    return f"Evolution on {first.config['domain']}{many}"


def body(found: Run | Runs) -> str:
    """Learning curve, best program and where it comes from."""
    if isinstance(found, Run):
        return (
            _unfinished([found])
            + _curve(found)
            + _winner(found, "Best program")
            + _acts(found)
            + _front(found)
            + _finalists(found)
            + _improvements(found)
        )
    done = [run for run in found.runs if run.best is not None]
    return "".join(
        [
            _unfinished(found.runs),
            _curves(found),
            _scores(done) if done else "",
            _winner(best_of(found), f"Best program: of {best_of(found).name}"),
            _acts(best_of(found)),
            _front(best_of(found)),
            _improvements(best_of(found)),
            *(details(f"Program of {run.name}", _program(run)) for run in found.runs if run is not best_of(found)),
        ]
    )


def best_of(found: Run | Runs) -> Run:
    """The run whose winner did best among its finalists; its score on fresh episodes is not looked at for that."""
    if isinstance(found, Run):
        return found
    return max(found.runs, key=lambda run: run.best["validation"] if run.best else float("-inf"))


def wanted(found: Run | Runs, seed: int | None) -> list[Wanted]:
    """The winner, in the episodes that ``harness compare`` plays unless told otherwise."""
    run = best_of(found)
    if not run.program:
        return []
    config = run.config
    return [
        Wanted(
            label="best program" if isinstance(found, Run) else f"best program of {run.name}",
            domain=config["domain"],
            seed=seed or 0,
            horizon=config["parameters"]["horizon"],
            program=run.program,
            model_hash=config["model_hash"],
        )
    ]


def _unfinished(runs: Sequence[Run]) -> str:
    open_runs = [run for run in runs if run.best is None]
    return "".join(
        note(
            f"{run.name} has not finished: {len(run.history)} of {run.config['parameters']['generations'] + 1} "
            "generations are in its history."
        )
        for run in open_runs
    )


def _curve(run: Run) -> str:
    history = run.history
    if history.empty:
        return ""
    series = [
        Series(_selected(run), history["best"]),
        Series.with_error(f"{_FRESH}, 95 % interval", history["test"], history["test_sem"]),
    ]
    return _figure("Learning curve", history["generation"], series)


def _curves(found: Runs) -> str:
    history = pd.concat([run.history for run in found.runs], ignore_index=True)
    if history.empty:
        return ""
    series = [_quartiles(history, "best", _selected(found.runs[0])), _quartiles(history, "test", _FRESH)]
    x = quartiles(history, "best").index.to_series().reset_index(drop=True)
    return _figure(f"Learning curves: median and quartiles of {len(found.runs)} runs", x, series)


def _selected(run: Run) -> str:
    shaped = run.config["parameters"]["shaping"] != "none"
    return f"fitness of the best, as selection saw it{' (with shaping)' if shaped else ''}"


def _quartiles(history: pd.DataFrame, column: str, name: str) -> Series:
    curve = quartiles(history, column).reset_index(drop=True)
    return Series(name, curve["q50"], curve["q25"], curve["q75"])


def _figure(heading: str, x: pd.Series, series: Sequence[Series]) -> str:
    """The whole curve and, where the first generations would flatten the rest of it, its upper part too."""
    whole = Chart(heading, "generation", charts.RETURN, x, series, whole=True)
    bottom = charts.without_outliers(pd.concat([each.y for each in series]))
    upper = [] if bottom is None else [replace(whole, title=f"{heading}: the upper part", bottom=bottom)]
    return "".join(charts.figure(each) for each in [whole, *upper])


def _scores(runs: Sequence[Run]) -> str:
    head = ["seed", "fitness", "validation", "fresh", "± s.e.", "discounted", "± s.e.", "success", "statements"]
    rows = []
    for run in runs:
        best: Mapping[str, Any] = run.best or {}
        score = best["score"]
        figures = (best["validation"], score["mean"], score["sem"])
        more = (score["discounted_mean"], score["discounted_sem"])
        cells = ["" if x is None else f"{x:.2f}" for x in (best["fitness"], *figures, *more)]
        rows.append([run.seed, *cells, f"{score['success_rate']:.1%}", _length(run)])
    return plain_table("Winners of the runs", head, rows) + note(
        "fitness: in the last generation, whose episodes chose the program, so a lucky figure; validation: among the "
        "finalists, on other episodes; fresh: on episodes that nothing was chosen by."
    )


def _length(run: Run) -> str:
    """Statements of the winner, which the finalists' table knows."""
    if run.finalists is None:
        return ""
    return f"{run.finalists['length'].iloc[0]:.0f}"


def _winner(run: Run, heading: str) -> str:
    return f"<h3>{heading}</h3>{_program(run)}" if run.program else ""


def _program(run: Run) -> str:
    return (listing(run.program) if run.program else note("No program yet.")) + facts(_provenance(run))


def _provenance(run: Run) -> dict[str, object]:
    config, p = run.config, run.config["parameters"]
    scores: dict[str, object] = {}
    if run.best is not None:
        score, fitness, validation = (run.best[name] for name in ("score", "fitness", "validation"))
        scores = {
            "return on fresh episodes": f"{plus_minus(score['mean'], score['sem'])} ({score['episodes']:,} episodes)",
            "discounted": plus_minus(score["discounted_mean"], score["discounted_sem"]),
            "success": f"{score['success_rate']:.1%}",
            "fitness among the finalists": f"{validation:.2f} ({p['validation_episodes']:,} other episodes)",
            "fitness in the last generation": ""  # none of a program whose constants were tuned after it
            if fitness is None
            else f"{fitness:.2f} (chosen by these {p['episodes']:,} episodes: lucky)",
        }
    return {
        **scores,
        "domain": f"{config['domain']} (version {config.get('domain_version', '?')})",
        "grammar": config.get("grammar", ""),
        "seed": p["seed"],
        "parameters": listed({name: value for name, value in p.items() if name != "seed"}),
        "engine": config["engine"],
        "versions": listed(config.get("versions")),
        "git revision": config.get("git"),
        "date": config.get("date"),
    }


def _acts(run: Run) -> str:
    """The winner and its simplified twin, with how often each line acts."""
    if run.acts is None:
        return ""
    titles = {"best": "Which of its lines act how often", "simplified": "Without what changes nothing"}
    parts = []
    for name, title in titles.items():
        lines = run.acts[run.acts["program"] == name]
        counted = zip(lines["acts"], lines["line"], strict=True)
        shown = "\n".join(f"{f'{often:.2f}' if often else '':>7}  {escape(line)}" for often, line in counted)
        parts.append(details(f"{title}: {len(lines)} lines", f'<pre tabindex="0"><code>{shown}</code></pre>'))
    return "".join(parts) + note("Before each line: how often it acts in an episode, the mean of 1,000.")


def _front(run: Run) -> str:
    """The best of so many statements or fewer."""
    if run.front is None:
        return ""
    rows = [[row.length, f"{row.validation:.2f}", f"{row.validation_sem:.2f}"] for row in run.front.itertuples()]
    table = plain_table(
        "The best of so many statements or fewer, on episodes that no generation has seen",
        ["statements", "earns", "± s.e."],
        rows,
    )
    return table + "".join(
        details(f"{row.length} statements: {row.validation:.2f}", listing(str(row.program)))
        for row in run.front.itertuples()
    )


def _finalists(run: Run) -> str:
    if run.finalists is None:
        return ""
    columns = ["fitness", "validation", "validation_sem", "length"]
    rows = [[k + 1, *row] for k, row in enumerate(run.finalists[columns].values.tolist())]
    head = ["rank", "fitness", "validation", "± s.e.", "statements"]
    return details("The finalists", plain_table("Programs of the last generation, compared once more", head, rows))


def _improvements(run: Run) -> str:
    """How the program came about: what changed wherever its score on fresh episodes rose, the largest rises."""
    found = [{**each, "program": "\n".join(each["program"])} for each in run.improvements]
    if not found:
        return ""
    steps = [(old, new) for old, new in pairwise(found) if old["program"] != new["program"]]
    largest = sorted(steps, key=lambda step: step[0]["test"] - step[1]["test"])[:_MOST_IMPROVEMENTS]
    parts = [details(f"Generation {found[0]['generation']}: {found[0]['test']:.2f}", listing(found[0]["program"]))]
    parts += [_step(*step) for step in steps if step in largest]
    last = found[-1]["program"]
    if run.best is not None and run.program != last:
        parts.append(details(f"The winner: {changes(last, run.program)}", difference(last, run.program)))
    fewer = f"; the {len(largest)} largest of {len(steps)}" if len(largest) < len(steps) else ""
    return (
        "<h3>How it came about</h3>"
        + note(
            "Every generation's best plays the same fresh episodes. Below is what changed wherever their mean return "
            f"was higher than ever before{fewer}. The winner is chosen among the last generation, on other episodes."
        )
        + "".join(parts)
    )


def _step(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    heading = f"Generation {new['generation']}: {new['test']:.2f} ({new['test'] - old['test']:+.2f}), "
    heading += changes(old["program"], new["program"])
    return details(heading, difference(old["program"], new["program"]))
