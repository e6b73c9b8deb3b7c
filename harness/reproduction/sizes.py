"""How much a reproduction plays."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """Sizes of everything that is played; the defaults are the paper's where it gives one (Tables 2 and 3)."""

    episodes: int = 10_000
    """Of every policy of Table 1, and fresh ones of every winner."""
    rollout_episodes: int = 1_000
    """Of the rollout policy, which simulates 100 episodes for every action that it weighs."""
    sweep_points: int = 51
    """Thresholds from 0.5 to 1 in Figure 5."""
    sweep_episodes: int = 10_000
    gradient_episodes: int = 10_000
    """At each point of the gradient ascent (Table 3)."""
    runs: int = 10
    """Independent evolutionary runs of every kind; the paper shows one."""
    population: int = 250
    training_episodes: int = 100
    """Whose mean is the fitness."""
    generations: int = 500
    """Of the full policy search, on both domains."""
    threshold_generations: int = 399
    """Of the parametrized policies."""
    test_episodes: int = 1_000
    """Fresh ones that score the best of every generation in the learning curves."""


FULL = Sizes()
"""The paper's sizes, and ten runs of what it shows one of."""
QUICK = Sizes(
    episodes=4_000,
    rollout_episodes=100,
    sweep_points=26,
    sweep_episodes=2_000,
    gradient_episodes=2_000,
    runs=3,
    population=250,
    training_episodes=50,
    generations=150,
    threshold_generations=20,
    test_episodes=300,
)
"""Under two minutes on two cores; the figures show the shapes, the numbers are rough."""
