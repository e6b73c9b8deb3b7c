"""One episode, step by step; as text: the grid, the action, the reading, the belief, the reward."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import engine as engines
from harness import policy as policies
from harness import registry
from harness.engine.batch import Batch
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON, check_played, simulate
from harness.policy import Policy

MANY_FEATURES = 15
"""Of more belief features than these, the likeliest few are shown."""

_BAR = 10  # characters of a belief bar


class Step(NamedTuple):
    """One step of an episode, or its start."""

    number: int
    """0 for the start."""
    action: int | None
    """None for the start."""
    reward: float
    total: float
    """Undiscounted return so far."""
    discounted: float
    batch: Batch
    """After the step; overwritten by the next one."""

    @property
    def sentence(self) -> str:
        """What happened, on one line."""
        if self.action is None:
            return f"start{_reading(self.batch)}"
        action = self.batch.domain.actions[self.action]
        return f"step {self.number}: {action}{_reading(self.batch)}, reward {self.reward:+g}, return {self.total:g}"


def steps(domain: Domain, policy: Policy, engine: str, seed: int, episode: int, horizon: int) -> Iterator[Step]:
    """Yield the start and then each step of episode number ``episode`` of a seed, as ``evaluate`` plays it."""
    check_played(seed=seed, episode=episode, horizon=horizon)
    total, discounted, weight = 0.0, 0.0, 1.0
    for number, record in enumerate(simulate(domain, policy, engine, seed, episode, 1, horizon)):
        if record.actions is None:
            yield Step(0, None, 0.0, 0.0, 0.0, record.batch)
            continue
        reward = float(record.rewards[0])
        total += reward
        discounted += weight * reward
        weight *= domain.discount
        yield Step(number, int(record.actions[0]), reward, total, discounted, record.batch)


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
    policies.check_engine(spec, engine)
    spec, policy = policies.named(spec, domain)
    policy_belief = getattr(policy, "uses_belief", True)
    yield f"{domain.name}, policy {spec}, engine {engine}, seed {seed}, episode {episode}"
    for step in steps(domain, policy, engine, seed, episode, horizon):
        batch = step.batch
        yield "\n".join([step.sentence, *_picture(batch, policy_belief)])
    end = f"The episode {ending(step, horizon)} after {step.number} steps"
    yield f"{end}: return {step.total:g}, discounted {step.discounted:.2f}."


def picture(batch: Batch) -> str:
    """The grid of a batch's first episode and its belief beside it; empty once the episode has reached its end."""
    return "\n".join(_picture(batch, belief=True))


def _picture(batch: Batch, belief: bool) -> list[str]:
    return [] if batch.done[0] else _side_by_side(_grid(batch), _belief(batch) if belief else [])


def ending(last: Step, horizon: int) -> str:
    """How an episode ended, by its last step."""
    if last.batch.done[0]:
        return "reached a terminal state"
    return "was cut at the horizon" if last.number == horizon else "was left by its policy"


def reading(batch: Batch) -> int | None:
    """Index of what the first episode of a batch has just read; None where it read nothing."""
    observation, silent = int(batch.observation[0]), bool(batch.domain.sensors) and batch.done[0]
    return None if observation < 0 or silent or batch.domain.observations[observation] == "none" else observation


def _reading(batch: Batch) -> str:
    read = reading(batch)
    return "" if read is None else f", reading {batch.domain.observations[read]}"


def position(batch: Batch) -> dict[str, int]:
    """What the first episode of a batch shows of its state, by name."""
    return dict(zip(batch.domain.visible_names, batch.domain.visible_values[batch.visible[0]].tolist(), strict=True))


def _grid(batch: Batch) -> list[str]:
    """The domain drawn from its layout: one character a cell."""
    layout = batch.domain.layout
    if layout["kind"] == "none":
        return []
    marks = {"rocksample": _rock_marks, "grid": _map_marks}.get(layout["kind"], _border_marks)(batch)
    rows, columns = layout["rows"], layout.get("exit_column", layout["columns"])
    order = range(rows, 0, -1) if layout["rows_grow"] == "up" else range(1, rows + 1)
    return ["  " + " ".join(marks.get((x, y), ".") for x in range(1, columns + 1)) for y in order]


_Marks = dict[tuple[int, int], str]


def _rock_marks(batch: Batch) -> _Marks:
    layout, here = batch.domain.layout, position(batch)
    marks = {(layout["exit_column"], y): ">" for y in range(1, layout["rows"] + 1)}
    marks |= {(x, y): _symbol(i) for i, (x, y) in enumerate(layout["rocks"])}
    return marks | {(here["x"], here["y"]): "R"}


def _border_marks(batch: Batch) -> _Marks:
    layout, here = batch.domain.layout, position(batch)
    marks = {(layout["wall_column"], y): "X" for y in range(1, layout["rows"] + 1)}
    marks |= {(layout["exit_column"], y): ">" for y in range(1, layout["rows"] + 1)}
    for robot in ("1", "2"):
        if here.keys() >= {f"row{robot}", f"column{robot}"}:
            cell = here[f"column{robot}"], here[f"row{robot}"]
            marks[cell] = "B" if marks.get(cell) == "1" else robot
    return marks


def _map_marks(batch: Batch) -> _Marks:
    """Walls and signs; digits are tenths of the belief that what is hidden is in the cell."""
    layout, here = batch.domain.layout, position(batch)
    marks = dict.fromkeys(((x, y) for x, y in layout["walls"]), "#")
    marks |= {(x, y): sign for sign, x, y in layout["signs"]}
    if batch.marginals.shape[1]:
        marks |= {
            cell: f"{min(round(10 * share), 9)}"
            for cell, share in hidden_places(batch.domain, batch.features[0]).items()
            if round(10 * share)
        }
    return marks | ({(here["x"], here["y"]): "R"} if "x" in here else {})


def hidden_places(domain: Domain, features: NDArray[np.float64]) -> dict[tuple[int, int], float]:
    """The belief that what is hidden is in a cell (column, row), for the cells that belief features are about."""
    cells, shares = domain.layout.get("hidden_cells", ()), dict[tuple[int, int], float]()
    for (_, _, value), share in zip(domain.features, features.tolist(), strict=True) if cells else ():
        x, y = cells[value]
        shares[x, y] = shares.get((x, y), 0.0) + share
    return shares


_SYMBOLS = "123456789abcdefghijklmnopqrstuvwxyz"


def _symbol(i: int) -> str:
    """The mark of a rock in its cell; a star where there are more rocks than marks."""
    return _SYMBOLS[i] if i < len(_SYMBOLS) else "*"


def _belief(batch: Batch) -> list[str]:
    """One line a feature; for long lists the likeliest few."""
    values = batch.features[0]
    features = batch.domain.features
    shown = range(len(features))
    if len(features) > MANY_FEATURES:
        shown = sorted(values.argsort()[::-1][:6].tolist())  # type: ignore[assignment]
    return [
        f"{label(batch.domain, i):>10} {values[i]:.2f} {'#' * round(_BAR * values[i])}" for i in shown if values[i] > 0
    ]


def label(domain: Domain, i: int) -> str:
    """What belief feature ``i`` is about: ``rock 3``, ``robot 2 (4, 1)``."""
    name, factor, value = domain.features[i]
    if domain.layout["kind"] == "rocksample":
        return f"rock {_symbol(factor) if factor < len(_SYMBOLS) else factor + 1}"
    return (
        f"{domain.factors[factor]} {domain.factor_labels[factor][value]}"
        if len(domain.features) > MANY_FEATURES
        else name
    )


def _side_by_side(left: list[str], right: list[str]) -> list[str]:
    width = max((len(line) for line in left), default=0)
    height = max(len(left), len(right))
    left, right = left + [""] * (height - len(left)), right + [""] * (height - len(right))
    return [f"{a:<{width}}   {b}".rstrip() for a, b in zip(left, right, strict=True)]
