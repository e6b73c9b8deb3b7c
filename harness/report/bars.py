"""Bars of a comparison: a policy's mean and its 95 % interval."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from harness.play.evaluation import Z95
from harness.report.markup import data, details, escape, note, plain_table, plus_minus
from harness.score import rendering

_FAR = 1.0  # times the highest value: a loss beyond this would flatten the other bars
_CUT = 0.25  # of the highest value: where the axis ends then
_ROOM = 0.03  # of the axis, beyond its ends


def figures(table: pd.DataFrame) -> str:
    """Undiscounted and discounted returns, each as bars; ``table`` is a comparison on one domain."""
    undiscounted = _figure(table, "", "Return", "undiscounted return (reward)")
    discounted = _figure(table, "discounted_", "Discounted return", "discounted return (reward)")
    return f'<div class="pair">{undiscounted}{discounted}</div>'


def _figure(table: pd.DataFrame, prefix: str, title: str, label: str) -> str:
    """One of the two; rows without a mean are left out."""
    known = table[np.isfinite(table[f"{prefix}mean"])]
    if known.empty:
        return ""
    mean, sem = (known[f"{prefix}{column}"].astype(float) for column in ("mean", "sem"))
    ends = pd.DataFrame({"y": mean, "low": mean - Z95 * sem, "high": mean + Z95 * sem})
    names = rendering.shown(known)["policy"].tolist()
    low, high = scale(ends)
    bars = [_bar(*each) for each in zip(names, known["kind"], mean, sem, ends.to_numpy().tolist(), strict=True)]
    record = {"title": title, "label": label, "low": low, "high": high, "bars": bars}
    beyond = note("Bars that fade out on the left are longer than is shown.") if (mean < low).any() else ""
    rows = [[name, *row] for name, row in zip(names, ends.to_numpy().tolist(), strict=True)]
    numbers = plain_table(f"{title}: {label}", ["policy", "mean, 95 % interval", "from", "to"], rows)
    inside = f"<figcaption>{escape(title)}, 95 % interval</figcaption>{data(record)}{beyond}"
    return f'<figure class="comparison">{inside}{details("Numbers of this chart", numbers)}</figure>'


def _bar(name: str, kind: str, mean: float, sem: float, ends: list[float]) -> dict[str, Any]:
    text = plus_minus(mean, sem) if np.isfinite(sem) else f"{mean:.2f}"
    y, low, high = (float(f"{x:.6g}") if np.isfinite(x) else None for x in ends)
    return {"name": name, "bound": kind != "policy", "text": text, "y": y, "low": low, "high": high}


def scale(ends: pd.DataFrame) -> tuple[float, float]:
    """Where an axis begins and stops: around 0 and all that is in ``ends``, but for losses that flatten the rest."""
    values = ends.to_numpy()[np.isfinite(ends.to_numpy())]
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    if low < -_FAR * high < 0:
        low = -_CUT * high
    if low == high:
        return low, high + 1.0
    room = _ROOM * (high - low)
    return low - room if low < 0 else low, high + room if high > 0 else high
