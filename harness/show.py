"""One episode, step by step, as text: the grid, the action, the reading, the belief, the reward."""

from __future__ import annotations

from collections.abc import Iterator

from harness import engine as engines
from harness import policy as policies
from harness import registry
from harness.batch import Batch
from harness.domain import Domain
from harness.evaluation import HORIZON, simulate
from harness.policy import Policy

_BAR = 10  # characters of a belief bar


def replay(
    domain: Domain | str,
    spec: str | Policy,
    *,
    seed: int = 0,
    episode: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
) -> Iterator[str]:
    """Yield one block of text for the start, each step and the end of an episode.

    The episode is the one that ``compare`` and ``evaluate`` play under the same seed and number.

    Raises:
        HarnessError: the domain, policy or engine is unknown.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    engine = engines.choose(engine, domain)
    spec, policy = policies.named(spec, domain)
    policy_belief = getattr(policy, "uses_belief", True)
    total, discounted, weight, steps = 0.0, 0.0, 1.0, 0
    yield f"{domain.name}, policy {spec}, engine {engine}, seed {seed}, episode {episode}"
    for record in simulate(domain, policy, engine, seed, episode, 1, horizon):
        batch = record.batch
        if record.actions is None:
            title = f"start{_reading(batch)}"
        else:
            steps += 1
            total += record.rewards[0]
            discounted += weight * record.rewards[0]
            weight *= domain.discount
            action = domain.actions[record.actions[0]]
            title = f"step {steps}: {action}{_reading(batch)}, reward {record.rewards[0]:+g}, return {total:g}"
        body = [] if batch.done[0] else _side_by_side(_grid(batch), _belief(batch) if policy_belief else [])
        yield "\n".join([title, *body])
    ending = "reached a terminal state" if batch.done[0] else "was cut at the horizon"
    yield f"The episode {ending} after {steps} steps: return {total:g}, discounted {discounted:.2f}."


def _reading(batch: Batch) -> str:
    if batch.observation[0] < 0 or batch.domain.observations[batch.observation[0]] == "none":
        return ""
    return f", reading {batch.domain.observations[batch.observation[0]]}"


def _grid(batch: Batch) -> list[str]:
    """The domain drawn from its layout: one character a cell."""
    domain, layout = batch.domain, batch.domain.layout
    if layout["kind"] == "none":
        return []
    here = dict(zip(domain.visible_names, domain.visible_values[batch.visible[0]].tolist(), strict=True))
    marks: dict[tuple[int, int], str] = {}
    rows, columns = layout["rows"], layout["columns"]
    if layout["kind"] == "rocksample":
        columns = layout["exit_column"]
        marks |= {(columns, y): ">" for y in range(1, rows + 1)}
        marks |= {(x, y): _symbol(i) for i, (x, y) in enumerate(layout["rocks"])}
        marks[here["x"], here["y"]] = "R"
    else:
        marks |= {(layout["wall_column"], y): "X" for y in range(1, rows + 1)}
        marks |= {(layout["exit_column"], y): ">" for y in range(1, rows + 1)}
        for robot in ("1", "2"):
            if f"row{robot}" in here:
                cell = here[f"column{robot}"], here[f"row{robot}"]
                marks[cell] = "B" if marks.get(cell) == "1" else robot
    order = range(rows, 0, -1) if layout["rows_grow"] == "up" else range(1, rows + 1)
    return ["  " + " ".join(marks.get((x, y), ".") for x in range(1, columns + 1)) for y in order]


def _symbol(i: int) -> str:
    return "123456789abcdefghijklmnopqrstuvwxyz"[i]


def _belief(batch: Batch) -> list[str]:
    """One line a feature; for long lists the likeliest few."""
    values = batch.features[0]
    features = batch.domain.features
    shown = range(len(features))
    if len(features) > 15:
        shown = sorted(values.argsort()[::-1][:6].tolist())  # type: ignore[assignment]
    return [
        f"{_label(batch.domain, i):>10} {values[i]:.2f} {'#' * round(_BAR * values[i])}" for i in shown if values[i] > 0
    ]


def _label(domain: Domain, i: int) -> str:
    name, factor, value = domain.features[i]
    if domain.layout["kind"] == "rocksample":
        return f"rock {_symbol(factor)}"
    return f"{domain.factors[factor]} {domain.factor_labels[factor][value]}" if len(domain.features) > 15 else name


def _side_by_side(left: list[str], right: list[str]) -> list[str]:
    width = max((len(line) for line in left), default=0)
    height = max(len(left), len(right))
    left, right = left + [""] * (height - len(left)), right + [""] * (height - len(right))
    return [f"{a:<{width}}   {b}".rstrip() for a, b in zip(left, right, strict=True)]
