"""What the pages take from elsewhere when they are built, so that it cannot differ: commands and figures."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.cli import help_texts

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    import pandas as pd


def measured() -> dict[str, list[dict[str, Any]]]:
    """What ``measured.toml`` says, by kind: how a figure was measured, and its ``figure``."""
    return tomllib.loads(Path(__file__).with_name("measured.toml").read_text(encoding="utf-8"))


def figures() -> dict[str, str]:
    """The measured figures by name, as they are printed."""
    return {entry["name"]: entry["figure"] for kind in measured().values() for entry in kind}


def limits() -> dict[str, str]:
    """Limits that the pages name."""
    from harness import files
    from harness.ge import grammar, mapping

    found = {
        "most_bytes": files.LARGEST_SOURCE,
        "most_productions": grammar.MOST_PRODUCTIONS,
        "largest_tree": grammar.LARGEST_TREE,
        "largest_derivation": mapping.LARGEST_DERIVATION,
        "longest_phenotype": mapping.LONGEST_PHENOTYPE,
    }
    return {name: f"{value:,}" for name, value in found.items()}


def commands() -> str:
    """A section for every command, with the text that it prints itself."""
    return "".join(f"\n## `{f'harness {name}'.strip()}`\n\n```text\n{text}```\n" for name, text in help_texts().items())


def literature() -> str:
    """The published figures with ours beside them, and below them where each was read."""
    from tabulate import tabulate

    from harness.score import listing
    from harness.score.literature import literature as table

    found = table()
    read = tabulate(listing.sources(found).to_dict("list"), headers="keys", tablefmt="github", disable_numparse=True)
    whys = "\n".join(f"- {note}" for note in listing.notes(found))
    figures = tabulate(listing.shown(found).to_dict("list"), headers="keys", tablefmt="github", disable_numparse=True)
    return f"\n{figures}\n\n{listing.tally(found)}\n\n## Notes\n\n{whys}\n\n## Where each was read\n\n{read}\n"


def baselines() -> str:
    """The bounds that ship, and a table a domain: what ``docs/baselines.csv``, written by the suite, says."""
    import pandas as pd
    from tabulate import tabulate

    from harness.score import rendering
    from harness.score.aggregation import coverage

    def printed(cells: pd.DataFrame) -> str:
        return tabulate(cells.to_dict("list"), headers="keys", tablefmt="github", disable_numparse=True)

    table = pd.read_csv(Path(__file__).with_name("baselines.csv"))
    dates = " to ".join(sorted({table["date"].min(), table["date"].max()}))
    played = f"Played {dates}; {'; '.join(sorted(set(table['versions'])))}."
    domains = "".join(
        f"\n\n### {domain}\n\n{printed(rendering.shown(part).drop(columns='domain', errors='ignore'))}"
        for domain, part in table.groupby("domain", sort=False)
    )
    covered = printed(rendering.covered(coverage(table)))
    return f"\n{printed(bounds())}\n\n## Over all domains\n\n{played}\n\n{covered}\n\n## Domain by domain{domains}\n"


def bounds() -> pd.DataFrame:
    """The bounds of the optimal value that ship, a row a domain."""
    import pandas as pd

    from harness import load, registry
    from harness.score.rendering import outward
    from harness.solver import solution

    rows = []
    for name in registry.names():
        if (path := registry.policy_path(name, solution.OWN)).exists():
            record = solution.read(path, load(name), *solution.OWN_KINDS).record
            low, high = outward(record["lower"], record["upper"])
            apart = f"{record['upper'] - record['lower']:.3g}"
            rows.append((name, low, high, apart, f"{record['seconds']:.0f}", record["stopped"]))
    return pd.DataFrame(rows, columns=["domain", "lower", "upper", "apart", "seconds", "ended"])
