"""The pictures show what the numbers say."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import harness
from harness.cli import main
from harness.ge.figures import run_figure, runs_figure
from harness.show import drawing
from harness.tuning.figures import history_figure


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


def test_every_domain_has_a_row_of_panels(rocksample, bordercross):
    table = harness.compare([rocksample, bordercross], ["random-legal", "mdp"], episodes=20, engine="tables")
    panels = harness.compare_figure(table).axes
    assert [axes.get_title("left") for axes in panels[::2]] == ["rocksample-7x8", "bordercross-7x8"]
    assert [axes.patches[0].get_width() for axes in panels[::2]] == table["mean"].tolist()[::2]


def sweep():
    """High everywhere, so that a legend inside would have no free corner."""
    x = np.linspace(0, 1, 30)
    rows = {"policy": "p", "threshold": x, "episodes": 10, "mean": 50 + np.sin(40 * x), "sem": 0.5}
    return pd.DataFrame(rows)


def evolution(seed):
    values = 10 + 3.0 * np.sin(np.arange(40) + seed)
    return pd.DataFrame({"generation": range(40), "best": values, "test": values, "test_sem": 0.3, "seed": seed})


def tuning():
    k = np.arange(12)
    return pd.DataFrame(
        {"iteration": k, "value": 50 + np.cos(k), "sem": 0.2, "theta_a": np.sin(k), "theta_b": np.cos(k)}
    )


FIGURES = {
    "sweep": lambda: harness.sweep_figure(sweep(), "a title"),
    "evolution": lambda: run_figure(evolution(0)),
    "evolutions": lambda: runs_figure(pd.concat([evolution(0), evolution(1)])),
    "tuning": lambda: history_figure(tuning(), ["a", "b"], "return"),
    "comparison": lambda: harness.compare_figure(
        harness.compare("rocksample-7x8", ["exit", "belief", "mdp"], episodes=20, engine="tables")
    ),
}


@pytest.mark.parametrize("name", FIGURES)
def test_no_legend_lies_on_data_and_no_text_on_another(name):
    figure = FIGURES[name]()
    figure.canvas.draw()
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    assert legends
    for legend in legends:
        box = legend.get_window_extent().padded(-1)
        assert figure.bbox.containsx(box.x0)
        assert figure.bbox.containsx(box.x1)
        others = [figure._suptitle, *(axes.xaxis.label for axes in figure.axes)]
        for axes in figure.axes:
            assert not box.overlaps(axes.get_window_extent())
            others += [axes.title, axes._left_title, axes._right_title]
        assert not any(text and text.get_text() and box.overlaps(text.get_window_extent()) for text in others)


@pytest.mark.parametrize("name", FIGURES)
def test_plot_and_figure_return_a_figure_with_a_text(name):
    figure = FIGURES[name]()
    assert isinstance(figure, Figure)
    image, more = figure._repr_mimebundle_()
    assert base64.b64decode(image["image/png"]).startswith(b"\x89PNG")
    text = more["image/png"]["alt"]
    labels = [label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
    assert labels
    assert all(label in text for label in labels)


def test_the_text_names_the_policies():
    text = drawing.described(FIGURES["comparison"]())
    assert "rocksample-7x8" in text
    assert "exit" in text
    assert "upper bound" in text


@pytest.mark.parametrize(
    ("ending", "begin"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml"), ("SVG", b"<?xml")]
)
def test_the_ending_is_the_format_and_files_are_reproducible(tmp_path, ending, begin):
    contents = []
    for k in range(2):
        path = tmp_path / f"{k}.{ending}"
        drawing.save(FIGURES["tuning"](), path)
        contents.append(path.read_bytes())
    assert contents[0].startswith(begin)
    assert contents[0] == contents[1]


def test_another_ending_is_refused_before_anything_is_played(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("harness.score.comparison.compare", lambda *a, **k: pytest.fail("ran"))
    assert main(["compare", "rocksample-7x8", "--figure", str(tmp_path / "a.jpeg")]) == 2
    assert "must end in .png, .pdf or .svg" in capsys.readouterr().err


def test_the_command_draws_and_compares_several_domains(tmp_path, capsys):
    domains = ["rocksample-7x8", "bordercross-7x8"]
    policies = ["--policy", "random-legal", "--policy", "mdp", "--against", "sarsop"]
    options = ["--episodes", "20", "--engine", "tables", "--figure", str(tmp_path / "a.svg")]
    assert main(["compare", *domains, *policies, *options]) == 0
    out = capsys.readouterr().out
    assert out.count("return less sarsop") == 2
    assert "Over all domains" in out
    svg = (tmp_path / "a.svg").read_text()
    assert svg.rstrip().endswith("</svg>")


@pytest.mark.parametrize(
    "table",
    [pd.DataFrame(), pd.DataFrame({"policy": ["x"], "mean": [1.0]}), lambda: sweep().iloc[:0]],
    ids=["empty", "foreign", "no rows"],
)
def test_a_sweep_of_nothing_is_refused(table):
    with pytest.raises(harness.HarnessError, match=r"no table of harness\.sweep"):
        harness.sweep_figure(table() if callable(table) else table)
