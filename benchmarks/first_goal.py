"""What Hallway and Hallway2 are worth where an episode ends at the first goal, as the literature's figures are taken.

    python -m benchmarks.first_goal [--seconds 70]

By the rules of Cassandra's files, and of the domains that ship, the robot starts again after a goal.
"""

from __future__ import annotations

import argparse

import numpy as np
from tabulate import tabulate

import harness
from harness.policy.alpha import AlphaVectorPolicy


def first_goal(name: str) -> harness.Domain:
    """The named domain, one hidden factor of S values, with its goals as ends."""
    domain = harness.load(name)
    t, S, A = domain.arrays, domain.n_joint, domain.n_actions
    T, R, Z = np.zeros((A, S, S)), np.zeros((A, S, S)), np.zeros((A, S, domain.n_observations))
    Z[..., 0] = 1.0  # of what is never entered
    for a in range(A):
        for s in range(S):
            row = t["first_row"][a] + s
            for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
                after = t["outcome_value"][j]
                T[a, s, after] += t["outcome_probability"][j]
                R[a, s, after] = t["outcome_reward"][0][j]
                Z[a, after] = t["observation_probability"][t["outcome_observation"][j]]
    goals = np.flatnonzero((R > 0).any(axis=(0, 1)))
    T[:, goals], R[:, goals] = np.eye(S)[goals], 0.0
    return harness.from_arrays(T, Z, R, t["prior_marginals"][0], domain.discount, name=f"{name}-first-goal")


def main() -> None:
    """Solve, play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=70.0, help="of solving")
    options = parser.parse_args()
    rows = []
    for name in ("hallway", "hallway2"):
        domain = first_goal(name)
        solved = harness.solve(domain, gap=0.005, seconds=options.seconds)
        policy = AlphaVectorPolicy(domain, solved.solution)
        score = harness.evaluate(domain, policy, episodes=4000, horizon=250, engine="tables").score
        earned = f"{score.discounted_mean:.3f} ± {score.discounted_sem:.3f}"
        rows.append((name, f"{solved.lower:.4f} to {solved.upper:.4f}", earned))
    print(tabulate(rows, headers=("domain", "optimum", "earned")))


if __name__ == "__main__":
    main()
