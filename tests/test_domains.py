"""The domains of the literature: values that are known otherwise, the rules of RockSample, and how maps are shown."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness import registry
from harness.cli import main
from harness.gym.registration import environment_id
from harness.model import validation
from harness.policy.heuristic import rock_map
from harness.score import bounds
from harness.show import replay
from tests.conftest import size

ROCKS = [name for name in registry.names() if name.startswith("rocksample") and "20x20" not in name]


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        *size([], [("rocksample-4x4", 19.0100, 1e-4)]),  # two programs agree; tests/test_solver.py too
        ("tiger", 19.3716, 5e-4),  # APPL's log has 19.3711 to 19.3721
        ("heaven-hell", 0.99**10 / (1 - 0.99**11), 1e-9),  # eleven steps a round by way of the priest, paid at the last
    ],
)
def test_the_optimum_is_the_one_known(name, value, error):
    solved = harness.solve(name, gap=0.01)
    assert solved.gap <= 0.01
    assert solved.lower - error <= value <= solved.upper + error


@pytest.mark.parametrize("name", [name for name in registry.names() if registry.policy_path(name, "solved").exists()])
def test_what_ships_earns_its_bound(name):
    """By simulation, with the horizon at which a thousandth is left of a reward of 100."""
    domain = harness.load(name)
    found = bounds.optimum(domain)
    horizon = int(np.ceil(np.log(1e-5) / np.log(domain.discount)))
    score = harness.evaluate(domain, "solved", episodes=size(300, 3000), seed=3, horizon=horizon).score
    assert found.low - 5 * score.discounted_sem - 2e-3 <= score.discounted_mean
    assert score.discounted_mean <= found.high + 5 * score.discounted_sem + 2e-3


def test_zmdp_s_penalties_change_nothing_for_who_avoids_them():
    ours, theirs = (bounds.optimum(harness.load(f"rocksample-7x8{rules}")) for rules in ("", "@zmdp"))
    assert max(ours.low, theirs.low) <= min(ours.high, theirs.high)


@pytest.mark.parametrize("name", ROCKS)
def test_the_heuristics_know_the_sensor(name):
    """The accuracy that they compute from the layout is the one in the tables."""
    domain, here = harness.load(name), rock_map(harness.load(name))
    t = domain.arrays
    for v in np.flatnonzero(~t["terminal"]):
        for k in range(len(domain.factors)):
            row = t["first_row"][v * domain.n_actions + here.check + k] + 1  # the rock is good
            reading = t["outcome_observation"][t["row_outcomes"][row]]
            right = t["observation_probability"][reading, domain.observations.index("good")]
            assert here.accuracy[v, k] == pytest.approx(right, abs=1e-12)


def test_a_name_that_ends_like_a_julia_file_is_a_name():
    name = "rocksample-7x8@rocksample.jl"
    assert registry.load_from_data(name).name == harness.load(name).name == name


def test_an_illegal_sample_is_known_as_one():
    legal = {name: harness.load(name).legality for name in ("rocksample-7x8", "rocksample-7x8@zmdp")}
    sample = harness.load("rocksample-7x8").action("sample()")
    changed = np.argwhere(legal["rocksample-7x8"] != legal["rocksample-7x8@zmdp"])
    assert set(changed[:, 1]) == {sample}
    assert len(changed) == 49 - 8


def test_names_of_environments():
    ids = {name: environment_id(harness.load(name)) for name in registry.names() if name != "rocksample-20x20"}
    assert ids["rocksample-7x8@pobax"] == "pomdp_harness/RockSample-7x8-pobax-v1"
    assert ids["tiger-grid"] == "pomdp_harness/TigerGrid-v1"
    assert ids["hallway2"] == "pomdp_harness/Hallway2-v1"
    assert len(set(ids.values())) == len(ids)


def test_a_map_is_shown_with_walls_signs_robot_and_belief(capsys):
    assert main(["show", "tag", "random", "--seed", "1"]) == 0
    rows = [line[2:21] for line in capsys.readouterr().out.splitlines() if line.startswith("  ")][:5]
    assert [row.count("#") for row in rows] == [7, 7, 7, 0, 0]
    assert sum(row.count("R") for row in rows) == 1
    domain = harness.load("hallway")
    places = replay.hidden_places(domain, np.full(60, 1 / 60))
    assert set(places) == {(x, 1) for x in range(1, 12)} | {(x, 2) for x in (3, 5, 7, 9)}
    assert places[9, 2] == pytest.approx(4 / 60)


def test_a_map_is_drawn():
    axes = harness.draw_layout("tiger-grid")
    signs = [(text.get_text(), *text.get_position()) for text in axes.texts]
    assert signs == [("-", 1, 1), ("+", 3, 1), ("-", 5, 1)]
    assert len(harness.draw_layout("heaven-hell").texts) == 4  # two ends, the priest, the robot
    harness.draw_episode("tag", "random-legal", horizon=5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"walls": [[0, 1]]}, "walls are no list of cells"),
        ({"signs": [["++", 1, 1]]}, "signs are no list"),
        ({"signs": [[]]}, "signs are no list"),
        ({"hidden_cells": [[1, 1]]}, "hidden_cells are no list of cells"),
        ({"columns": "many"}, "columns is 'many'"),
    ],
)
def test_a_wrong_map_is_refused(change, words):
    from dataclasses import replace

    domain = harness.load("hallway")
    broken = replace(domain, layout={**domain.layout, **change})
    assert any(words in breach for breach in validation.breaches(broken))
