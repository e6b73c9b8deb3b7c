"""The grammar that a domain is searched with when none is named."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from harness import registry
from harness.errors import HarnessError, nearest, quoted
from harness.ge import derived
from harness.ge import grammar as bnf
from harness.ge.grammar import Grammar
from harness.model.domain import Domain


def grammar(domain: Domain | str, *, feedback: bool = False) -> str:
    """The grammar of a domain's programs as a BNF text: what ``evolve`` takes when no other is named.

    It is the shipped one, written by hand, where there is one for the domain's actions, and is derived from its
    actions, readings, belief features and visible numbers elsewhere. Written to a file it can be changed, and named.

    Args:
        domain: a domain or its name.
        feedback: one whose programs decide about whole blocks, join conditions, and may start again at the top.

    Raises:
        HarnessError: there is no such domain, or it has more words than a grammar can have.
    """
    return _own(registry.load(domain) if isinstance(domain, str) else domain, feedback).text


def grammar_for(domain: Domain, name: str | Path | None) -> Grammar:
    """A grammar by its file, by the name of a shipped one, or the default one, :func:`grammar`.

    ``states`` is made for the domain: a script for each visible value, entered where the episode is.

    Raises:
        GrammarError: the file is no usable grammar.
        HarnessError: there is no such file.
    """
    if name is None:
        return _own(domain)
    if name == STATES:
        return bnf.parse(derived.states(domain), f"grammar of scripts for the states of {domain.name}")
    path = Path(name)
    if path.suffix == ".bnf" or os.path.exists(path):  # unlike Path.exists it takes a name of any length
        return bnf.read(path)
    folder = registry.grammar_path("").parent
    known = sorted([STATES, *(p.stem for p in folder.glob("*.bnf"))])
    if str(name) not in known:
        raise HarnessError(
            f"no grammar {quoted(name)}{nearest(str(name), known)} (known: {', '.join(known)}; or a BNF file)"
        )
    return bnf.read(registry.grammar_path(str(name)))


STATES = "states"
"""Name of the grammar of scripts for states."""


def _own(domain: Domain, feedback: bool = False) -> Grammar:
    shipped = _hand_written(domain, feedback)
    if shipped is not None:
        return bnf.read(registry.grammar_path(shipped))
    return bnf.parse(derived.text(domain, feedback), f"grammar of {domain.name}")


def _hand_written(domain: Domain, feedback: bool) -> str | None:
    """The name of a shipped grammar that knows all of a domain."""
    shipped = _SHIPPED.get((domain.layout["kind"], domain.n_actions))
    if shipped is None or not feedback:
        return shipped and shipped.script
    return shipped.feedback if shipped.size == (domain.layout["rows"], domain.layout["columns"]) else None


class _Shipped(NamedTuple):
    """Grammars that were written by hand."""

    script: str
    feedback: str | None = None
    size: tuple[int, int] | None = None
    """Rows and columns that the one with feedback knows."""


_SHIPPED = {
    ("rocksample", 13): _Shipped("rocksample", "rocksample-feedback", (7, 7)),  # eight rocks
    ("bordercross", 9): _Shipped("bordercross", "bordercross-feedback", (7, 8)),
}
"""By the kind of a domain's layout and the number of its actions."""
