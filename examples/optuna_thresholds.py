"""A study by Optuna over the five numbers of `thresholds`; bad trials are pruned after a few episodes."""

import optuna

import harness


def main(trials=100, episodes=500):
    evaluate = harness.Evaluator("rocksample-7x8", policy="thresholds", episodes=episodes)
    subject = evaluate.subject

    def objective(trial):
        bounds = zip(subject.names, subject.lower, subject.upper, strict=True)
        theta = [trial.suggest_float(name, low, high) for name, low, high in bounds]
        total = 0.0
        for part in range(4):  # four times the episodes, each time others
            total += evaluate([theta], first=part * episodes)[0]
            trial.report(total / (part + 1), part)
            if trial.should_prune():
                raise optuna.TrialPruned
        return total / 4

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=1))
    study.enqueue_trial(dict(zip(subject.names, subject.start, strict=True)))
    study.optimize(objective, n_trials=trials)
    return evaluate.text(list(study.best_params.values())), study.best_value


if __name__ == "__main__":
    policy, value = main()
    print(f"{policy} returns {value:.2f}")
