"""What the pages take from elsewhere when they are built, so that it cannot differ: commands and figures."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from harness.cli import help_texts

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


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
