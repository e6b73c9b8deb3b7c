"""What each way to select parents, and each structure of the population, is worth: paired seeds, fresh episodes.

    python -m benchmarks.selection --problem feedback --seeds 5

Each beside tournaments of 5 in one population, all with subtree operators and structural mutation, 250 individuals in
100 episodes. A run takes some ten seconds to a minute on one core.
"""

from __future__ import annotations

import argparse

import pandas as pd

import harness

PROBLEMS = {
    "paper": ("rocksample-7x8", "rocksample"),
    "feedback": ("rocksample-7x8", "rocksample-feedback"),
    "border": ("bordercross-7x8", "bordercross"),
}
BASE = {"tournament": 5, "crossover": "subtree", "mutation": "structural", "mutation_probability": 0.6}
WAYS = {
    "tournament 5": {},
    "lexicase": {"selection": "lexicase"},
    "lexicase, cases 0.1": {"selection": "lexicase", "cases": 0.1},
    "lexicase, distinct": {"selection": "lexicase", "distinct": True},
    "distinct": {"distinct": True},
    "novelty": {"selection": "novelty"},
    "map-elites": {"selection": "map-elites"},
    "islands 5": {"islands": 5},
    "layers 5": {"layers": 5},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problem", choices=PROBLEMS, default="feedback")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--generations", type=int, default=100)
    options = parser.parse_args()
    scores = pd.DataFrame(index=pd.RangeIndex(1, options.seeds + 1, name="seed"))
    for name, way in WAYS.items():
        runs = harness.evolve(
            *PROBLEMS[options.problem],
            runs=options.seeds,
            **{**BASE, **way, "seed": 1, "generations": options.generations},
        )
        scores[name] = [run.best.score.mean for run in runs.runs]
        print(f"{name:22} {'  '.join(f'{score:6.2f}' for score in scores[name])}   median {scores[name].median():6.2f}")


if __name__ == "__main__":
    main()
