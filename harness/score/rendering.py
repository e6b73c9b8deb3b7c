"""The comparison table as text: for people, for papers, for programs."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from html import escape
from typing import Any

import pandas as pd
from tabulate import tabulate

from harness.errors import HarnessError, nearest, quoted
from harness.score import published
from harness.score.aggregation import aggregate
from harness.score.table import DETAILS, DIFFERENCES, EXACT, HOW, INTERVAL, by_domain, check_columns

FORMATS = ("table", "markdown", "latex", "csv", "json")

_TABULATE = {"table": "simple", "markdown": "github", "latex": "latex_booktabs"}
_SMALL = 0.001  # p-values below are shown as such
_CLOCK = "A policy that is given a time (time=…ms) depends on the machine: its row does not come out again."
_DIFFERENCES = """less: mean difference over the episodes that both have met ± standard error; better: probability of
earning more in an episode (ties count half); p: two-sided paired t-test, adjusted by Holm for all of the table."""
_EXACTNESS = """exact: expected returns, computed and not sampled (harness.exact); interval: what they are proven to
lie between, where not all situations could be expanded."""
_OVERALL = """Over all domains, each scaled so that random-legal is 0 and the upper bound 1; in brackets 95 % intervals
(bootstrap of the episodes, stratified by domain):"""
COVERED = """Discounted returns over the domains that each policy plays. of optimum: share of the optimal value; scaled:
random-legal is 0 and the optimal value 1; middle half: without the best and the worst quarter of the domains. A figure
is what is proven at least, by the upper bound of the optimum; in brackets 95 % intervals (bootstrap of the episodes,
stratified by domain) that reach up to what its lower bound gives. "of 3": of so many domains only; the others have no
bounds, or no optimum above 0."""


def render(table: pd.DataFrame, format: str = "table") -> str:
    """A comparison table as the command ``harness compare`` prints it.

    Args:
        table: what :func:`harness.compare` returns.
        format: ``table`` (for people), ``markdown``, ``latex`` (for the package booktabs), ``csv`` or ``json`` (a
            list of rows). All but the last two end with the aggregate where there are several domains.

    Raises:
        HarnessError: there is no such format, or columns of the table are missing.
    """
    if format not in FORMATS:
        raise HarnessError(f"no format {quoted(format)}{nearest(format, FORMATS)} (known: {', '.join(FORMATS)})")
    check_columns(table)
    if format == "csv":
        flat = table.assign(reference=table["reference"].map(_brief))
        return flat.to_csv(index=False)
    if format == "json":
        return json.dumps(rows(table), indent=2) + "\n"
    blocks = [block for part in by_domain(table) for block in _blocks(part, format)]
    return "\n\n".join([*blocks, *_aggregate(table, format)]) + "\n"


def html(table: pd.DataFrame) -> str:
    """A comparison table for notebooks, without the footnotes."""
    return "".join(
        f"<p>{escape(heading(part))}</p>" + "".join(cells.to_html(index=False) for cells in _grids(part))
        for part in by_domain(table)
    )


def _blocks(part: pd.DataFrame, format: str) -> list[str]:
    """The paragraphs of one domain."""
    cells = [grid(each, format) for each in _grids(part)]
    return [remark(heading(part), format), *cells, remark(footnote(part), format)]


def _grids(part: pd.DataFrame) -> list[pd.DataFrame]:
    more = differences(part)
    return [shown(part), *([more] if len(more) else [])]


def _aggregate(table: pd.DataFrame, format: str) -> list[str]:
    """The paragraphs below the tables of several domains."""
    if table["domain"].nunique() < 2:
        return []
    try:
        cells = overall(aggregate(table))
    except HarnessError as reason:
        return [remark(f"No aggregate over the domains: {reason}.", format)]
    return [remark(_OVERALL, format), grid(cells, format)]


def grid(cells: pd.DataFrame, format: str) -> str:
    """Cells of text, the first column on the left."""
    text = tabulate(
        _prepared(cells, format).values.tolist(),
        headers=[str(name) for name in cells],
        tablefmt=_TABULATE[format],
        colalign=("left", *["right"] * (len(cells.columns) - 1)),
        disable_numparse=True,
    )
    if format != "latex":
        return text
    text = text.replace("±", r"$\pm$").replace("−", "$-$")
    return re.sub(r"^( *)\[", r"\1{[}", text, flags=re.MULTILINE)  # after \\ a bracket would be an argument of it


def _prepared(cells: pd.DataFrame, format: str) -> pd.DataFrame:
    """What tabulate leaves to us: pipes in Markdown, minus signs in LaTeX (it escapes the rest)."""
    if format == "markdown":
        return cells.map(lambda text: text.replace("|", "\\|"))
    if format == "latex":
        numbers = {name: cells[name].str.replace("-", "−") for name in cells.columns[1:]}
        return cells.assign(**numbers)
    return cells


def remark(text: str, format: str) -> str:
    """A heading or a footnote; in LaTeX a comment."""
    return "\n".join(f"% {line}" for line in text.splitlines()) if format == "latex" else text


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The table's cells as text for people; ± is one standard error."""
    return pd.DataFrame(
        {
            "policy": table["policy"].where(table["kind"] == "policy", table["policy"] + " (upper bound)"),
            "return": _means(table, ""),
            "discounted": _means(table, "discounted_"),
            "of optimum": [_share(*pair) for pair in zip(table["share_low"], table["share_high"], strict=True)],
            "published": table["reference"].map(_brief),
            "steps": table["steps_mean"].map(lambda x: _number(x, ".1f")),
            "success": table["success_rate"].map(lambda x: _number(x, ".1%")),
            "episodes": _episodes(table),
        }
    )


def _episodes(table: pd.DataFrame) -> pd.Series:
    """How many, or how else the returns are known."""
    shown = table["episodes"].map(lambda x: _number(x, ",.0f"))
    return shown.where(_known(table) == "", _known(table))


def _known(table: pd.DataFrame) -> pd.Series:
    """``exact``, ``interval``, or empty for what is sampled and for bounds."""
    if HOW not in table:
        return pd.Series("", index=table.index)
    return table[HOW].where(table[HOW].isin((EXACT, INTERVAL)), "")


def _means(table: pd.DataFrame, prefix: str) -> list[str]:
    """Means with their errors; bounds are rounded up, so that they stay bounds, and intervals outward."""
    means = table[f"{prefix}mean"].where(table["kind"] == "policy", table[f"{prefix}mean"].map(rounded_up))
    sampled = [_plus_minus(*pair) for pair in zip(means, table[f"{prefix}sem"], strict=True)]
    if HOW not in table:
        return sampled
    ends = zip(table[f"{prefix or 'ci_'}low"], table[f"{prefix or 'ci_'}high"], strict=True)
    cells = zip(_known(table), sampled, means, ends, strict=True)
    return [_cell(known, text, mean, *pair) for known, text, mean, pair in cells]


def _cell(known: str, sampled: str, mean: float, low: float, high: float) -> str:
    if known == EXACT:
        return f"{mean:.4f}"
    return f"{_rounded(low, 2, math.floor):.2f} to {_rounded(high, 2, math.ceil):.2f}" if known else sampled


def rounded_up(value: float | None, digits: int = 2) -> float | None:
    """The next number of so many digits that is not below."""
    return value if value is None or pd.isna(value) else _rounded(value, digits, math.ceil)


def _rounded(value: float, digits: int, way: Callable[[float], int]) -> float:
    scaled = value * 10**digits
    return way(scaled) / 10**digits if math.isfinite(scaled) else value  # a table's file may hold any number


def _share(low: float | None, high: float | None) -> str:
    ends = [_number(low, ".1%"), _number(high, ".1%")]
    return ends[0] if ends[0] == ends[1] else "–".join(ends)


def differences(table: pd.DataFrame) -> pd.DataFrame:
    """The cells of a comparison ``against`` one policy as text for people; empty where the table is none."""
    kept = table[table["against"].notna()] if set(DIFFERENCES) <= set(table) else table.iloc[:0]
    if kept.empty:
        return pd.DataFrame()
    other = kept["against"].iloc[0]
    cells: dict[str, Any] = {"policy": kept["policy"]}
    for prefix, title in (("", "return"), ("discounted_", "discounted")):
        pairs = zip(kept[f"{prefix}difference"], kept[f"{prefix}difference_sem"], strict=True)
        suffix = " (disc.)" if prefix else ""
        cells[f"{title} less {other}"] = [f"{difference:.3f} ± {sem:.3f}" for difference, sem in pairs]
        cells[f"better{suffix}"] = kept[f"{prefix}improvement"].map("{:.1%}".format)
        cells[f"p{suffix}"] = kept[f"{prefix}p_value"].map(lambda p: f"{p:.3f}" if p >= _SMALL else f"<{_SMALL}")
    return pd.DataFrame(cells)


def overall(table: pd.DataFrame) -> pd.DataFrame:
    """The cells of :func:`~harness.score.aggregation.aggregate` as text for people.

    Medians are shown of three domains and more: of two they are the mean.
    """
    cells: dict[str, Any] = {"policy": table["policy"]}
    for prefix, title in (("", "return"), ("discounted_", "discounted")):
        cells[title] = _intervals(table, f"{prefix}mean")
        if (table["domains"] > 2).any():
            cells[f"{title}, median"] = _intervals(table, f"{prefix}median")
    return pd.DataFrame(cells)


def covered(table: pd.DataFrame) -> pd.DataFrame:
    """The cells of :func:`~harness.score.aggregation.coverage` as text for people.

    Means of the middle half are shown where there are four domains and more: of fewer they are the means. The scale is
    shown where it is of more domains than the share, which an optimum below 0 has none of.
    """
    cells: dict[str, Any] = {"policy": table["policy"], "domains": table["played"].map(str)}
    measures = {"share": "of optimum", "scale": "scaled"}
    if (table["scale_domains"] <= table["share_domains"]).all():
        del measures["scale"]
    for measure, title in measures.items():
        cells[title] = _intervals(table, f"{measure}_mean")
        if (table[f"{measure}_domains"] > 3).any():
            cells[f"{title}, middle half"] = _intervals(table, f"{measure}_iqm")
        partly = table[f"{measure}_domains"] < table["played"]
        of = [f" of {count}" if part else "" for count, part in zip(table[f"{measure}_domains"], partly, strict=True)]
        cells[title] = [text + more if text else "" for text, more in zip(cells[title], of, strict=True)]
    return pd.DataFrame(cells)


def _intervals(table: pd.DataFrame, name: str) -> list[str]:
    values = zip(table[name], table[f"{name}_low"], table[f"{name}_high"], strict=True)
    return ["" if pd.isna(value) else f"{value:.3f} [{low:.3f}, {high:.3f}]" for value, low, high in values]


def rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The table's rows as plain Python values, None where there is no value."""
    plain = table.astype(object).where(table.notna(), None)
    return [{str(key): value for key, value in row.items()} for row in plain.to_dict("records")]


def heading(table: pd.DataFrame) -> str:
    """What all rows have in common: domain, horizon, engine, seed."""
    first = table.iloc[0]
    run = table[table["kind"] == "policy"]
    run = run[run["engine"].notna()]
    engine = f", engine {run['engine'].iloc[0]}, seed {run['seed'].iloc[0]:.0f}" if len(run) else ""
    return f"{first['domain']} (version {first['domain_version']}), horizon {first['horizon']}{engine}"


def footnote(table: pd.DataFrame) -> str:
    """What the columns of :func:`shown` mean, and published figures of methods that are not among the rows."""
    lines = [
        "return: undiscounted, mean ± standard error; discounted: the same at the domain's discount; success: share of "
        "episodes that\nreached a terminal state.",
    ]
    if table["reference"].map(_brief).any():
        lines[0] += f" published: discounted{_sources(table['reference'])}."
    lines += _about_optimum(table)
    if (_known(table) != "").any():
        lines.append(_EXACTNESS)
    if len(differences(table)):
        lines.append(_DIFFERENCES)
    if table["policy"].astype(str).str.contains("[:,]time=[0-9]+ms").any():
        lines.append(_CLOCK)
    lines += _details(table)
    first = table.iloc[0]
    others = published.not_run_here(first["domain"], table["policy"].tolist(), first["horizon"])
    if others and first["domain_version"]:  # 0: a user's model, which may bear the name of one of ours
        figures = ", ".join(f"{p.method} {_plus_minus(p.value, p.error)}" for p in others)
        lines.append(f"Published, not run here (discounted): {figures}.")
    return "\n".join(lines)


def _sources(references: pd.Series) -> str:
    """Authors and years, in brackets; nothing where the table was read back from CSV, which has figures only."""
    found = [each["source"].partition(",")[0] for each in references if isinstance(each, dict)]
    return f" ({'; '.join(dict.fromkeys(found))})" if found else ""


def _details(table: pd.DataFrame) -> list[str]:
    if DETAILS not in table:
        return []
    told = table[table[DETAILS].notna()]
    return [f"{row.policy}: {row.details}" for row in told.itertuples()]


def _about_optimum(table: pd.DataFrame) -> list[str]:
    known = table[["optimum_low", "optimum_high"]].astype(float).dropna()
    if known.empty:
        return []
    low, high = outward(*known.iloc[0])
    return [
        f"of optimum: discounted over the optimal value, which is proven to lie between {low} and {high}; a mean's own "
        "error\ncan take it above 100 %."
    ]


def outward(low: float, high: float) -> tuple[str, str]:
    """Two bounds as text of four decimals, rounded so that they stay bounds."""
    return f"{_rounded(low, 4, math.floor):.4f}", f"{_rounded(high, 4, math.ceil):.4f}"


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
