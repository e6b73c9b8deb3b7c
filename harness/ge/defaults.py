"""The grammar that a domain is searched with when none is named."""

from __future__ import annotations

import os
from pathlib import Path

from harness import registry
from harness.errors import HarnessError, nearest, quoted
from harness.ge import grammar as bnf
from harness.ge.grammar import Grammar
from harness.model.domain import Domain
from harness.program import words_of


def grammar_for(domain: Domain, name: str | Path | None) -> Grammar:
    """A grammar by its file, by the name of a shipped one, or by default.

    ``states`` is made for the domain: a script for each visible value, entered where the episode is. The default is
    the paper's grammar of the domain where it has one (eight rocks for RockSample), else a grammar of
    the paper's form with the domain's own words.

    Raises:
        GrammarError: the file is no usable grammar.
        HarnessError: there is no such file.
    """
    if name is None:
        shipped = _SHIPPED.get(domain.layout["kind"])
        if shipped is None or (shipped == "rocksample" and len(domain.features) != 8):
            return bnf.parse(_of_words(domain), f"grammar of {domain.name}")
        return bnf.read(registry.grammar_path(shipped))
    if name == STATES:
        return bnf.parse(_of_states(domain), f"grammar of scripts for the states of {domain.name}")
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
_MOST_STATES = 200  # more scripts than an individual could ever be given time for

_SHIPPED = {"rocksample": "rocksample", "bordercross": "bordercross"}


def _of_words(domain: Domain) -> str:
    """Operations, and conditions over one belief or the last reading, as in the paper's Algorithm 1."""
    words = words_of(domain)
    labels = [label for label in words.labels if label != "none"]
    tests = [f"'{words.reading} == \"'<label>'\"'"]
    if words.beliefs:
        tests.append("<belief> '>' 0.<digit><digit>")
    spelled = {index: name for name, index in words.actions.items()}
    rules = {
        "code": ["<line>", "<code> <line>"],
        "line": ["<op>", "if(<condition>) <op>"],
        "condition": tests,
        "label": [_quoted(label) for label in labels],
        "op": [_quoted(name) for name in spelled.values()],
    }
    if words.beliefs:
        rules |= {"belief": [_quoted(name) for name in words.beliefs], "digit": [str(d) for d in range(10)]}
    return "".join(f"<{name}> ::= {' | '.join(alternatives)}\n" for name, alternatives in rules.items())


def _of_states(domain: Domain) -> str:
    """A program of one short script for each visible value, started again and again: what the paper leaves to future
    work (section 6).

    Raises:
        HarnessError: the domain names no visible values, or too many.
    """
    places = words_of(domain).places
    if not 1 <= len(places) <= _MOST_STATES:
        raise HarnessError(
            f"{domain.name} has {len(places):,} named visible values; grammar {STATES} has a script for each of "
            f"{_MOST_STATES} at most"
        )
    sections = " ".join(f"'if({place}) {{ '<code>' }}'" for place in places)
    return f"<program> ::= 'loop '{sections}\n" + _of_words(domain)


def _quoted(text: str) -> str:
    return f'"{text}"'
