"""The sections of tuning runs and of sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from harness.report import charts
from harness.report.charts import Chart, Series
from harness.report.inputs import Sweep, Tuning
from harness.report.markup import facts, listed, note, plain_table, plus_minus
from harness.report.programs import difference, listing
from harness.report.replays import Wanted
from harness.tuning.outcome import brief

_THETA = "theta_"
_SHOWN = ("domain", "policy", "method", "measure", "seed", "model_hash")  # by themselves


def sweep_title(sweep: Sweep) -> str:
    """The section's heading."""
    return f"Sweep of {_word(sweep)}: {sweep.frame.columns[1]}"


def _word(sweep: Sweep) -> str:
    return str(sweep.frame["policy"].iloc[0]).partition(":")[0]


def sweep_body(sweep: Sweep) -> str:
    """The return over the number: the whole range, and what lies near the top."""
    frame = sweep.frame
    name = str(frame.columns[1])
    best = frame.iloc[int(frame["mean"].argmax())]
    counts = sorted({int(n) for n in frame["episodes"]})
    episodes = " to ".join(f"{n:,}" for n in {counts[0]: 0, counts[-1]: 0})
    undiscounted = Series.with_error("mean, 95 % interval", frame["mean"], frame["sem"])
    discounted = Series.with_error("mean, 95 % interval", frame["discounted_mean"], frame["discounted_sem"])
    near = charts.near_the_top(frame["mean"])
    label = f"{name} (no unit)"
    figures = [Chart("Return", label, charts.RETURN, frame[name], [undiscounted], best=True)]
    if near is not None:
        figures.append(Chart("Near the top", label, charts.RETURN, frame[name], [undiscounted], near, best=True))
    figures.append(
        Chart("Discounted return", label, "discounted return (reward)", frame[name], [discounted], best=True)
    )
    highest = f"{plus_minus(best['mean'], best['sem'])} by {best['policy']}"
    if "milliseconds" in frame:
        figures.append(
            Chart(
                "Time",
                "milliseconds an action (of one core, on the machine that ran it)",
                charts.RETURN,
                frame["milliseconds"],
                [undiscounted],
            )
        )
    return facts({"highest return": highest, "episodes at each point": episodes}) + "".join(
        charts.figure(each) for each in figures
    )


def title(tuning: Tuning) -> str:
    """The section's heading."""
    run = tuning.config["run"]
    word = "a program" if _is_program(run["policy"]) else run["policy"].partition(":")[0]
    return f"Tuning of {word} on {run['domain']}"


def body(tuning: Tuning) -> str:
    """The result and what changed in it, what was played, and the path of the parameters."""
    history = tuning.history
    changed = _numbers(tuning) + _program(tuning)
    return _result(tuning) + changed + ("" if history.empty else _values(tuning, history) + _path(history))


def wanted(tuning: Tuning, seed: int | None) -> list[Wanted]:
    """The result and the start, in the episodes that ``harness compare`` plays unless told otherwise."""
    if tuning.result is None:
        return []
    run, result = tuning.config["run"], tuning.result["policy"]
    played = {result: "the result", run["policy"]: "the start"} if result != run["policy"] else {result: "the start"}
    return [
        Wanted(
            label=name if _is_program(policy) else f"{name}, {policy}",
            domain=run["domain"],
            seed=seed or 0,
            horizon=run["horizon"],
            spec="" if _is_program(policy) else policy,
            program=policy if _is_program(policy) else "",
            model_hash=run["model_hash"],
        )
        for policy, name in played.items()
    ]


def _is_program(policy: str) -> bool:
    """A policy string has no line end, and a program's text ends with one (:func:`harness.tuning.tunable.tunable`)."""
    return "\n" in policy


def _numbers(tuning: Tuning) -> str:
    """Every number that was tuned: what it was, and what it is now."""
    result = tuning.result
    if result is None or "gain" not in result:
        return ""
    old, new = result["start"]["theta"], result["theta"]
    moved = {name: new[name] - old[name] for name in new if name in old}
    rows = [[name, old[name], new[name], f"{by:+.4g}" if by else "none"] for name, by in moved.items()]
    order = "; c1, c2, … are the program's, in the order of its text" if _is_program(result["policy"]) else ""
    return plain_table(f"The numbers tuned{order}", ["number", "start", "result", "change"], rows)


def _program(tuning: Tuning) -> str:
    """The program, where it is one, and what changed in it."""
    policy = tuning.config["run"]["policy"] if tuning.result is None else tuning.result["policy"]
    if not _is_program(policy):
        return ""
    start = tuning.config["run"]["policy"]
    changed = "" if policy == start else f"<h3>What the tuning changed</h3>{difference(start, policy)}"
    return f"<h3>{'Program' if policy == start else 'Tuned program'}</h3>{listing(policy)}{changed}"


def _result(tuning: Tuning) -> str:
    run = tuning.config["run"]
    about = {
        "method": run["method"],
        "start": brief(run["policy"]),
        "measure": run["measure"],
        "seed": run["seed"],
        "parameters": listed({name: value for name, value in run.items() if name not in _SHOWN}),
        "engine": tuning.config.get("engine"),
        "versions": listed(tuning.config.get("versions")),
    }
    if tuning.result is None:
        return note("The run has not finished.") + facts(about)
    result = tuning.result
    return facts(
        {
            "result": brief(result["policy"]),
            "return on fresh episodes": _score(result["fresh"], ""),
            **(_beside(result) if "gain" in result else {}),  # a result of an older version has none
            "on the last training episodes": _score(result["training"], " (which the tuning has seen)"),
            "stopped": result["stopped"],
            **about,
        }
    )


def _beside(result: Mapping[str, Any]) -> dict[str, str]:
    """The start and the method's end beside the result, all on the same episodes."""
    start, ended, gain = result["start"], result["ended"], result["gain"]
    discounted = plus_minus(gain["discounted_mean"], gain["discounted_sem"])
    more = f"{plus_minus(gain['mean'], gain['sem'])}, discounted {discounted} (paired)"
    unmoved = result["policy"] == start["policy"]
    return {
        "more than the start": "nothing: the start was the best" if unmoved else more,
        "the start on the same episodes": _score(start["fresh"], ""),
        "where the method ended": "at the result" if ended["policy"] == result["policy"] else brief(ended["policy"]),
        "the end on the same episodes": _score(ended["fresh"], ""),
    }


def _score(score: dict[str, float], remark: str) -> str:
    discounted = plus_minus(score["discounted_mean"], score["discounted_sem"])
    return f"{plus_minus(score['mean'], score['sem'])}, discounted {discounted}, {score['episodes']:,} episodes{remark}"


def _values(tuning: Tuning, history: pd.DataFrame) -> str:
    discounted = tuning.config["run"]["measure"] == "discounted"
    y = "discounted return (reward)" if discounted else charts.RETURN
    series = [Series.with_error("points played, 95 % interval", history["value"], history["sem"], points=True)]
    bottom = charts.near_the_top(history["value"])
    return charts.figure(Chart("Returns", "iteration", y, history["iteration"], series, bottom, whole=True))


def _path(history: pd.DataFrame) -> str:
    each = history.drop_duplicates("iteration").reset_index(drop=True)
    names = [str(name) for name in each if str(name).startswith(_THETA)]
    series = [Series(name.removeprefix(_THETA), each[name]) for name in names]
    return charts.figure(
        Chart("Path of the parameters", "iteration", "value (no unit)", each["iteration"], series, whole=True)
    )
