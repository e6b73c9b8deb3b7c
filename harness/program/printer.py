"""Compiled program to program text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from harness.model.tables import Records
from harness.program.words import (
    ACT,
    AND,
    AT,
    COMPARISONS,
    ELSE,
    IF,
    NOT,
    OR,
    READING,
    REGISTER,
    VISIBLE,
    WHILE,
    Words,
    in_quotes,
)


def lines(code: Records, words: Words) -> Iterator[str]:
    """The statements of compiled code as text; parsing them gives the code again."""
    return _lines(_Compiled(code, words), 0, len(code), "")


class _Compiled(NamedTuple):
    code: Records
    words: Words


def _lines(program: _Compiled, first: int, last: int, indent: str) -> Iterator[str]:
    """The statements of ``code[first:last]``."""
    code, pc = program.code, first
    while pc < last:
        if code[pc]["op"] == ACT:
            yield f"{indent}{_action(program, pc)}"
            pc += 1
            continue
        condition, head = _condition(program, pc)
        end = head + 1 + int(code[head]["jump"])
        if code[head]["op"] == WHILE:
            yield from _guarded(program, f"while({condition})", head + 1, end - 1, indent)
            pc = end
            continue
        middle = end - 1
        if middle > head and code[middle]["op"] == ELSE and middle - code[middle]["arg"] == head:
            pc = end + int(code[middle]["jump"])
            then = list(_guarded(program, f"if({condition})", head + 1, middle, indent))
            rest = list(_guarded(program, "else", end, pc, indent))
            if then[-1] == f"{indent}}}":
                rest[0] = f"{then.pop()} {rest[0].lstrip()}"
            yield from [*then, *rest]
        else:
            yield from _guarded(program, f"if({condition})", head + 1, end, indent)
            pc = end


def _guarded(program: _Compiled, head: str, first: int, last: int, indent: str) -> Iterator[str]:
    """A statement over a single operation stays on its line; anything else becomes a block."""
    if last == first + 1:
        yield f"{indent}{head} {_action(program, first)}"
    else:
        yield f"{indent}{head} {{"
        yield from _lines(program, first, last, indent + "    ")
        yield f"{indent}}}"


def _action(program: _Compiled, pc: int) -> str:
    return _spelling(program.words.actions, int(program.code[pc]["arg"]))


def _spelling(words: dict[str, int], index: int) -> str:
    """The word of an index; of two spellings the later one, which has parentheses."""
    return [word for word, i in words.items() if i == index][-1]


_PRECEDENCE = {OR: 1, AND: 2}


def _condition(program: _Compiled, pc: int) -> tuple[str, int]:
    """Text of the postfix condition that begins at ``pc``, and where the IF or WHILE after it stands."""
    code = program.code
    stack: list[tuple[str, int]] = []
    while code[pc]["op"] not in (IF, WHILE):
        op = int(code[pc]["op"])
        if op in _PRECEDENCE:
            own = _PRECEDENCE[op]
            (left, above), (right, beside) = stack[-2:]
            left = f"({left})" if above < own else left
            right = f"({right})" if beside <= own else right
            stack[-2:] = [(f"{left} {'and' if op == AND else 'or'} {right}", own)]
        elif op == NOT:
            inner, level = stack.pop()
            stack.append((f"not {inner}" if level == 3 else f"not ({inner})", 3))
        else:
            stack.append((_test(program, pc), 3))
        pc += 1
    return stack[0][0], pc


_SYMBOL = {compare: symbol for symbol, compare in COMPARISONS.items()}


def _test(program: _Compiled, pc: int) -> str:
    words, line = program.words, program.code[pc]
    op, arg, value = int(line["op"]), int(line["arg"]), float(line["value"])
    if op == AT:
        return _spelling(words.places, arg)
    if op == REGISTER:
        return f"{_spelling(words.checks, arg)} == {in_quotes(_spelling(words.labels, int(value)))}"
    if op == READING and arg > 0:
        sensor = arg in words.sensors.values()
        labels = words.sensor_labels(arg) if sensor else words.labels
        asked = _spelling(words.sensors, arg) if sensor else words.reading
        return f"{asked} == {in_quotes(_spelling(labels, int(value)))}"
    left = {READING: lambda: words.reading, VISIBLE: lambda: _spelling(words.visible, arg)}.get(
        op, lambda: _spelling(words.beliefs, arg)
    )()
    return f"{left} {_SYMBOL[int(line['compare'])]} {int(value) if value.is_integer() else repr(value)}"
