"""Uniform numbers belong to (seed, stream, step, episode)."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from harness.engine import rng


@given(
    seed=st.integers(0, 2**63),
    stream=st.integers(0, 1),
    step=st.integers(0, 10_000),
    first=st.integers(0, 10**9),
    count=st.integers(1, 40),
    skip=st.integers(0, 39),
)
def test_any_part_of_a_batch_is_the_batch(seed, stream, step, first, count, skip):
    whole = rng.uniforms(seed, stream, step, first, count)
    assert whole.shape == (count,)
    part = rng.uniforms(seed, stream, step, first + min(skip, count - 1), 1)
    assert whole[min(skip, count - 1)] == part[0]


def test_seeds_streams_and_steps_differ():
    draws = [rng.uniforms(*key, 0, 100) for key in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))]
    for i, a in enumerate(draws):
        for b in draws[i + 1 :]:
            assert not np.isin(a, b).any()


def test_numbers_are_uniform_over_episodes_and_steps():
    values = np.stack([rng.uniforms(3, rng.ENGINE, step, 0, 2000) for step in range(50)]).ravel()
    assert values.min() >= 0
    assert values.max() < 1
    counts = np.histogram(values, bins=100, range=(0, 1))[0]
    expected = len(values) / 100
    chi_square = ((counts - expected) ** 2 / expected).sum()
    assert 40 < chi_square < 180  # 99 degrees of freedom: both tails beyond 1e-6


def test_the_largest_seeds_streams_and_steps_differ_too():
    """Each of these numbers is needed to its last bit, beyond what a float holds."""
    keys = [(2**64 - 1, 0, 0), (2**64 - 2, 0, 0), (2**64 - 1, 0, 1), (2**62, rng.TUNER, 0), (2**62, rng.TUNER, 1)]
    draws = [rng.uniforms(*key, 0, 100) for key in (*keys, (2**62 + 1, rng.TUNER, 1))]
    assert len({draw.tobytes() for draw in draws}) == len(draws)
    assert all(np.array_equal(rng.generator(*key).random(8), rng.uniforms(*key, 0, 8)) for key in keys)


def test_what_is_trained_on_is_never_scored_on():
    ranges = (0, rng.TRAINING, rng.HELD_OUT, rng.VALIDATION, rng.REFINEMENT)
    seeds = [[start + k for start in ranges] for k in (0, 1, rng.HELD_OUT - 1)]
    assert len({seed for group in seeds for seed in group}) == 15
    assert all(seed < 2**64 for group in seeds for seed in group)
