"""The grammar that a domain is searched with when none is named."""

from __future__ import annotations

import os
from pathlib import Path

from harness import registry
from harness.errors import HarnessError, nearest, quoted
from harness.ge import grammar as bnf
from harness.ge.grammar import Grammar
from harness.model.domain import Domain
from harness.program import Words, words_of


def grammar_for(domain: Domain, name: str | Path | None) -> Grammar:
    """A grammar by its file, by the name of a shipped one, or by default.

    The default is the paper's grammar of the domain where it has one (eight rocks for RockSample), else a grammar of
    the paper's form with the domain's own words.

    Raises:
        GrammarError: the file is no usable grammar.
        HarnessError: there is no such file.
    """
    if name is None:
        shipped = _SHIPPED.get(domain.layout["kind"])
        if shipped is None or (shipped == "rocksample" and len(words_of(domain).checks) != 8):
            return bnf.parse(_of_words(domain), f"grammar of {domain.name}")
        return bnf.read(registry.grammar_path(shipped))
    path = Path(name)
    if path.suffix == ".bnf" or os.path.exists(path):  # unlike Path.exists it takes a name of any length
        return bnf.read(path)
    folder = registry.grammar_path("").parent
    known = sorted(p.stem for p in folder.glob("*.bnf"))
    if str(name) not in known:
        raise HarnessError(
            f"no grammar {quoted(name)}{nearest(str(name), known)} (known: {', '.join(known)}; or a BNF file)"
        )
    return bnf.read(registry.grammar_path(str(name)))


_SHIPPED = {"rocksample": "rocksample", "bordercross": "bordercross"}


def _of_words(domain: Domain) -> str:
    """Operations, and conditions over one belief or the last reading, as in the paper's Algorithm 1."""
    words = words_of(domain)
    tests, labels = _reading_tests(domain, words)
    if words.beliefs:
        tests.append("<belief> '>' 0.<digit><digit>")
    spelled = {index: name for name, index in words.actions.items()}
    rules = {
        "code": ["<line>", "<code> <line>"],
        "line": ["<op>", "if(<condition>) <op>"],
        "condition": tests,
        **labels,
        "op": [_quoted(name) for name in spelled.values()],
    }
    if words.beliefs:
        rules |= {"belief": [_quoted(name) for name in words.beliefs], "digit": [str(d) for d in range(10)]}
    return "".join(f"<{name}> ::= {' | '.join(alternatives)}\n" for name, alternatives in rules.items())


def _reading_tests(domain: Domain, words: Words) -> tuple[list[str], dict[str, list[str]]]:
    """Conditions over the last reading, and the rules of its labels; where sensors read unasked, over that of each."""
    if not domain.sensors:
        labels = [_quoted(label) for label in words.labels if label != "none"]
        return [f"'{words.reading} == \"'<label>'\"'"], {"label": labels}
    tests, rules = [], {}
    for i, shared in enumerate(dict.fromkeys(sensor.labels for sensor in domain.sensors), 1):
        tests.append(f"<sensor{i}> ' == \"'<label{i}>'\"'")
        rules[f"sensor{i}"] = [_quoted(sensor.name) for sensor in domain.sensors if sensor.labels == shared]
        rules[f"label{i}"] = [_quoted(label) for label in shared]
    return tests, rules


def _quoted(text: str) -> str:
    return f'"{text}"'
