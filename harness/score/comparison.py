"""The comparison table: many policies on one domain, each a row with its uncertainty and origin."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pandas as pd
from tabulate import tabulate
from tqdm.auto import tqdm

from harness import engine as engines
from harness import policy as specs
from harness import registry
from harness.model.domain import Domain
from harness.play.evaluation import EPISODES, HORIZON, Evaluation, Score, evaluate
from harness.policy import Policy
from harness.score import published
from harness.solver import solution

COLUMNS = (
    "domain",
    "domain_version",
    "policy",
    "kind",
    "engine",
    "episodes",
    "seed",
    "horizon",
    *Score._fields[1:],
    "reference",
)
"""Columns of the table; ``kind`` is ``policy`` or ``upper bound``, ``reference`` the published figure or None."""

BOUND = "mdp"


def compare(
    domain: Domain | str,
    policies: Sequence[str | Policy] | None = None,
    *,
    episodes: int | None = None,
    seed: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    workers: int | None = None,
    progress: bool = False,
) -> pd.DataFrame:
    """Score policies on a domain side by side.

    Args:
        domain: a domain or its name. Scores are of the true reward, whatever the domain's shaping.
        policies: policy strings or policy objects; by default all that the domain knows, with the bound ``mdp``.
        episodes: of every policy; by default 10,000, and 1,000 for policies that plan by simulation (``rollout``).
        seed: all policies meet the same initial states and the same random numbers.
        horizon: steps after which an episode is truncated.
        engine: ``tables``, ``julia`` or ``auto``.
        workers: threads of the tables engine.
        progress: show a progress bar for each policy that takes longer than two seconds.

    Returns:
        One row a policy, columns :data:`COLUMNS`.

    Raises:
        HarnessError: something in the arguments is wrong; nothing is run before all of them have been checked.
        Interrupted: Ctrl-C was pressed; its ``table`` holds the rows finished by then.
    """
    domain = (registry.load(domain) if isinstance(domain, str) else domain).shaped("none")
    engine = engines.choose(engine, domain)
    chosen = list(policies) if policies is not None else [*specs.default_specs(domain), *_bounds(domain)]
    made = [(p, None) if p == BOUND else specs.named(p, domain) for p in chosen]
    rows: list[dict[str, Any]] = []
    try:
        for name, policy in made:
            if policy is None:
                rows.append(_bound_row(domain, horizon))
                continue
            count = episodes or min(EPISODES, getattr(policy, "max_episodes", EPISODES))
            hide = None if progress else True  # None: show it on a terminal only
            with tqdm(total=count, desc=name, unit="episode", delay=2, leave=False, disable=hide) as bar:
                result = evaluate(
                    domain,
                    policy,
                    episodes=count,
                    seed=seed,
                    horizon=horizon,
                    engine=engine,
                    workers=workers,
                    progress=bar.update,
                )
            rows.append(_row(result, name))
    except KeyboardInterrupt:
        raise Interrupted(_table(rows)) from None
    return _table(rows)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a comparison; ``table`` holds the rows finished by then."""

    def __init__(self, table: pd.DataFrame) -> None:
        """``table``: as :func:`compare` would return it."""
        super().__init__()
        self.table = table


def _table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _bounds(domain: Domain) -> list[str]:
    return [BOUND] if registry.policy_path(domain.name, BOUND).exists() else []


def _row(result: Evaluation, name: str) -> dict[str, Any]:
    domain = result.domain
    return {
        "domain": domain.name,
        "domain_version": domain.version,
        "policy": name,
        "kind": "policy",
        "engine": result.engine,
        "seed": result.seed,
        "horizon": result.horizon,
        **result.score._asdict(),
        "reference": _reference(domain.name, name),
    }


def _reference(domain: str, policy: str) -> dict[str, Any] | None:
    entry = published.reference(domain, policy)
    if entry is None:
        return None
    return {"discounted_mean": entry.value, "error": entry.error, "source": entry.source}


def _bound_row(domain: Domain, horizon: int) -> dict[str, Any]:
    record = solution.read(registry.policy_path(domain.name, BOUND), domain, solution.BOUND_KIND).record
    within = record["undiscounted"] if record["horizon"] == horizon else None
    return {
        "domain": domain.name,
        "domain_version": domain.version,
        "policy": BOUND,
        "kind": "upper bound",
        "horizon": horizon,
        "mean": within,
        "discounted_mean": record["discounted"],
    }


def render(table: pd.DataFrame, style: str) -> str:
    """The table as ``table`` (for people), ``markdown``, ``csv`` or ``json`` (a list of rows)."""
    if style == "csv":
        flat = table.assign(reference=table["reference"].map(_brief))
        return flat.to_csv(index=False)
    if style == "json":
        return json.dumps(rows(table), indent=2) + "\n"
    cells = shown(table)
    form = "github" if style == "markdown" else "simple"
    text = tabulate(
        cells.values.tolist(),
        headers=[str(name) for name in cells],
        tablefmt=form,
        colalign=("left", *["right"] * 6),
        disable_numparse=True,
    )
    return f"{heading(table)}\n\n{text}\n\n{footnote(table)}\n"


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The table's cells as text for people; ± is one standard error."""
    return pd.DataFrame(
        {
            "policy": table["policy"].where(table["kind"] == "policy", table["policy"] + " (upper bound)"),
            "return": [_plus_minus(*pair) for pair in zip(table["mean"], table["sem"], strict=True)],
            "discounted": [
                _plus_minus(*pair) for pair in zip(table["discounted_mean"], table["discounted_sem"], strict=True)
            ],
            "published": table["reference"].map(_brief),
            "steps": table["steps_mean"].map(lambda x: _number(x, ".1f")),
            "success": table["success_rate"].map(lambda x: _number(x, ".1%")),
            "episodes": table["episodes"].map(lambda x: _number(x, ",.0f")),
        }
    )


def rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The table's rows as plain Python values, None where there is no value."""
    plain = table.astype(object).where(table.notna(), None)
    return [{str(key): value for key, value in row.items()} for row in plain.to_dict("records")]


def heading(table: pd.DataFrame) -> str:
    """What all rows have in common: domain, horizon, engine, seed."""
    first = table.iloc[0]
    run = table[table["kind"] == "policy"]
    engine = f", engine {run['engine'].iloc[0]}, seed {run['seed'].iloc[0]:.0f}" if len(run) else ""
    return f"{first['domain']} (version {first['domain_version']}), horizon {first['horizon']}{engine}"


def footnote(table: pd.DataFrame) -> str:
    """What the columns of :func:`shown` mean, and published figures of methods that are not among the rows."""
    lines = [
        "return: undiscounted, mean ± standard error; discounted: the same at the domain's discount; success: share of "
        "episodes that\nreached a terminal state.",
    ]
    if table["reference"].map(_brief).any():
        lines[0] += " published: discounted (Silver and Veness 2010)."
    others = published.not_run_here(table["domain"].iloc[0], table["policy"].tolist())
    if others:
        figures = ", ".join(f"{p.method} {_plus_minus(p.value, p.error)}" for p in others)
        lines.append(f"Published, not run here (discounted): {figures}.")
    return "\n".join(lines)


def _plus_minus(mean: float | None, error: float | None) -> str:
    if error is None or pd.isna(error):
        return _number(mean, ".2f")
    return f"{_number(mean, '.2f')} ± {error:.2f}"


def _number(value: float | None, form: str) -> str:
    return "" if value is None or pd.isna(value) else format(value, form)


def _brief(reference: Any) -> str:
    if isinstance(reference, str):  # read back from CSV
        return reference
    return _plus_minus(reference["discounted_mean"], reference["error"]) if isinstance(reference, dict) else ""
