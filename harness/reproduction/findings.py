"""The report's sections on what was searched for: programs, thresholds, crossings (Figures 3 to 7)."""

from __future__ import annotations

import numpy as np
import pandas as pd

from harness.reproduction import baselines, evolutions, paper
from harness.reproduction.figures import best_stretch, span
from harness.reproduction.folder import Folder
from harness.reproduction.wording import parts, plus_minus, prose, quartiles, table


def search(folder: Folder) -> str:
    """Figures 3 and 4."""
    full = _means(folder, evolutions.FULL_SEARCH)
    evolved = folder.read(evolutions.THRESHOLD_RUNS)
    rows = [["full policy search", "no number", quartiles(full)]]
    for word in paper.HEURISTICS:
        own = evolved[evolved["heuristic"] == word]["mean"].tolist()
        rows.append([f"{word}-based policy", '"most of the reward"', quartiles(own)])
    curve = evolutions.search_history(folder, evolutions.FULL_SEARCH).groupby("generation")["test"].median()
    most, least = np.median(full), evolved["mean"].min()
    compared = "stays below" if most < least else "does not stay below"
    return parts(
        "## Figure 3: grammatical evolution on RockSample",
        "![learning curves](figure3.png)",
        table(["what evolved", "published", "ours: the winners on fresh episodes, median of the runs"], rows),
        prose(f"""Published: the full search improves steadily, and the parametrized policies quickly find a threshold
            that gets most of the reward. Here the full search's median goes from {curve.iloc[0]:.2f} in the first
            population to {curve.iloc[-1]:.2f} in the last ({curve.index[-1]} generations), and {compared} the
            parametrized policies, which are at {least:.2f} or more."""),
        prose("""The paper's curves are of the fitness, the mean of 100 episodes that selection has seen, and wobble;
            ours are of the same programs on fresh episodes."""),
        "## Figure 4: best program of the full search",
        'The paper calls its own "not very efficient": it relies on sampling the rock directly south. Ours:',
        _program(folder, "figure4.txt"),
    )


def thresholds(folder: Folder) -> str:
    """Figure 5."""
    rows, remarks = [], []
    ascents = {row["heuristic"]: row for row in folder.read(baselines.ASCENTS).to_dict("records")}
    evolved = folder.read(evolutions.THRESHOLD_RUNS)
    sweeps = folder.read(baselines.SWEEPS)
    for point in folder.read(baselines.POINTS).to_dict("records"):
        word, what = point["heuristic"], point["what"]
        published = {"gradient": paper.GRADIENT, "evolved": paper.EVOLVED}[what][word]
        symbol, ascent = paper.SYMBOL[word], ascents[word]
        ours = f"{ascent['threshold']:.4f}, return {plus_minus(ascent['mean'], ascent['sem'])}"
        if what == "evolved":
            ours = quartiles(evolved[evolved["heuristic"] == word]["threshold"].tolist())
        rows.append(
            [
                f"{word}, {what}",
                f"{symbol} = {published}",
                plus_minus(point["mean"], point["sem"]),
                ours,
                _top(sweeps[sweeps["heuristic"] == word]),
                plus_minus(point["difference"], point["difference_sem"]),
            ]
        )
        if point["plateau"]:
            remarks.append(f"{symbol} = {published} plays the very same episodes as 0.5: it lies on an exact plateau.")
    headers = ["threshold", "published", "its return here", "ours", "top of our sweep", "published − our ascent"]
    stopped = "; ".join(f"{word} from {row['start']:g}: {row['stopped']}" for word, row in ascents.items())
    return parts(
        "## Figure 5: thresholds, swept and by gradient ascent",
        "![sweeps](figure5.png)",
        table(headers, rows),
        "The last column is the difference of the returns on the same episodes, with the paired standard error.",
        *([" ".join(remarks)] if remarks else []),
        prose("""Why they differ: a reading is right with at least 0.87 from any cell, so that up to about 0.90 one
            reading decides and no threshold differs from another. A published optimum on that plateau is one of many
            equal ones; evolution and ascent stop anywhere on it. Above it a second reading pays for `belief` (within 50
            steps and undiscounted), while `accuracy` looks at fewer rocks."""),
        f"Why our ascents stopped: {stopped}.",
    )


def _top(sweep: pd.DataFrame) -> str:
    """Where a sweep is highest, and how high."""
    best = sweep.loc[sweep["mean"] == sweep["mean"].max(), ["mean", "sem"]].to_numpy()[0]
    return f"{span(*best_stretch(sweep))}, return {plus_minus(*best)}"


def crossing(folder: Folder) -> str:
    """Figures 6 and 7."""
    rows = []
    for shaping in paper.SHAPINGS:
        name = evolutions.crossing(shaping)
        crossed = sum(record["score"]["success_rate"] > 0.5 for record in evolutions.winners(folder, name))
        history = evolutions.search_history(folder, name)
        last = history[history["generation"] == folder.sizes.generations]["best"].tolist()
        rows.append([shaping, quartiles(last), quartiles(_means(folder, name)), f"{crossed} of {len(last)}"])
    return parts(
        "## Figure 6: grammatical evolution on BorderCross",
        "![BorderCross](figure6.png)",
        table(["shaping", "fitness at the end", "true team return (500: crossed)", "runs that cross"], rows),
        prose("""Published, without numbers: the search without shaping does not learn to cooperate; with the paper's
            shaping (+1 for standing in one cell, +1 for standing at the wall) the fitness rises, by an exploit of these
            rewards that does not lead to the exit. `potential` is ours: a shaping that leaves the best policy
            unchanged. Where runs of ours cross and the paper's did not, what it does not describe (selection,
            operators, initialisation) may be the reason, or the luck of a single run."""),
        "## Figure 7: best programs on BorderCross",
        _program(folder, "figure7.txt"),
    )


def _means(folder: Folder, name: str) -> list[float]:
    return [float(record["score"]["mean"]) for record in evolutions.winners(folder, name)]


def _program(folder: Folder, name: str) -> str:
    return f"```\n{folder.read_text(name).rstrip()}\n```"
