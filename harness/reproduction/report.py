"""``report.md``: every published value beside ours with its error, and where they differ, and why."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from harness import registry
from harness.ge.folder import provenance
from harness.ge.parameters import Parameters
from harness.reproduction import baselines, findings, paper
from harness.reproduction.folder import Folder
from harness.reproduction.sizes import FULL
from harness.reproduction.wording import parts, plus_minus, prose, table, verdict
from harness.score import rendering
from harness.score.bounds import OPTIMUM, optimum
from harness.solver.solution import Bounds
from harness.tuning.ascent import ForwardDifference
from harness.tuning.method import settings_of


def text(folder: Folder) -> str:
    """The whole report, from the results in the folder."""
    scores = folder.read(baselines.TABLE).set_index("policy").to_dict("index")
    return (
        parts(
            _head(folder),
            _layouts(),
            _table_1(scores),
            _random(scores),
            _table_2(folder),
            _table_3(folder),
            findings.search(folder),
            findings.thresholds(folder),
            findings.crossing(folder),
        )
        + "\n"
    )


def _head(folder: Folder) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in provenance()["versions"].items())
    sizes = folder.sizes
    size = f"Full size: the paper's (Tables 2 and 3), and {sizes.runs} runs of everything that it shows one of."
    if sizes != FULL:
        smaller = [f"{k} {v:,} (full: {getattr(FULL, k):,})" for k, v in asdict(sizes).items() if v != getattr(FULL, k)]
        size = "**Smaller than the paper's sizes, so the numbers are rough**: " + "; ".join(smaller) + "."
    return parts(
        "# The paper, regenerated",
        f"{size} Engine {folder.engine}; {versions}.",
        prose("""Returns are sums of rewards within 50 steps, undiscounted unless it says otherwise; ± is one standard
            error of the mean over episodes, quartiles are over independent runs. Scores are on fresh episodes, which
            nothing was chosen or tuned on. The paper gives no error for any of its values."""),
    )


def _layouts() -> str:
    states = registry.load(paper.ROCKSAMPLE).n_states - 1
    same = "the same" if states == paper.STATES else "another number"
    return parts(
        "## Figures 1 and 2: the problems",
        "![RockSample 7x8](figure1.png) ![BorderCross 7x8](figure2.png)",
        prose(f"""RockSample (7, 8): published |S| = {paper.STATES:,}; ours {states:,}, and one terminal state ({same}).
            The paper names no rock positions; ours are those of every published RockSample(7, 8) result. R is the
            robot's start (R1 and R2: the robots'), X the wall, grey the exit."""),
    )


def _table_1(scores: dict[Any, dict[Any, Any]]) -> str:
    rows = []
    for row in paper.table_1():
        mean, sem = (scores[row.policy][f"discounted_{what}"] for what in ("mean", "sem"))
        rows.append([row.method, f"{row.value:.2f}", plus_minus(mean, sem), row.policy, verdict(mean, sem, row.value)])
    known = optimum(registry.load(paper.ROCKSAMPLE))
    own = scores["qmdp"]
    rows.append(["QMDP", "no value", plus_minus(own["discounted_mean"], own["discounted_sem"]), "qmdp", ""])
    return parts(
        "## Table 1: results from Silver and Veness (discounted by 0.95)",
        table(["method", "published", "ours", "our policy", "verdict"], rows),
        prose("""Where they differ: Silver and Veness do not say how many simulations an action their rollout took
            (ours: 100), nor after how many steps an episode was cut (ours: 50). Our SARSOP was solved for 20 minutes on
            a present-day machine, so it may lie above theirs. QMDP takes everything to be revealed after one step, so
            that readings are worth nothing to it, and it waits for ever."""),
        *([_optimum(scores["sarsop"], known)] if known else []),
    )


def _optimum(sarsop: dict[Any, Any], known: Bounds) -> str:
    published = next(row.value for row in paper.table_1() if row.policy == "sarsop")
    low, high = rendering.outward(known.low, known.high)
    return prose(f"""What there is to earn: the harness's own solver has proven that the optimal value lies between
        {low} and {high}. The published {published:.2f} of SARSOP is {published / known.high:.1%} of it, ours
        {float(sarsop["discounted_mean"]) / known.high:.1%} (the mean's own error aside).""")


def _random(scores: dict[Any, dict[Any, Any]]) -> str:
    most = float(scores[OPTIMUM]["mean"])
    share = {name: 100 * float(row["mean"]) / most for name, row in scores.items()}
    named = ("random", "random-legal", "exit", "rollout:100", "sarsop")
    rows = [[name, plus_minus(scores[name]["mean"], scores[name]["sem"]), f"{share[name]:.1f} %"] for name in named]
    of_all = 10 * len(registry.load(paper.ROCKSAMPLE).layout["rocks"]) + 10
    return parts(
        "### Random rollouts",
        prose(f"""Published: random rollouts earn about {paper.RANDOM_SHARE} % of the maximum reward, and SARSOP would
            get at most {paper.SARSOP_SHARE} %. Ours, as shares of the expected maximum {most:g} (all rocks known):"""),
        table(["policy", "return", "share"], rows),
        prose(f"""The {paper.RANDOM_SHARE} % cannot be reproduced, because neither the rollout policy nor the maximum is
            defined. Moves at random seldom leave within 50 steps, and illegal ones cost 100; the paper's agent "usually
            keeps moving East", as `exit` does, with the odd good rock: {paper.RANDOM_SHARE} % of the reward of all
            rocks and the exit, {of_all}, is {of_all * paper.RANDOM_SHARE / 100:.1f}. SARSOP earns
            {share["sarsop"]:.0f} % here, not at most {paper.SARSOP_SHARE} %: the paper infers that figure from the
            ratio of Table 1's returns, which are discounted and of another kind of rollout."""),
    )


def _table_2(folder: Folder) -> str:
    s = folder.sizes
    used = Parameters(population=s.population, episodes=s.training_episodes, generations=s.generations)
    own = asdict(used) | {
        "generations": f"{s.generations} / {s.threshold_generations}",
        "penalty": f"max(0, length - {used.free_length})·{used.penalty}",
    }
    silent = ("tournament", "elites", "crossover", "crossover_probability", "mutation", "mutation_probability")
    chosen = ", ".join(f"{name} {own[name]}" for name in (*silent, "initialisation", "max_init_depth", "max_wraps"))
    return parts(
        "## Table 2: parameters of grammatical evolution",
        table(["parameter", "published", "ours"], [[row.name, row.value, str(own[row.ours])] for row in paper.TABLE_2]),
        f"The paper is silent on the rest. Ours: {chosen}.",
    )


def _table_3(folder: Folder) -> str:
    used = settings_of(ForwardDifference) | {"episodes": folder.sizes.gradient_episodes}
    own = {name: str(value) for name, value in used.items()} | {"decay": f"α_t exp(−t/{used['decay']:g})"}
    starts = " and ".join(f"{paper.SYMBOL[word]} = {start}" for word, start in paper.START.items())
    return parts(
        "## Table 3: parameters of gradient ascent",
        table(["parameter", "published", "ours"], [[row.name, row.value, own[row.ours]] for row in paper.TABLE_3]),
        prose(f"""The paper clips gradient and momentum and does not say where; ours: {own["gradient_clip"]} and
            {own["velocity_clip"]}. It does not say where it starts; ours: {starts}, on the slopes."""),
    )
