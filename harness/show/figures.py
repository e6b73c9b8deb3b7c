"""Pictures of a domain, of an episode, of what was believed in it, and of a comparison, for notebooks and papers."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from harness import engine as engines
from harness import host, registry
from harness import policy as policies
from harness.engine.batch import Batch
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON, Z95, check_played, simulate
from harness.policy import Policy
from harness.score.table import by_domain, check_columns
from harness.show.drawing import LINE, SECOND, axes_or_new, blank, cells, plain
from harness.show.replay import hidden_places

_ROBOTS = (LINE, SECOND)
_READINGS = {"good": "#2e7d32", "bad": "#c62828"}
_COORDINATES = (("x", "y"), ("column1", "row1"), ("column2", "row2"))  # names of the visible part that place a robot

Cell = tuple[float, float]
"""Column and row."""


def draw_layout(domain: Domain | str, axes: Axes | None = None) -> Axes:
    """Draw a domain's grid: the robots where episodes start, if that is one place; rocks by number, walls, the exit.

    Args:
        domain: a domain or its name.
        axes: where to draw; by default on a new figure.

    Raises:
        HarnessError: the domain has no layout to draw.
    """
    domain, axes = _domain_and_axes(domain, axes)
    _draw_grid(domain, axes)
    starts = np.unique(domain.arrays["start_visible"])
    if len(starts) == 1:
        for robot, cell in _robots(domain, domain.visible_values[starts[0]]).items():
            _draw_robot(axes, robot, cell)
    axes.set_title(domain.name)
    return axes


def state_image(batch: Batch) -> NDArray[np.uint8]:
    """(height, width, 3) a picture of the first episode of a batch: the grid, the robots, and beside it the belief.

    The domain must have a layout. A robot in a terminal state has no place and is not drawn.
    """
    domain = batch.domain
    figure = blank(6.4, 4.2)
    grid, bars = figure.subplots(1, 2, width_ratios=(3, 1))
    _draw_grid(domain, grid)
    _draw_hidden(domain, grid, batch.features[0])
    for robot, cell in _robots_now(batch, {}).items():
        _draw_robot(grid, robot, cell)
    bars.barh(range(len(domain.features)), batch.features[0], color="#9db7d1")
    bars.set(xlim=(0, 1), yticks=[], xlabel="belief (probability)")
    bars.invert_yaxis()
    canvas = figure.canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]


def draw_episode(
    domain: Domain | str,
    policy: str | Policy,
    *,
    seed: int = 0,
    episode: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    axes: Axes | None = None,
) -> Axes:
    """Draw one episode on the grid: the ways of the robots, what was read of rocks, and the reward won in each cell.

    Where something hidden may be, a cell is coloured by the belief of that, as the policy that has one left it.

    The episode is the one that ``compare`` and ``evaluate`` play under the same seed and number; its rewards are of the
    domain's shaping.

    Args:
        domain: a domain or its name.
        policy: a policy string or a policy object.
        seed: of the episode.
        episode: its number.
        horizon: steps after which it is truncated.
        engine: ``tables``, ``julia`` or ``auto``.
        axes: where to draw; by default on a new figure.

    Raises:
        HarnessError: an argument is wrong, or the domain has no layout to draw.
    """
    domain, axes = _domain_and_axes(domain, axes)
    name, frames = _play(domain, policy, seed, episode, horizon, engine)
    _draw_grid(domain, axes)
    _draw_hidden(domain, axes, np.nan_to_num(frames[-1].features))
    for robot in frames[0].robots:
        way = np.array([frame.robots[robot] for frame in frames if robot in frame.robots])
        # A way that comes back to a cell is drawn beside itself: it drifts by a third of a cell in all.
        drift = np.linspace(-1 / 6, 1 / 6, len(way))[:, None]
        axes.plot(*(way + drift).T, color=_ROBOTS[robot - 1], linewidth=1.5, alpha=0.8)
        _draw_robot(axes, robot, frames[0].robots[robot])
    _draw_readings(domain, axes, frames)
    _draw_rewards(axes, frames)
    total = sum(frame.reward for frame in frames)
    axes.set_title(f"{name}: {len(frames) - 1} steps, return {total:g}")
    return axes


def draw_beliefs(
    domain: Domain | str,
    policy: str | Policy,
    *,
    seed: int = 0,
    episode: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    axes: Axes | None = None,
) -> Axes:
    """Draw the belief features over the steps of one episode, with the action and the reading of every step.

    The arguments are those of :func:`draw_episode`.

    Raises:
        HarnessError: an argument is wrong, or the domain has no belief features.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    if not domain.features:
        raise HarnessError(f"{domain.name} has no belief features: nothing in it is hidden")
    name, frames = _play(domain, policy, seed, episode, horizon, engine)
    axes = axes_or_new(axes, max(5.0, 1.5 + 0.22 * len(frames)), 3.5)
    for i, (label, _, _) in enumerate(domain.features):
        line = [frame.features[i] for frame in frames]
        axes.plot(line, drawstyle="steps-post", marker=".", label=label)
    words = ["start", *(f"{frame.action} {frame.reading}".rstrip() for frame in frames[1:])]
    axes.set_xticks(range(len(words)), words, rotation=90, fontsize=7)
    axes.set(ylim=(-0.03, 1.03), ylabel="belief (probability)", title=name)
    plain(axes)
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return axes


def compare_figure(table: pd.DataFrame) -> Figure:
    """Mean returns with their 95 % intervals, undiscounted and discounted, a bar for every policy of a comparison.

    ``table`` is what :func:`harness.compare` returns; each of its domains has a row of panels. An upper bound is a
    dashed line.
    """
    check_columns(table)
    parts = by_domain(table)
    if not parts:
        raise HarnessError("there are no rows to draw")
    bars = [max(1, int((part["kind"] == "policy").sum())) for part in parts]
    figure = blank(7.5, 0.4 + sum(0.6 + 0.34 * count for count in bars))
    panels = figure.subplots(len(parts), 2, sharey="row", squeeze=False, height_ratios=[2 + count for count in bars])
    for part, (left, right) in zip(parts, panels, strict=True):
        _bars(left, part, "mean", "sem", "undiscounted return (reward)")
        _bars(right, part, "discounted_mean", "discounted_sem", "discounted return (reward)")
        left.invert_yaxis()  # the first row of the table on top
        left.set_title(str(part["domain"].iloc[0]), fontsize=10, loc="left")
    handles, labels = panels[0, 1].get_legend_handles_labels()
    if handles:
        figure.legend(handles[:1], labels[:1], loc="outside lower right", frameon=False, fontsize=8)
    return figure


def _bars(axes: Axes, part: pd.DataFrame, mean: str, sem: str, label: str) -> None:
    """One panel: the policies of one domain."""
    played, bounds = part[part["kind"] == "policy"], part[part["kind"] == "upper bound"]
    half = Z95 * played[sem].to_numpy(dtype=float)
    values = played[mean].to_numpy(dtype=float)
    axes.barh(played["policy"], values, xerr=half, color="#9db7d1", ecolor=LINE, capsize=3)
    for bound in bounds[mean].dropna():
        axes.axvline(float(bound), color=SECOND, linestyle="--", linewidth=1, label="upper bound")
    axes.axvline(0, color="0.4", linewidth=0.8)
    axes.set_xlabel(label)
    plain(axes, "x")


class _Frame(NamedTuple):
    """What a drawing needs of one step; the first frame is the start."""

    action: str
    reading: str
    reward: float
    robots: dict[int, Cell]
    features: NDArray[np.float64]


_FRAME = 500  # bytes of one, besides its features


def _play(
    domain: Domain, policy: str | Policy, seed: int, episode: int, horizon: int, engine: str
) -> tuple[str, list[_Frame]]:
    """The policy's name, and one episode of it."""
    name, made = policies.named(policy, domain)
    frames: list[_Frame] = []
    check_played(seed=seed, episode=episode, horizon=horizon)
    host.check_memory(f"a picture of {horizon:,} steps", horizon * (8 * len(domain.features) + _FRAME))
    for record in simulate(domain, made, engines.choose(engine, domain), seed, episode, 1, horizon):
        batch = record.batch
        tracked = batch.marginals.shape[1] > 0
        frames.append(
            _Frame(
                "" if record.actions is None else domain.actions[record.actions[0]],
                _reading(batch),
                float(record.rewards[0]),
                _robots_now(batch, frames[-1].robots if frames else {}),
                batch.features[0].copy() if tracked else np.full(len(domain.features), np.nan),
            )
        )
    return name, frames


def _reading(batch: Batch) -> str:
    index = batch.observation[0]
    label = "" if index < 0 else batch.domain.observations[index]
    return "" if label == "none" else label


def _robots_now(batch: Batch, before: dict[int, Cell]) -> dict[int, Cell]:
    """Where the robots are. A terminal state has no place: they stay where they were, or are at RockSample's exit."""
    domain = batch.domain
    if not batch.done[0]:
        return _robots(domain, domain.visible_values[batch.visible[0]])
    if domain.layout["kind"] == "rocksample":
        return {robot: (domain.layout["exit_column"], row) for robot, (_, row) in before.items()}
    return before


def _robots(domain: Domain, values: NDArray[np.int16]) -> dict[int, Cell]:
    """Cells of the robots that a row of ``visible_values`` places, numbered from 1."""
    here = dict(zip(domain.visible_names, values.tolist(), strict=True))
    placed = [(here[x], here[y]) for x, y in _COORDINATES if x in here]
    return dict(enumerate(placed, start=1))


def _domain_and_axes(domain: Domain | str, axes: Axes | None) -> tuple[Domain, Axes]:
    domain = registry.load(domain) if isinstance(domain, str) else domain
    if domain.layout["kind"] == "none":
        raise HarnessError(f"{domain.name} has no layout to draw; draw_beliefs shows its episodes")
    return domain, axes_or_new(axes, 4.5, 4.2)


def _draw_grid(domain: Domain, axes: Axes) -> None:
    layout = domain.layout
    rows, columns = layout["rows"], layout.get("exit_column", layout["columns"])
    for name, colour in (("exit_column", "#e3f1e3"), ("wall_column", "0.6")):
        if name in layout:
            axes.add_patch(Rectangle((layout[name] - 0.5, 0.5), 1, rows, color=colour, zorder=0))
    for x, y in layout.get("walls", ()):
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, color="0.6", zorder=0))
    for sign, x, y in layout.get("signs", ()):
        axes.text(x, y, sign, ha="center", va="center", fontsize=12, zorder=4)
    for i, cell in enumerate(layout.get("rocks", ()), start=1):
        axes.plot(*cell, "o", color="0.85", markeredgecolor="0.5", markersize=17, zorder=1)
        axes.text(cell[0], cell[1], str(i), ha="center", va="center", fontsize=9, zorder=4)
    axes.set_xticks(np.arange(0.5, columns + 1), minor=True)
    axes.set_yticks(np.arange(0.5, rows + 1), minor=True)
    axes.grid(which="minor", color="0.85", linewidth=0.6)
    cells(axes, columns, rows, upward=layout["rows_grow"] == "up")


def _draw_hidden(domain: Domain, axes: Axes, features: NDArray[np.float64]) -> None:
    for (x, y), share in hidden_places(domain, features).items():
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, color="#f0a040", alpha=min(share, 1.0) ** 0.5, zorder=0.5))


def _draw_robot(axes: Axes, robot: int, cell: Cell) -> None:
    axes.plot(*cell, "s", color=_ROBOTS[robot - 1], markersize=13, zorder=3)
    axes.text(cell[0], cell[1], f"R{robot}", color="white", ha="center", va="center", fontsize=7, zorder=5)


def _draw_readings(domain: Domain, axes: Axes, frames: list[_Frame]) -> None:
    """A dotted line from where the robot stood to the rock that it checked, in the colour of the reading."""
    for frame in frames:
        if frame.action.startswith("check(") and frame.robots:
            rock = domain.layout["rocks"][int(frame.action[6:-1]) - 1]
            ends = np.array([frame.robots[1], rock])
            axes.plot(*ends.T, ":", color=_READINGS.get(frame.reading, "0.5"), linewidth=1.3, zorder=2)


def _draw_rewards(axes: Axes, frames: list[_Frame]) -> None:
    """Beside every cell what was won there in all.

    Of two robots the one counts that the action names; where it names none, the one nearer to the wall.
    """
    won: dict[Cell, float] = defaultdict(float)
    for frame in frames:
        if frame.reward and frame.robots:
            named = [cell for robot, cell in frame.robots.items() if frame.action.endswith(f"({robot})")]
            won[max(named or frame.robots.values())] += frame.reward
    for (x, y), reward in won.items():
        colour = _READINGS["good" if reward > 0 else "bad"]
        axes.annotate(
            f"{reward:+g}",
            (x, y),
            (9, 9),
            textcoords="offset points",
            color=colour,
            fontsize=9,
            weight="bold",
            zorder=6,
        )
