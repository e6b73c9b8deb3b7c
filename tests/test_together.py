"""Many episodes of a program at a time: the numbers are those of the engine contract, which takes one step after
another with a policy that knows nothing of groups, and of the rules."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness.engine import rng
from harness.engine.philox import uniform_table
from harness.ge import derived
from harness.ge import grammar as bnf
from harness.ge.initialisation import METHODS
from harness.ge.mapping import derive
from harness.model.certainty import UNSURE
from harness.play.evaluation import evaluate
from harness.play.population import Episodes, play
from harness.play.together import LANES
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of
from tests import models, reference


def programs_of(domain, count):
    """Random ones in all the domain's words, some of which start again at their end."""
    grammar = bnf.parse(derived.text(domain, feedback=True))
    genotypes = METHODS["ramped"](grammar, 4 * count, 14, 1000, 0.5, np.random.default_rng(1))
    texts = [derive(grammar, codons).phenotype for codons in genotypes]
    texts = sorted({text for text in texts if text is not None}, key=len)[-count:]
    return [parse(text, words_of(domain), loop=i % 2 == 0) for i, text in enumerate(texts)]


@pytest.mark.parametrize(
    "name", ["rocksample-7x8", "bordercross-7x8-random", "fieldvision-rocksample-5x5", "hallway", "tag", "mine"]
)
def test_episodes_are_those_of_evaluate(name):
    """Several starts, readings before the first step, sensors, noisy moves; and more episodes than go at a time."""
    domain = models.tiger() if name == "mine" else harness.load(name)
    programs, size = programs_of(domain, 12), LANES + 13
    played = play(domain, programs, Episodes(5, 3, size, 30), discount=domain.discount)
    for program, returns, steps in zip(programs, played.returns, played.steps, strict=True):
        alone = evaluate(
            domain, ProgramPolicy(program), episodes=size, seed=5, first=3, horizon=30, engine="tables", workers=1
        )
        assert np.array_equal(alone.discounted, returns)
        assert alone.steps.sum() == steps


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ('check(1) up() if(1 == "good") right()', "a register, later"),
        ('check(1) if(1 == "good") right() check(1) up()', "a register, before it is filled again"),
        ("check(1) up() if(belief(1) > 0.6) right()", "a belief, later"),
        ('loop if(reading() == "good") right() check(1)', "the latest reading, at the top again"),
        ('check(1) while(reading() == "bad") check(1) right()', "the latest reading, further up"),
        ('check(2) check(1) if(2 == "good") right() if(reading() == "good") up()', "after another was made"),
    ],
)
def test_readings_that_are_asked_for_later_are_taken(text, asked):
    domain = harness.load("rocksample-7x8")
    program = parse(text, words_of(domain))
    played = play(domain, [program], Episodes(2, 0, 60, 30))
    alone = evaluate(domain, ProgramPolicy(program), episodes=60, seed=2, horizon=30, engine="tables", workers=1)
    assert np.array_equal(alone.returns, played.returns[0]), asked
    assert alone.steps.sum() == played.steps[0]
    assert len(set(alone.steps.tolist())) > 1, "the reading decides nothing, so nothing is tested"


def test_what_is_sure_follows_the_rules():
    """Moves are, and pay the fine where they lead off the board; checks are but for their readings; a sample is where
    there is no rock."""
    domain = harness.load("rocksample-7x8")
    index = {tuple(map(int, cell)): v for v, cell in enumerate(domain.visible_values) if not domain.tables.terminal[v]}
    sure = domain.sure.reshape(domain.n_visible, domain.n_actions)
    for (x, y), v in index.items():
        for a, name in enumerate(domain.actions):
            step, verb = sure[v, a], name.partition("(")[0]
            if verb == "check":
                assert (step["visible"], step["observation"], step["told"]) == (v, UNSURE, 1)
                continue
            assert (step["observation"], step["told"]) == (domain.observations.index("none"), 0)
            if verb == "sample":
                assert step["visible"] == (UNSURE if (x, y) in reference.ROCKS else v)
                continue
            dx, dy = reference.DIRECTIONS[verb]
            if x + dx == 8:
                assert domain.tables.terminal[step["visible"]]
                assert step["reward"] == 10
            else:
                there = index.get((x + dx, y + dy))
                assert step["visible"] == (v if there is None else there)
                assert step["reward"] == (-100 if there is None else 0)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**63), st.integers(0, 10**9), st.integers(1, 30), st.integers(1, 5))
def test_random_numbers_of_all_steps_are_those_of_each(seed, first, count, steps):
    table = uniform_table(np.uint64(seed), rng.ENGINE, first, count, steps)
    assert table.tolist() == [rng.uniforms(seed, rng.ENGINE, step, first, count).tolist() for step in range(steps)]
