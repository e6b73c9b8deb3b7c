"""The pictures show what the numbers say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import pyplot as plt

import harness


@pytest.fixture(autouse=True)
def closed():
    """Figures are drawn without a window, and closed."""
    plt.switch_backend("Agg")
    yield
    plt.close("all")


def written(axes):
    """Every text on the axes with where it stands."""
    return {(text.get_text(), *text.xy) if hasattr(text, "xy") else (text.get_text(), *text.get_position())
            for text in axes.texts}  # fmt: skip


def test_a_layout_has_rocks_and_robot_in_their_cells(rocksample):
    rocks = {(str(i), *cell) for i, cell in enumerate(rocksample.layout["rocks"], start=1)}
    assert written(harness.draw_layout(rocksample)) == {*rocks, ("R1", 1, 4)}


def test_rows_of_bordercross_grow_downward(bordercross, hidden):
    axes = harness.draw_layout(bordercross)
    assert written(axes) == {("R1", 1, 4), ("R2", 3, 7)}  # column, row
    low, high = axes.get_ylim()
    assert low > high
    assert written(harness.draw_layout(hidden)) == {("R1", 1, 4)}  # where robot 2 starts is not known


@pytest.mark.parametrize(("name", "policy"), [("rocksample-7x8", "belief:0.84"), ("bordercross-7x8", "random-legal")])
@pytest.mark.parametrize("episode", [0, 3])
def test_an_episode_is_the_one_that_evaluate_plays(name, policy, episode):
    result = harness.evaluate(name, policy, episodes=1, first=episode, seed=5, engine="tables")
    axes = harness.draw_episode(name, policy, seed=5, episode=episode, engine="tables")
    assert axes.get_title() == f"{policy}: {result.steps[0]} steps, return {result.returns[0]:g}"
    rewards = [float(text) for text, *_ in written(axes) if text[0] in "+-"]
    assert sum(rewards) == result.returns[0]


def test_an_episode_s_rewards_are_of_the_shaping(bordercross):
    axes = harness.draw_episode(bordercross.shaped("paper"), "sarsop", engine="tables")
    rewards = [float(text) for text, *_ in written(axes) if text[0] in "+-"]
    shaped = harness.evaluate(bordercross.shaped("paper"), "sarsop", episodes=1, engine="tables").returns[0]
    assert sum(rewards) == shaped > 500


def test_beliefs_begin_at_the_prior_and_follow_the_readings(rocksample):
    axes = harness.draw_beliefs(rocksample, "belief:0.84", engine="tables")
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}
    words = [label.get_text() for label in axes.get_xticklabels()]
    assert [values[0] for values in lines.values()] == [0.5] * 8
    readings = [(k, word) for k, word in enumerate(words) if word.startswith("check(")]
    assert readings
    for k, word in readings:
        values = lines[f"belief({word[6]})"]
        assert (values[k] > values[k - 1]) == word.endswith("good")


def test_a_comparison_has_a_bar_for_every_policy_and_a_line_for_the_bound(rocksample):
    table = harness.compare(rocksample, ["exit", "mdp", "random-legal"], episodes=200, engine="tables")
    figure = harness.compare_figure(table)
    played = table[table["kind"] == "policy"]
    for axes, column in zip(figure.axes, ["mean", "discounted_mean"], strict=True):
        assert [bar.get_width() for bar in axes.patches] == played[column].tolist()
        bound = next(line for line in axes.get_lines() if line.get_label() == "upper bound")
        assert bound.get_xdata()[0] == table.loc[table["policy"] == "mdp", column].item()


def test_what_cannot_be_drawn_is_said(rocksample, bordercross):
    with pytest.raises(harness.HarnessError, match="no layout to draw"):
        harness.draw_layout(replace(rocksample, layout={"kind": "none"}))
    with pytest.raises(harness.HarnessError, match="no belief features"):
        harness.draw_beliefs(bordercross, "random")
