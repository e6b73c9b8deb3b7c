"""A grammar in a domain's own words: its actions, readings, belief features and visible numbers.

Its form is that of the paper's Algorithm 1, a list of operations, each perhaps behind one condition; with feedback also
that of ``grammars/rocksample-feedback.bnf``, without what is known of RockSample.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.program import Words, words_of
from harness.program.words import can_say, in_quotes

WIDEST = 500
"""Alternatives of a rule: more are put into groups, for a codon tells 1,000 apart unless a run says otherwise."""
MOST_COMPARED = 2_000
"""Words of a kind that conditions are about: of what has more (the states of a large flat model), none are."""

MOST_STATES = 200
"""Visible values of a grammar of scripts for states: more scripts than an individual could ever be given time for."""

_LINE = 116  # characters

Rules = dict[str, list[str]]
"""Alternatives of each non-terminal, in Backus-Naur form."""

_SCRIPT: Rules = {
    "code": ["<line>", "<code> <line>"],
    "line": ["<op>"],
}
_FEEDBACK: Rules = {
    "program": ["<code>", "loop <code>"],
    "code": ["<line>", "<line> <code>"],  # to the right, so that codons before a change keep their meaning
    "line": ["<op>"],
}
_GUARDED = ["if(<condition>) <op>"]
_BRANCHES = ["if(<condition>) { <code> }", "if(<condition>) { <code> } else { <code> }", "while(<condition>) <op>"]
_LOGIC = ["<test>", "not <test>", "<test> and <test>", "<test> or <test>"]


def text(domain: Domain, feedback: bool = False) -> str:
    """The grammar as a BNF text; a comment says what had to be left out.

    Args:
        domain: whose words it is in.
        feedback: programs may decide about whole blocks, join conditions, and start again at the top.
    """
    remarks: list[str] = []
    rules = _team(words_of(domain), feedback, remarks) if domain.agents else _rules(words_of(domain), feedback, remarks)
    head = [f"{domain.name}, version {domain.version}: derived from its words.", *remarks]
    return "".join(f"# {line}\n" for line in head) + _written(rules)


def _team(words: Words, feedback: bool, remarks: list[str]) -> Rules:
    """A program for each agent; the rules of agents whose words are the same stand there once."""
    found = [_rules(own, feedback, remarks) for own in words.agents]
    shared = all(each == found[0] for each in found)
    sections, rules = "", Rules()
    for number, each in enumerate(found, 1):
        suffix = "" if shared else f"-{number}"
        own = {name + suffix: [re.sub(r"<([\w-]+)>", rf"<\1{suffix}>", a) for a in each[name]] for name in each}
        sections += f"'{' ' * (number > 1)}agent({number}): '<{next(iter(own))}>"
        rules |= own
    return {"team": [sections], **rules}


def _rules(words: Words, feedback: bool, remarks: list[str]) -> Rules:
    tests = _conditions(words, remarks)
    rules = {name: list(alternatives) for name, alternatives in (_FEEDBACK if feedback else _SCRIPT).items()}
    if tests:
        rules["line"] += _BRANCHES if feedback else _GUARDED
        rules |= {"condition": _LOGIC, "test": tests.pop("")} if feedback else {"condition": tests.pop("")}
    rules |= {
        "op": [_terminal(name) for name in dict(zip(words.actions.values(), words.actions, strict=True)).values()]
    }
    return rules | tests


def states(domain: Domain) -> str:
    """A program of one short script for each visible value, started again and again: what the paper leaves to future
    work (section 6).

    Raises:
        HarnessError: the domain names no visible values, or too many.
    """
    places = words_of(domain).places
    if not 1 <= len(places) <= MOST_STATES:
        raise HarnessError(
            f"{domain.name} has {len(places):,} named visible values; the grammar of scripts for states has one for "
            f"each of {MOST_STATES} at most"
        )
    sections = " ".join(f"'if({place}) {{ '<code>' }}'" for place in places)
    return f"<program> ::= 'loop '{sections}\n" + text(domain)


def _conditions(words: Words, remarks: list[str]) -> Rules:
    """The rules below a condition; the alternatives of the condition itself stand under the empty name."""
    sensors = words.domain.sensors
    labels = [] if sensors else _said(label for label in words.labels if label != "none")
    beliefs = [_terminal(name) for name in words.beliefs if can_say(name)]
    tests: list[str] = []
    rules: Rules = {}
    if labels := _few(labels, "readings", remarks):
        tests += [f"{_terminal(words.reading)} == <label>", *(["<check> == <label>"] if words.checks else [])]
        rules |= {"check": [_terminal(each) for each in words.checks]} if words.checks else {}
        rules["label"] = labels
        if not np.isnan(words.numbers[0]).any() and words.numbers[0].min() >= 0:
            tests.append(f"{_terminal(words.reading)} < <level>")
            rules["level"] = _numbers(words.numbers[0])
    for number, shared in enumerate(dict.fromkeys(sensor.labels for sensor in sensors), 1):
        tests.append(f"<sensor-{number}> == <label-{number}>")
        rules[f"sensor-{number}"] = [_terminal(each.name) for each in sensors if each.labels == shared]
        rules[f"label-{number}"] = _said(shared)
    if beliefs := _few(beliefs, "belief features", remarks):
        tests.append("<belief> > 0.<digit><digit>")
        rules |= {"belief": beliefs, "digit": [str(digit) for digit in range(10)]}
    for number, (name, values) in enumerate(_visible(words), 1):
        if values := _few(values, f"values of {name}", remarks):
            tests.append(f"{_terminal(name)} < <number-{number}>")
            rules[f"number-{number}"] = values
    return {"": tests, **rules} if tests else {}


def _said(labels: Iterable[str]) -> list[str]:
    """Those that a program can say."""
    return [_terminal(said) for label in labels if (said := in_quotes(label))]


def _few(alternatives: list[str], what: str, remarks: list[str]) -> list[str]:
    if len(alternatives) <= MOST_COMPARED:
        return alternatives
    remarks.append(f"No condition is about its {len(alternatives):,} {what}: more than {MOST_COMPARED:,}.")
    return []


def _visible(words: Words) -> Iterable[tuple[str, list[str]]]:
    """The numbers of the visible part that differ before the end, with what each can be compared with."""
    going_on = words.domain.visible_values[~words.domain.arrays["terminal"]]
    for name, column in words.visible.items():
        if can_say(name) and len(values := _numbers(going_on[:, column])):
            yield name, values


def _numbers(values: Iterable[float]) -> list[str]:
    """Those that some values are below; the language has none below 0."""
    rising = np.unique(np.asarray(values, dtype=float))[1:]
    return [np.format_float_positional(value, trim="-") for value in rising[rising >= 0]]


def _terminal(text: str) -> str:
    """A text as a grammar says it: as it is, in quotes, or where both kinds are in it in parts."""
    if re.fullmatch(r"[\w(),.-]+", text):
        return text
    parts = [text] if "'" not in text else re.findall(r"[^']+|'+", text)
    return "".join(f'"{part}"' if "'" in part else f"'{part}'" for part in parts)


def _written(rules: Rules) -> str:
    grouped: Rules = {}
    for name, alternatives in rules.items():
        grouped |= _grouped(name, alternatives)
    width = max(len(name) for name in grouped) + 2
    return "".join(_rule(f"{f'<{name}>':{width}} ::= ", each) for name, each in grouped.items())


def _rule(head: str, alternatives: Sequence[str]) -> str:
    """A rule on as many lines as it needs."""
    lines = [head + alternatives[0]]
    for each in alternatives[1:]:
        if len(lines[-1]) + len(each) > _LINE:
            lines.append(" " * (len(head) - 3))
        lines[-1] += f" | {each}"
    return "".join(f"{line}\n" for line in lines)


def _grouped(name: str, alternatives: Sequence[str]) -> Rules:
    if len(alternatives) <= WIDEST:
        return {name: list(alternatives)}
    groups = [list(alternatives[at : at + WIDEST]) for at in range(0, len(alternatives), WIDEST)]
    names = [f"{name}-{k}" for k in range(1, len(groups) + 1)]
    return {name: [f"<{each}>" for each in names], **dict(zip(names, groups, strict=True))}
