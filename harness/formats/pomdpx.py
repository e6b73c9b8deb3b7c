"""The POMDPX format: variables and functions of them, as tables or decision diagrams.

Source: "PomdpX file format, version 1.0" and ``pomdpx.xsd``, of the APPL toolkit (Kurniawati, Hsu, Lee 2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness.errors import HarnessError, nearest, quoted
from harness.formats import diagrams, limits, markup, text
from harness.formats.markup import Element
from harness.formats.network import Columns, Network, Variable
from harness.formats.rules import ANY, EACH, Function, Rules

_LETTERS = {"StateVar": "s", "ActionVar": "a", "ObsVar": "o"}
_START, _MOVES, _SEEN, _PAID = "InitialStateBelief", "StateTransitionFunction", "ObsFunction", "RewardFunction"
_SECTIONS = ("Description", "Discount", "Variable", _START, _MOVES, _SEEN, _PAID)


@dataclass(frozen=True, eq=False)
class Scope:
    """The variables of a file by the names that functions call them."""

    file: str
    columns: dict[str, int]
    variables: dict[str, Variable]
    values: dict[str, dict[str, int]]
    """Of each variable, what a word stands for: a value's name, its index or a wildcard."""

    def error(self, element: Element, message: str) -> HarnessError:
        """What is wrong with an element."""
        return HarnessError(f"{self.file}, line {element.line}: {message}")

    def value(self, element: Element, name: str, word: str) -> int:
        """Index of a variable's value, or a wildcard.

        Raises:
            HarnessError: the variable has no such value.
        """
        index = self.values[name].get(word)
        if index is None:
            known = self.variables[name].values
            raise self.error(
                element, f"{quoted(word)} is none of the {len(known):,} values of {name}{nearest(word, known)}"
            )
        return index

    def numbers(self, element: Element, words: Sequence[str]) -> list[float]:
        """The numbers that some words of an element say."""
        return [text.number(word, f"{self.file}, line {element.line}") for word in words]


def parse(contents: bytes, file: str) -> Network:
    """The model of a POMDPX file's contents; ``file`` is its name in messages.

    Raises:
        HarnessError: it says something else than the format allows; the message has the line.
    """
    root = markup.parse(contents, file)
    if root.name != "pomdpx":
        raise HarnessError(f"{file}, line {root.line}: <{root.name}> is no POMDPX model; <pomdpx> is needed")
    sections = _sections(root, file)
    states, actions, readings, rewards, scope = _variables(sections["Variable"], file)
    c = Columns(len(actions), len(states), len(readings))
    functions = {name: _functions(scope, sections.get(name, [])) for name in (_START, _MOVES, _SEEN, _PAID)}
    n = len(states)
    return Network(
        file, _discount(sections, file), actions, states, readings,
        _all_of(scope, functions, _START, [c.before(j) for j in range(n)], range(c.before(0), c.after(0))),
        _all_of(scope, functions, _MOVES, [c.after(j) for j in range(n)], range(c.reading(0))),
        _all_of(scope, functions, _SEEN, [c.reading(i) for i in range(len(readings))], range(c.count)),
        _rewards(scope, functions[_PAID], rewards),
    )  # fmt: skip


def _sections(root: Element, file: str) -> dict[str, list[Element]]:
    found: dict[str, list[Element]] = {}
    for element in root.children:
        if element.name not in _SECTIONS:
            more = nearest(element.name, _SECTIONS)
            raise HarnessError(f"{file}, line {element.line}: <{element.name}> is no part of a POMDPX model{more}")
        found.setdefault(element.name, []).append(element)
    for name in ("Discount", "Variable", _START, _MOVES):
        if name not in found:
            raise HarnessError(f"{file}: there is no <{name}> in it; the model needs one")
    return found


def _discount(sections: dict[str, list[Element]], file: str) -> float:
    element = sections["Discount"][0]
    discount = text.number(" ".join(element.words), f"{file}, line {element.line}")
    if not 0 < discount <= 1:
        raise HarnessError(
            f"{file}, line {element.line}: the discount is {discount:g}; it must be above 0, and 1 at most"
        )
    return discount


def _variables(
    sections: Sequence[Element], file: str
) -> tuple[tuple[Variable, ...], tuple[Variable, ...], tuple[Variable, ...], set[str], Scope]:
    """State, action and observed variables, the names of rewards, and what functions call all these."""
    states: list[tuple[Element, Variable]] = []
    actions, readings = list(states), list(states)
    rewards: set[str] = set()
    for element in (child for section in sections for child in section.children):
        if element.name == "RewardVar":
            rewards.add(_attribute(element, "vname", file))
        elif element.name not in _LETTERS:
            raise HarnessError(
                f"{file}, line {element.line}: <{element.name}> is no kind of variable{nearest(element.name, _LETTERS)}"
            )
        else:
            kind = {"StateVar": states, "ActionVar": actions, "ObsVar": readings}[element.name]
            kind.append((element, _variable(element, file)))
    for kind, name in ((states, "StateVar"), (actions, "ActionVar")):
        if not kind:
            raise HarnessError(f"{file}, line {sections[0].line}: there is no <{name}>; the model needs one")
    scope = _scope(file, states, actions, readings)
    of_kinds = [tuple(variable for _, variable in kind) for kind in (states, actions, readings)]
    return of_kinds[0], of_kinds[1], of_kinds[2], rewards, scope


def _attribute(element: Element, name: str, file: str) -> str:
    value = element.attributes.get(name, "").strip()
    if not value or not value.isprintable():
        raise HarnessError(f'{file}, line {element.line}: <{element.name}> needs {name}="…", a name; give it one')
    return value


def _variable(element: Element, file: str) -> Variable:
    visible = element.attributes.get("fullyObs", "false").strip()
    if visible not in ("true", "false", "1", "0"):
        raise HarnessError(f"{file}, line {element.line}: fullyObs is {quoted(visible)}; 'true' or 'false' is needed")
    name = _attribute(element, "vnamePrev" if element.name == "StateVar" else "vname", file)
    base = name[:-2] if element.name == "StateVar" and name.endswith("_0") and len(name) > 2 else name
    return Variable(base, _values(element, name, file), visible in ("true", "1"))


def _values(element: Element, name: str, file: str) -> tuple[str, ...]:
    most = limits.LARGEST_FACTOR if element.name == "StateVar" else limits.LARGEST_COUNT
    what = f"{file}, line {element.line}: values of {name}"
    for child in element.all("NumValues"):
        word = " ".join(child.words)
        if not word.isdecimal() or int(word[:20]) < 1:
            raise HarnessError(f"{file}, line {child.line}: {quoted(word)} is no number of values; 1 or more is needed")
        limits.check(what, int(word[:20]), most, "make the model smaller")
        return tuple(f"{_LETTERS[element.name]}{i}" for i in range(int(word)))
    names = tuple(word for child in element.all("ValueEnum") for word in child.words)
    limits.check(what, len(names), most, "make the model smaller")
    if not names or len(set(names)) < len(names):
        wrong = "has two values of one name" if names else "has no values"
        raise HarnessError(
            f"{file}, line {element.line}: {name} {wrong}; list them in <ValueEnum>, or give <NumValues>"
        )
    if bad := next((word for word in names if word in "*-" or not word.isprintable() or len(word) > 200), ""):
        raise HarnessError(f"{file}, line {element.line}: {quoted(bad)} is no name for a value of {name}; rename it")
    return names


def _scope(
    file: str,
    states: list[tuple[Element, Variable]],
    actions: list[tuple[Element, Variable]],
    readings: list[tuple[Element, Variable]],
) -> Scope:
    names = [*((e, "vname", v) for e, v in actions), *((e, "vnamePrev", v) for e, v in states)]
    names += [*((e, "vnameCurr", v) for e, v in states), *((e, "vname", v) for e, v in readings)]
    scope = Scope(file, {}, {}, {})
    for column, (element, attribute, variable) in enumerate(names):
        name = _attribute(element, attribute, file)
        if name in scope.columns or name == "null":
            raise scope.error(element, f"{quoted(name)} is the name of two variables, or is 'null'; give it another")
        scope.columns[name], scope.variables[name] = column, variable
        by_index = {str(i): i for i in range(len(variable))}
        by_name = {value: i for i, value in enumerate(variable.values)}
        scope.values[name] = {"*": ANY, "-": EACH, **by_index, **by_name}
    return scope


def _functions(scope: Scope, sections: Sequence[Element]) -> list[tuple[str, Element]]:
    """Every function of some sections, and the variable that it is of."""
    found = []
    for element in (child for section in sections for child in section.children):
        if element.name not in ("CondProb", "Func"):
            raise scope.error(element, f"<{element.name}> stands where <CondProb> or <Func> is needed")
        found.append((" ".join(_child(scope, element, "Var").words), element))
    return found


def _child(scope: Scope, element: Element, name: str) -> Element:
    found = next(element.all(name), None)
    if found is None:
        raise scope.error(element, f"<{element.name}> has no <{name}>; it needs one")
    return found


def _all_of(
    scope: Scope,
    functions: dict[str, list[tuple[str, Element]]],
    section: str,
    columns: Sequence[int],
    parents: Sequence[int],
) -> tuple[Function, ...]:
    """The distributions of a section, one for each of some variables, which may depend on ``parents``."""
    names = {scope.columns[name]: name for name in scope.columns}
    wanted, found = [names[column] for column in columns], {}
    for name, element in functions[section]:
        if name not in wanted:
            known = ", ".join(wanted)
            raise scope.error(element, f"<{section}> is of {known}, not of {quoted(name)}{nearest(name, wanted)}")
        if name in found:
            raise scope.error(element, f"{name} has a second distribution in <{section}>; leave one out")
        found[name] = _rules(scope, element, [*_parents(scope, element, parents), name]).distribution()
    for name in wanted:
        if name not in found:
            raise HarnessError(f"{scope.file}: <{section}> has no <CondProb> of {name}; it needs one")
    return tuple(found[name] for name in wanted)


def _parents(scope: Scope, element: Element, allowed: Sequence[int]) -> list[str]:
    parent = _child(scope, element, "Parent")
    names = [] if parent.words == ["null"] else parent.words
    for name in names:
        if scope.columns.get(name, -1) not in allowed:
            some = [each for each, column in scope.columns.items() if column in allowed]
            raise scope.error(parent, f"{quoted(name)} is no variable that this can depend on{nearest(name, some)}")
    if len(set(names)) < len(names):
        raise scope.error(parent, "a parent is named twice; name it once")
    return names


def _rewards(scope: Scope, functions: list[tuple[str, Element]], known: set[str]) -> tuple[Function, ...]:
    rewards = []
    for name, element in functions:
        if name not in known:
            raise scope.error(element, f"{quoted(name)} is no <RewardVar>{nearest(name, known)}; declare it")
        allowed = range(len(scope.columns))
        rewards.append(_rules(scope, element, _parents(scope, element, allowed)).value())
    return tuple(rewards)


def _rules(scope: Scope, element: Element, names: list[str]) -> Rules:
    """The rules of a function of the variables ``names``, in this order."""
    sizes = [len(scope.variables[name]) for name in names]
    rules = Rules([scope.columns[name] for name in names], sizes, element.line)
    parameter = _child(scope, element, "Parameter")
    kind = parameter.attributes.get("type", "TBL").strip()
    if kind == "TBL":
        for entry in parameter.all("Entry"):
            _entry(scope, rules, names, entry)
    elif kind == "DD":
        diagrams.add(scope, rules, names, parameter)
    else:
        raise scope.error(parameter, f"a function of type {quoted(kind)} is not read; TBL or DD is needed")
    return rules


def _entry(scope: Scope, rules: Rules, names: list[str], entry: Element) -> None:
    """One entry of a table: where it holds, and a number, a table of them, or a word for one."""
    instance = _child(scope, entry, "Instance")
    words = instance.words
    if len(words) != len(names):
        raise scope.error(
            instance, f"{len(words)} values for {len(names)} variables: {' '.join(names)}; give one for each"
        )
    where = [scope.value(instance, name, word) for name, word in zip(names, words, strict=True)]
    table = next(entry.all("ProbTable", "ValueTable"), None)
    if table is None:
        raise scope.error(entry, "<Entry> has no <ProbTable> or <ValueTable>; it needs one")
    numbers = table.words
    if numbers == ["uniform"]:
        rules.add([ANY if value == EACH else value for value in where], 1.0 / rules.sizes[-1], table.line)
    elif numbers == ["identity"]:
        sizes = [size for size, value in zip(rules.sizes, where, strict=True) if value == EACH]
        if len(sizes) != 2 or sizes[0] != sizes[1]:
            raise scope.error(table, "'identity' needs two variables marked '-', of equally many values")
        rules.add_identity(where, table.line)
    else:
        _add_numbers(scope, rules, where, table, numbers)


def _add_numbers(scope: Scope, rules: Rules, where: list[int], table: Element, numbers: list[str]) -> None:
    wanted = 1
    for size, value in zip(rules.sizes, where, strict=True):
        wanted *= size if value == EACH else 1
    if len(numbers) != wanted:
        raise scope.error(table, f"{len(numbers):,} numbers where {wanted:,} are needed, one for each value marked '-'")
    values = scope.numbers(table, numbers)
    if EACH in where:
        rules.add_table(where, values, table.line)
    else:
        rules.add(where, values[0], table.line)
