"""The words of the program language: what a domain lets a program say, and what each word compiles to."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.errors import PolicyError, nearest, quoted
from harness.model.agents import local_view
from harness.model.domain import Domain

ACT, IF, ELSE, WHILE, AGAIN, NOT, AND, OR, BELIEF, VISIBLE, READING, REGISTER, AT = range(13)
"""Operations; :mod:`harness.program.machine` says what each does."""

BELOW, ABOVE, EQUAL = range(3)
COMPARISONS = {"<": BELOW, ">": ABOVE, "==": EQUAL}
"""Comparisons of BELIEF, VISIBLE and READING; REGISTER, AT and labels know EQUAL only."""

INSTRUCTION = np.dtype(
    [("op", np.int16), ("compare", np.int16), ("arg", np.int32), ("jump", np.int64), ("value", "f8")]
)
"""One instruction of a compiled program."""
_PACKED = struct.Struct("=hhiqd")


def instruction(op: int, arg: int = 0, jump: int = 0, compare: int = 0, value: float = 0.0) -> bytes:
    """One instruction as the bytes of :data:`INSTRUCTION`. Jumps are relative to the instruction after."""
    return _PACKED.pack(op, compare, arg, jump, value)


KEYWORDS = ("if", "else", "while", "and", "or", "not", "loop")
CALL = r"[A-Za-z_][\w-]*[ \t]*\([\d,\s]*\)"
"""What an operation or a quantity looks like in a program."""

_TEST = re.compile(
    r"(?P<left>.+?)\s*(?P<compare>==|<|>)\s*(?:(?P<number>\d+(?:\.\d+)?)|\"(?P<double>.*)\"|'(?P<single>.*)'|(?P<bare>\S+))",
    re.DOTALL,
)
_INDEX = 1  # the row of Words.numbers that is compared with a label's index
_LARGEST_NUMBER = 1e9  # up to it every number is spelled as it was read
_CHECK = re.compile(r"check\((\d+)\)")
_READING_WORDS = {"bordercross": "distance()"}


@dataclass(frozen=True, eq=False, repr=False)
class Words:
    """What programs may say on a domain (SPEC section 4). Arrays are what the compiled interpreter needs."""

    domain: Domain
    actions: dict[str, int]
    """An operation and its action index: ``up()``, ``check(3)``; ``action(2)`` is the second one of a domain whose name
    no program can say."""
    beliefs: dict[str, int]
    """A belief feature and its column in the marginals: ``belief(3)``."""
    visible: dict[str, int]
    """A number of the visible part and its column in ``domain.visible_values``: ``x()``."""
    places: dict[str, int]
    """A test for a visible value, ``at(4,1)``, and its index; none where nothing is visible, or several look alike."""
    reading: str
    """The latest observation: ``distance()`` on BorderCross, ``reading()`` elsewhere."""
    labels: dict[str, int]
    """An observation's label and its index."""
    checks: dict[str, int]
    """``3`` in ``3 == "good"``, and the register that keeps the last reading of ``check(3)``."""
    sensors: dict[str, int]
    """``3`` in ``3 == "good"`` where a sensor reads unasked after every step, and its row in :attr:`numbers`."""
    numbers: NDArray[np.float64]
    """(2 + J, O) what the READING of an observation is: its label as a number, NaN where it is none; its index; and of
    each of J sensors the index of the sensor's label in it."""
    register: NDArray[np.int16]
    """(A,) register that keeps an action's reading; −1 for none."""
    agents: tuple[Words, ...] = ()
    """What each agent's section may say, where there are agents."""
    statements: dict[str, bytes] = field(default_factory=dict, repr=False)
    """Code of the simple statements that the parser has met."""
    _known: dict[str, bytes] = field(default_factory=dict, repr=False)

    def meaning(self, text: str) -> bytes:
        """The instruction that an operation or a test compiles to.

        Raises:
            PolicyError: the domain does not know a word of it.
        """
        packed = self._known.get(text)
        if packed is None:
            packed = self._known[text] = self._compile(" ".join(text.split()))
        return packed

    def _compile(self, text: str) -> bytes:
        test = _TEST.fullmatch(text)
        if test is not None:
            return self._test(test)
        name = _tight(text)
        if name in self.actions:
            return instruction(ACT, self.actions[name])
        if name in self.places:
            return instruction(AT, self.places[name], compare=EQUAL, value=self.places[name])
        if self.places and name.startswith("at("):
            raise PolicyError(self._unknown("place", name, self.places))
        if name in self.beliefs or name in self.visible or name == self.reading:
            raise PolicyError(f"{quoted(name)} is no operation: compare it, as in if({name} > …)")
        raise PolicyError(self._unknown("operation", name, self.actions))

    def _test(self, test: re.Match[str]) -> bytes:
        left, compare = _tight(test["left"]), COMPARISONS[test["compare"]]
        label = next((test[group] for group in ("double", "single", "bare") if test[group] is not None), None)
        if left in self.checks:
            return instruction(REGISTER, self.checks[left], compare=EQUAL, value=self._label(test, label, self.labels))
        if left in self.sensors:
            row = self.sensors[left]
            value = self._label(test, label, self.sensor_labels(row))
            return instruction(READING, row, compare=EQUAL, value=value)
        if label is not None and left == self.reading:
            return instruction(READING, _INDEX, compare=EQUAL, value=self._label(test, label, self.labels))
        sources = {**dict.fromkeys(self.beliefs, BELIEF), **dict.fromkeys(self.visible, VISIBLE)}
        if not np.isnan(self.numbers[0]).all():
            sources[self.reading] = READING
        if left not in sources:
            known = [*sources, *(f'{i} == "…"' for i in (*self.checks, *self.sensors))]
            raise PolicyError(self._unknown("quantity", left, known))
        if test["number"] is None:
            raise PolicyError(f"{left} is compared with a number, not with {quoted(label)}")
        if float(test["number"]) > _LARGEST_NUMBER:
            raise PolicyError(f"{left} is compared with a number above {_LARGEST_NUMBER:g}; take a smaller one")
        column = {**self.beliefs, **self.visible}.get(left, 0)
        return instruction(sources[left], column, compare=compare, value=float(test["number"]))

    def sensor_labels(self, row: int) -> dict[str, int]:
        """The labels of the sensor with this row in :attr:`numbers`, and their indices."""
        return {label: i for i, label in enumerate(self.domain.sensors[row - _INDEX - 1].labels)}

    def _label(self, test: re.Match[str], label: str | None, labels: dict[str, int]) -> float:
        text = label if label is not None else test["number"]
        if test["compare"] != "==":
            raise PolicyError(f"a reading is compared by ==, not by {test['compare']}")
        if text not in labels:
            raise PolicyError(self._unknown("reading", text, labels))
        return float(labels[text])

    def _unknown(self, what: str, word: str, known: Iterable[str]) -> str:
        words = list(known)
        shown = " ".join(words[:20]) + (" …" if len(words) > 20 else "")
        return f"{self.domain.name} knows no {what} {quoted(word)}{nearest(word, words)} (known: {shown})"


def words_of(domain: Domain) -> Words:
    """The words of a domain's actions, belief features, visible part and observations."""
    registers: dict[str, int] = {}
    n = domain.n_observations
    register = np.full(domain.n_actions, -1, dtype=np.int16)
    for i, name in enumerate(domain.actions):
        if (check := _CHECK.fullmatch(_tight(name))) is not None:
            register[i] = registers.setdefault(check[1], len(registers))
    return Words(
        domain,
        _operations(domain.actions),
        {name: int(column) for (name, _, _), column in zip(domain.features, domain.feature_columns, strict=True)},
        {f"{name}()": i for i, name in enumerate(domain.visible_names)},
        _places(domain),
        _READING_WORDS.get(domain.layout["kind"], "reading()"),
        {label: i for i, label in enumerate(domain.observations)},
        registers,
        {sensor.name: _INDEX + 1 + j for j, sensor in enumerate(domain.sensors)},
        np.vstack([[_number(label) for label in domain.observations], np.arange(n), domain.labels_of(np.arange(n)).T]),
        register,
        tuple(words_of(local_view(domain, i)) for i in range(len(domain.agents))),
    )


def _operations(names: Iterable[str]) -> dict[str, int]:
    """What each action is called, the last spelling of an index being one that programs can say."""
    found = {_tight(name): i for i, name in enumerate(names)}
    for name, i in list(found.items()):
        if not can_say(name):
            called = f"{name}()"
            found.setdefault(called if can_say(called) and called not in found else f"action({i + 1})", i)
    return found


def can_say(word: str) -> bool:
    """Whether a program can have a word as an operation, or compare it."""
    return re.fullmatch(CALL, word) is not None and word.partition("(")[0] not in KEYWORDS


def in_quotes(label: str) -> str | None:
    """A reading's label as a program says it; None where none can: blanks in a row, or quotes of both kinds."""
    if " ".join(label.split()) != label or ('"' in label and "'" in label):
        return None
    return f"'{label}'" if '"' in label else f'"{label}"'


def _places(domain: Domain) -> dict[str, int]:
    values = domain.visible_values[:, : len(domain.visible_names)].tolist()
    found = {f"at({','.join(map(str, each))})": v for v, each in enumerate(values) if not domain.tables.terminal[v]}
    return found if domain.visible_names and len(found) == int((~domain.tables.terminal).sum()) else {}


def _tight(text: str) -> str:
    """Without blanks inside parentheses and around commas: ``check( 3 )`` is ``check(3)``."""
    return re.sub(r"\s*([(),])\s*", r"\1", text).strip()


def _number(label: str) -> float:
    try:
        return float(label)
    except ValueError:
        return float("nan")
