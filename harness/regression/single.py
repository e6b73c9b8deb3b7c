"""The check of one policy against a file of its own: what the pytest fixture does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tabulate import tabulate

from harness import engine as engines
from harness import policy as policies
from harness import registry
from harness.model.domain import Domain
from harness.policy import Policy
from harness.regression import reports, scoring, stored
from harness.regression.judging import Outcome, judge
from harness.regression.rows import AnyScore, Limits, Row, from_table
from harness.regression.scoring import Measurement, Task
from harness.score.table import EXACT, SAMPLED


def task(
    policy: Policy | str,
    domain: Domain | str,
    *,
    episodes: int,
    seed: int,
    horizon: int,
    engine: str,
    max_episodes: int | None,
    how: str = SAMPLED,
) -> Task:
    """A policy on a domain, either of which may be an object, and how it is scored.

    Raises:
        HarnessError: an argument is wrong.
    """
    loaded = (registry.load(domain) if isinstance(domain, str) else domain).shaped("none")
    name, made = policies.named(policy, loaded)
    chosen = engine if how == EXACT else engines.choose(engine, loaded)
    return Task(Row(loaded.name, name, episodes, seed, horizon, chosen, max_episodes, how), loaded, made)


def check(path: Path, task: Task, limits: Mapping[str, float], *, exact: bool, renew: bool) -> str | None:
    """Compare with the score stored in a file; None where it held, else what to tell.

    A missing file is written, and one that ``renew`` finds changed is written anew; both are told as failures, so that
    nobody takes a first run or a renewal for a pass.

    Raises:
        HarnessError: the file or an argument is wrong.
    """
    chosen = from_table(Limits, limits)
    who = f"{task.row.policy} on {task.row.domain}"
    if not path.exists():
        stored.write(path, [scoring.renew(task, None, chosen)])
        return f"{who}: no score was stored; now it is, in {path}\nRead it, commit it, and run again."
    before = _only(stored.read(path), task.row)
    if renew:
        usable = before.stored if before.fault is None else None
        after = scoring.renew(task, usable, chosen)
        if usable == after:
            return None
        stored.write(path, [after])
        return f"{who}: stored anew, in {path}\n{_side_by_side(usable, after)}\nRead it, commit it, and run again."
    measured = before if before.fault else scoring.measure(task, before.stored)
    (outcome,) = judge([measured], chosen, exact=exact)
    return None if outcome.passed else _message(path, outcome)


def _only(file: stored.ScoreFile, row: Row) -> Measurement:
    """The one stored score of a file that belongs to the row, not played yet; a fault where there is none."""
    mend = "run pytest --force-regen"
    found = list(file.stored_lines)
    if row.key in file.damaged:
        return Measurement(row, None, fault=("damaged", f"{file.damaged[row.key]}; {mend}"))
    if found != [row.key]:
        kept = (
            ", ".join(f"{policy} on {domain}, horizon {horizon}" for domain, policy, horizon, _ in found) or "nothing"
        )
        return Measurement(row, None, fault=("vanished", f"no score of it is stored, but {kept}; {mend}"))
    return Measurement(row, file.stored[row.key])


def _message(path: Path, outcome: Outcome) -> str:
    told = reports.sentence(outcome).replace("harness check --update", "pytest --force-regen")
    if outcome.stored is None or outcome.fresh is None:
        return f"{told}\n{path}"
    return (
        f"{told}\n{_side_by_side(outcome.stored, outcome.fresh)}\n"
        f"Stored in {path}; if the change is meant: pytest --force-regen"
    )


def _side_by_side(expected: AnyScore | None, obtained: AnyScore) -> str:
    lines = []
    for name in obtained.SHOWN:
        new = getattr(obtained, name)
        old = None if expected is None else getattr(expected, name)
        lines.append([name, f"{new:g}", "" if old is None else f"{old:g}", "" if old is None else f"{new - old:+g}"])
    return tabulate(lines, ["", "obtained", "expected", "difference"], disable_numparse=True, colalign=_ALIGN)


_ALIGN = ("left", "right", "right", "right")
