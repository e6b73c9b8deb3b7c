"""Decision diagrams of POMDPX files: every path through one is a rule."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.errors import HarnessError, nearest, quoted
from harness.formats import limits
from harness.formats.markup import Element
from harness.formats.rules import ANY, Rules

if TYPE_CHECKING:
    from harness.formats.pomdpx import Scope

_DEEPEST = 200
"""Nodes and templates on a path; a template that leads to itself has no end."""
_PARTS = ("Node", "SubDAG", "Terminal")


@dataclass(frozen=True, eq=False)
class _Diagram:
    """What a function's diagrams are over, and the templates that they share."""

    scope: Scope
    names: list[str]
    templates: dict[str, Element]


def add(scope: Scope, rules: Rules, names: list[str], parameter: Element) -> None:
    """Add the rules of a function that is given by diagrams, over the variables ``names``.

    Raises:
        HarnessError: a part of a diagram is out of place, or there are too many paths.
    """
    templates = {each.attributes.get("id", ""): each for each in parameter.all("SubDAGTemplate")}
    diagram = _Diagram(scope, names, templates)
    for root in parameter.all("DAG"):
        for where, number, line in _paths(diagram, root, [ANY] * len(names), 0):
            rules.add(where, number, line)
            limits.check(f"{scope.file}, line {root.line}: paths", len(rules), limits.LARGEST_RULES, "use a table")


def _paths(d: _Diagram, parent: Element, where: list[int], depth: int) -> Iterator[tuple[list[int], float, int]]:
    """Every path from an element's only child: values of the variables, the number at its end, the line."""
    part = next(parent.all(*_PARTS), None)
    if part is None or depth > _DEEPEST:
        wrong = f"over {_DEEPEST} nodes follow each other" if part else "nothing follows"
        raise d.scope.error(parent, f"<{parent.name}>: {wrong}; end it with a <Terminal>")
    if part.name == "Terminal":
        yield where, d.scope.numbers(part, part.words or [""])[0], part.line
    elif part.name == "SubDAG":
        yield from _short(d, part, where, depth)
    else:
        i = _variable(d, part)
        for edge in part.all("Edge"):
            value = d.scope.value(edge, d.names[i], edge.attributes.get("val", "").strip())
            if where[i] in (ANY, value) and value >= 0:
                yield from _paths(d, edge, _with(where, i, value), depth + 1)
            elif value < 0:
                raise d.scope.error(edge, "an edge needs a value of its variable, no wildcard")


def _variable(d: _Diagram, element: Element) -> int:
    name = element.attributes.get("var", "").strip()
    if name not in d.names:
        raise d.scope.error(element, f"{quoted(name)} is no variable of this function{nearest(name, d.names)}")
    return d.names.index(name)


def _with(where: list[int], i: int, value: int) -> list[int]:
    return [*where[:i], value, *where[i + 1 :]]


def _short(d: _Diagram, part: Element, where: list[int], depth: int) -> Iterator[tuple[list[int], float, int]]:
    """The diagrams that have a name: ``deterministic``, ``persistent``, ``uniform``, ``template``."""
    kind = part.attributes.get("type", "").strip()
    if kind == "template":
        yield from _paths(d, _template(d, part), where, depth + 1)
    elif kind == "uniform":
        yield where, 1.0 / len(d.scope.variables[d.names[_variable(d, part)]]), part.line
    elif kind == "deterministic":
        i = _variable(d, part)
        value = d.scope.value(part, d.names[i], part.attributes.get("val", "").strip())
        yield _with(where, i, value), 1.0, part.line
    elif kind == "persistent":
        yield from _persistent(d, part, where)
    else:
        raise d.scope.error(part, f"a SubDAG of type {quoted(kind)} is not known; mend its type")


def _template(d: _Diagram, part: Element) -> Element:
    name = part.attributes.get("idref", "").strip()
    if name not in d.templates:
        raise d.scope.error(part, f"there is no template {quoted(name)} in this function{nearest(name, d.templates)}")
    return d.templates[name]


def _persistent(d: _Diagram, part: Element, where: list[int]) -> Iterator[tuple[list[int], float, int]]:
    """The variable keeps the value that it had before the step."""
    i = _variable(d, part)
    variable = d.scope.variables[d.names[i]]
    both = [k for k, name in enumerate(d.names) if d.scope.variables[name] is variable]
    if len(both) != 2:
        raise HarnessError(
            f"{d.scope.file}, line {part.line}: {d.names[i]} can persist only where the function depends on what it "
            "was before; name that among the parents"
        )
    for value in range(len(variable)):
        if all(where[k] in (ANY, value) for k in both):
            yield _with(_with(where, both[0], value), both[1], value), 1.0, part.line
