"""Quality diversity by pyribs: the best `thresholds` policy for every spread of the return and share of poor ones."""

import numpy as np
from ribs.archives import GridArchive
from ribs.emitters import EvolutionStrategyEmitter
from ribs.schedulers import Scheduler

import harness


def main(iterations=30, batch=40, episodes=500):
    evaluate = harness.Evaluator("rocksample-7x8", policy="thresholds", episodes=episodes)
    subject = evaluate.subject
    archive = GridArchive(solution_dim=len(subject.names), dims=(20, 20), ranges=((0, 12), (0, 1)))
    bounds = list(zip(subject.lower, subject.upper, strict=True))
    emitter = EvolutionStrategyEmitter(archive, x0=subject.start, sigma0=0.1, bounds=bounds, batch_size=batch, seed=1)
    scheduler = Scheduler(archive, [emitter])
    for _ in range(iterations):
        returns = evaluate.returns(scheduler.ask())  # (batch, episodes)
        measures = np.column_stack([returns.std(axis=1), (returns <= 10).mean(axis=1)])
        scheduler.tell(returns.mean(axis=1), measures)
    return evaluate, archive


if __name__ == "__main__":
    evaluate, archive = main()
    best = archive.best_elite
    print(f"{len(archive)} policies; the best returns {best['objective']:.2f}: {evaluate.text(best['solution'])}")
