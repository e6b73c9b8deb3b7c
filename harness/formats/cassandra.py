"""Cassandra's ``.pomdp`` format: words, statements of them, and the rules that these say.

Source: A. R. Cassandra, "Input POMDP File Format" (pomdp.org), and the grammar of pomdp-solve.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, nearest, quoted
from harness.formats import limits, text
from harness.formats.network import Columns, Network, Variable
from harness.formats.rules import ANY, EACH, Rules
from harness.formats.words import Words

_PREAMBLE = ("discount", "values", "states", "actions", "observations", "start")
_TABLES = {
    "T": ("actions", "states", "states"),
    "O": ("actions", "states", "observations"),
    "R": ("actions", "states", "states", "observations"),
}
_LETTERS = {"states": "s", "actions": "a", "observations": "o"}
_LARGEST = {
    "states": limits.LARGEST_FACTOR, "actions": limits.LARGEST_COUNT, "observations": limits.LARGEST_COUNT,
}  # fmt: skip
_NAME = re.compile(r"[^\s:#*]+")


@dataclass
class _Reader:
    """A file that is being read."""

    words: Words
    discount: float | None = None
    sign: float = 1.0
    names: dict[str, tuple[str, ...]] = field(default_factory=dict)
    numbers: dict[str, dict[str, int]] = field(default_factory=dict)
    """What a word stands for, by kind: a name, an index or a wildcard."""
    start: NDArray[np.float64] | None = None
    start_token: int = 0
    tables: dict[str, Rules] = field(default_factory=dict)


def parse(contents: bytes, file: str) -> Network:
    """The model of a ``.pomdp`` file's contents; ``file`` is its name in messages.

    Raises:
        HarnessError: it says something else than the format allows; the message has the line.
    """
    reader = _Reader(Words(contents, file))
    while (word := reader.words.next()) is not None:
        if word in _TABLES:
            _statement(reader, word)
        elif word in _PREAMBLE:
            _HEADERS.get(word, _names)(reader, word)
        else:
            known = [*_PREAMBLE, *_TABLES]
            raise reader.words.error(
                f"{quoted(word)} begins no statement{nearest(word, known)}; known: {', '.join(known)}"
            )
    return _network(reader)


def _discount(reader: _Reader, word: str) -> None:
    reader.words.expect(":")
    reader.discount = reader.words.number()
    if not 0 < reader.discount <= 1:
        raise reader.words.error(f"the discount is {reader.discount:g}; it must be above 0, and 1 at most")


def _values(reader: _Reader, word: str) -> None:
    reader.words.expect(":")
    kind = reader.words.need("'reward' or 'cost'")
    if kind not in ("reward", "cost"):
        raise reader.words.error(f"values are {quoted(kind)}; 'reward' or 'cost' is needed")
    if "R" in reader.tables:
        raise reader.words.error("the values' kind comes after the first of them; move 'values:' to the beginning")
    reader.sign = -1.0 if kind == "cost" else 1.0


def _names(reader: _Reader, kind: str) -> None:
    """``states``, ``actions`` or ``observations``: how many, or their names."""
    if kind in reader.names:
        raise reader.words.error(f"the {kind} are listed a second time; leave one list out")
    reader.words.expect(":")
    listed = reader.words.until(_is_header)
    what = f"{reader.words.file}, line {reader.words.line()}: {kind}"
    if len(listed) == 1 and listed[0].isdecimal():
        count = int(listed[0][:20])
        limits.check(what, count, _LARGEST[kind], "make the model smaller")
        listed = [f"{_LETTERS[kind]}{i}" for i in range(count)]
        known = {}
    else:
        limits.check(what, len(listed), _LARGEST[kind], "make the model smaller")
        known = {name: i for i, name in enumerate(listed)}
        _check_names(reader, kind, listed, known)
    if not listed:
        raise reader.words.error(f"there are no {kind}; give their number or their names")
    reader.names[kind] = tuple(listed)
    reader.numbers[kind] = {"*": ANY, **{str(i): i for i in range(len(listed))}, **known}


def _check_names(reader: _Reader, kind: str, listed: list[str], known: dict[str, int]) -> None:
    for i, name in enumerate(listed):
        if known[name] != i:
            raise reader.words.error(f"two {kind} are called {quoted(name)}; give one another name")
        if name == ":":
            raise reader.words.error(
                f"a colon follows {quoted(listed[i - 1])}, which begins no statement"
                f"{nearest(listed[i - 1], [*_PREAMBLE, *_TABLES])}"
            )
        if not _NAME.fullmatch(name) or name[0].isdigit() or not name.isprintable() or len(name) > 200:
            raise reader.words.error(f"{quoted(name)} among the {kind} is no name; names begin with a letter")


def _is_header(word: str, following: str | None) -> bool:
    """Whether a word begins the next statement, and is no name in a list."""
    if word in _TABLES or word in _PREAMBLE:
        return following == ":" or (word == "start" and following in ("include", "exclude"))
    return False


def _start(reader: _Reader, word: str) -> None:
    words, states = reader.words, _known(reader, "states")
    reader.start_token = words.token - 1
    way = words.next() if words.peek() in ("include", "exclude") else None
    words.expect(":")
    listed = words.until(_is_header)
    n = len(reader.names["states"])
    if way:
        chosen = np.zeros(n, dtype=np.bool_)
        chosen[[_state(reader, name, states) for name in listed]] = True
        reader.start = _even(reader, chosen if way == "include" else ~chosen)
    elif listed == ["uniform"]:
        reader.start = _even(reader, np.ones(n, dtype=np.bool_))
    elif len(listed) == n and (n > 1 or listed[0] not in states):
        reader.start = _numbers(words, listed)
    elif len(listed) == 1:
        reader.start = _even(reader, np.arange(n) == _state(reader, listed[0], states))
    else:
        raise words.error(f"the start has {len(listed):,} numbers for {n:,} states; give one for each state")


def _numbers(words: Words, listed: list[str]) -> NDArray[np.float64]:
    try:
        return np.array([text.number(each, "") for each in listed])
    except HarnessError:
        raise words.error("the start has a word among its numbers; give one number for each state") from None


def _state(reader: _Reader, name: str, states: dict[str, int]) -> int:
    if states.get(name, ANY) < 0:
        raise reader.words.error(f"the start names {quoted(name)}, which is no state{nearest(name, states)}")
    return states[name]


def _even(reader: _Reader, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    if not chosen.any():
        raise reader.words.error("the start leaves no state; name those that an episode may begin in")
    return chosen / chosen.sum()


_HEADERS: dict[str, Callable[[_Reader, str], None]] = {"discount": _discount, "values": _values, "start": _start}


def _known(reader: _Reader, kind: str) -> dict[str, int]:
    if kind not in reader.numbers:
        raise reader.words.error(f"the {kind} are not listed yet; '{kind}:' must come before")
    return reader.numbers[kind]


def _statement(reader: _Reader, table: str) -> None:
    """``T``, ``O`` or ``R``: the values it is at, and one number, a row or a matrix."""
    words, kinds, line = reader.words, _TABLES[table], reader.words.token - 1
    if table not in reader.tables:
        _begin(reader, table)
    where = _where(reader, kinds)
    missing = len(kinds) - len(where)
    if missing == 0:
        reader.tables[table].add(where, words.number() * _sign(reader, table) + 0.0, line)  # no -0.0
    elif missing > 2:
        raise words.error(f"{table} needs {len(kinds) - 2} of {' : '.join(kinds)} at least before its numbers")
    else:
        _row_or_matrix(reader, table, [*where, *[EACH] * missing], line)


def _where(reader: _Reader, kinds: tuple[str, ...]) -> list[int]:
    """The values that a statement is at, as far as it says them."""
    words, where = reader.words, list[int]()
    ahead = words.ahead(2 * len(kinds))
    for kind, colon, word in zip(kinds, ahead[::2], ahead[1::2], strict=False):
        if colon != ":":
            break
        index = reader.numbers[kind].get(word)
        if index is None:
            words.skip(2 * len(where) + 2)
            known = reader.names[kind]
            raise words.error(f"{quoted(word)} is none of the {len(known):,} {kind}{nearest(word, known)}")
        where.append(index)
    words.skip(2 * len(where))
    return where


def _sign(reader: _Reader, table: str) -> float:
    return reader.sign if table == "R" else 1.0


def _begin(reader: _Reader, table: str) -> None:
    """The rules of a table, at its first statement."""
    for kind in ("states", "actions"):
        _known(reader, kind)
    if "observations" in _TABLES[table] and "observations" not in reader.numbers:  # the file is an MDP
        reader.names["observations"], reader.numbers["observations"] = ("none",), {"*": ANY, "0": 0}
    c = Columns(1, 1, 1)
    step = (c.action(0), c.before(0), c.after(0))
    columns = {"T": step, "O": (c.action(0), c.after(0), c.reading(0)), "R": (*step, c.reading(0))}
    sizes = [len(reader.names[kind]) for kind in _TABLES[table]]
    reader.tables[table] = Rules(columns[table], sizes, reader.words.token - 1)


def _row_or_matrix(reader: _Reader, table: str, where: list[int], line: int) -> None:
    words, rules = reader.words, reader.tables[table]
    anywhere = [ANY if value == EACH else value for value in where]
    word = words.peek()
    if word == "uniform" and table != "R":
        rules.add(anywhere, 1.0 / rules.sizes[-1], line)
    elif word == "identity" and table != "R" and where[1] == EACH and rules.sizes[-2] == rules.sizes[-1]:
        rules.add_identity(where, line)
    elif word == "reset" and table == "T":
        rules.add_table([*anywhere[:-1], EACH], _initial(reader).tolist(), line)
    else:
        count = math.prod(size for size, value in zip(rules.sizes, where, strict=True) if value == EACH)
        sign = _sign(reader, table)
        rules.add_table(where, [number * sign + 0.0 for number in words.numbers(count)], line)
        return
    words.next()


def _initial(reader: _Reader) -> NDArray[np.float64]:
    n = len(reader.names["states"])
    return np.full(n, 1.0 / n) if reader.start is None else reader.start


def _network(reader: _Reader) -> Network:
    given = {**reader.names, **reader.tables, **({} if reader.discount is None else {"discount": None})}
    for what in ("discount", "states", "actions", "T"):
        if what not in given:
            raise HarnessError(f"{reader.words.file}: there is no '{what}:' in it; the model needs one")
    for table in ("O", "R"):
        if table not in reader.tables:
            _begin(reader, table)
    if len(reader.names["observations"]) == 1 and not len(reader.tables["O"]):
        reader.tables["O"].add([ANY, ANY, ANY], 1.0, 0)
    begin = Rules([Columns(1, 1, 1).before(0)], [len(reader.names["states"])], reader.start_token)
    begin.add_table([EACH], _initial(reader).tolist(), reader.start_token)
    t, o, r = (reader.tables[name] for name in "TOR")
    return Network(
        reader.words.file, float(reader.discount or 0), (Variable("action", reader.names["actions"]),),
        (Variable("state", reader.names["states"]),), (Variable("observation", reader.names["observations"]),),
        (begin.distribution(),), (t.distribution(),), (o.distribution(),), (r.value(),), reader.words.line_of,
    )  # fmt: skip
