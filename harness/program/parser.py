"""Program text to compiled program."""

from __future__ import annotations

import re
from typing import NamedTuple, NoReturn

import numpy as np

from harness.errors import PolicyError, quoted
from harness.program.compiled import Program
from harness.program.pieces import SIMPLE, TEST, short
from harness.program.words import (
    ACT,
    AGAIN,
    AND,
    BELIEF,
    CALL,
    ELSE,
    IF,
    INSTRUCTION,
    KEYWORDS,
    NOT,
    OR,
    WHILE,
    Words,
    instruction,
)

MAX_NESTING = 50
"""Blocks and parentheses inside one another; the interpreter keeps pending truth values in the bits of one integer."""

_TOKEN = re.compile(
    rf"(?P<blank>\s+|#[^\n]*)|(?P<simple>{SIMPLE})|(?P<atom>{TEST}|{CALL}|\d+)|(?P<mark>[(){{}}])"
    r"|(?P<word>[A-Za-z_][\w-]*)"
)
"""A whole operation, guarded by one test at most (``simple``), is one token: most programs are a list of these."""
_HEAD = re.compile(r"#[^\n]*|\bagent\(\s*(?P<number>\d{1,9})\s*\)\s*:")
"""Where an agent's section begins; or a comment, which says nothing."""
_PARTS = re.compile(SIMPLE)


class ProgramError(PolicyError):
    """A program text is wrong; the message names the line and the column."""


class NestingError(ProgramError):
    """A program is nested too deep to be compiled; otherwise it may be right."""


class _Token(NamedTuple):
    kind: str
    text: str
    start: int


def parse(text: str, words: Words, *, loop: bool = False, source: str = "program") -> Program:
    """Compile a program text.

    Args:
        text: the program. A first word ``loop`` makes it start again at the top until the episode ends. On a domain
            with agents it may be a program for each of them, below ``agent(1):``, ``agent(2):`` and so on.
        words: of the domain, see :func:`harness.program.words.words_of`.
        loop: start again at the top even without that word.
        source: what to call the text in error messages, such as a file's name.

    Raises:
        ProgramError: with line and column, in one sentence.
    """
    if words.agents and (heads := [match for match in _HEAD.finditer(text) if match["number"]]):
        return _sections(text, heads, words, loop, source)
    try:
        pieces = short(text, words, lambda piece: _Parser(piece, words, source).program(False).code.tobytes())
    except ProgramError:
        pieces = None  # the whole text again, for the place of the error
    if pieces is None:
        return _Parser(text, words, source).program(loop)
    return Program(words, np.frombuffer(pieces.code, INSTRUCTION), loop or pieces.loop)


def constant_spans(text: str, words: Words) -> list[tuple[int, int]]:
    """Where in a program's text the numbers stand that beliefs are compared with: (first character, one past the last).

    They are those of :attr:`harness.program.compiled.Program.constants`, in the same order. ``text`` must be a program.
    """
    spans = []
    for token in _Parser(text, words, "program").tokens:
        test = token.text if token.kind == "atom" else None
        at = token.start
        if token.kind == "simple" and (parts := _PARTS.fullmatch(token.text)) is not None:
            test, at = parts["test"], token.start + max(parts.start("test"), 0)
        if test is not None and words.meaning(test)[:2] == _BELIEF_BYTES:
            number = list(_NUMBER.finditer(test))[-1]
            spans.append((at + number.start(), at + number.end()))
    return spans


def _sections(text: str, heads: list[re.Match[str]], words: Words, loop: bool, source: str) -> Program:
    """A program for each agent, each in words of its own."""
    before = _HEAD.sub("", text[: heads[0].start()]).strip()  # without comments
    if before or [int(head["number"]) for head in heads] != list(range(1, len(words.agents) + 1)):
        wanted = " ".join(f"agent({i}): …" for i in range(1, len(words.agents) + 1))
        raise ProgramError(f"{source}: {words.domain.name} takes a program for each agent, in order: {wanted}")
    ends = [*(head.start() for head in heads[1:]), len(text)]
    parts = [
        _section(text, head.end(), end, own, loop, source)
        for head, end, own in zip(heads, ends, words.agents, strict=True)
    ]
    return Program(words, np.concatenate([part.code for part in parts]), False, tuple(parts))


def _section(text: str, start: int, end: int, words: Words, loop: bool, source: str) -> Program:
    try:
        return parse(text[start:end], words, loop=loop)
    except ProgramError:  # once more with blanks in place of what comes before: for the line and the column
        return parse(re.sub(r"[^\n]", " ", text[:start]) + text[start:end], words, loop=loop, source=source)


class _Gap(NamedTuple):
    piece: int
    position: int
    """Of the instruction in the program."""


class _Parser:
    """Recursive descent, emitting instructions as it goes."""

    def __init__(self, text: str, words: Words, source: str) -> None:
        self.text, self.words, self.source = text, words, source
        self.pieces: list[bytes] = []
        self.size = 0  # instructions in the pieces
        self.nesting = 0
        self.tokens = self._tokens()
        self.next = 0

    def _tokens(self) -> list[_Token]:
        tokens, end = [], 0
        while (match := _TOKEN.match(self.text, end)) is not None:
            kind, text = match.lastgroup, match.group()
            if kind != "blank":
                tokens.append(_Token(kind if kind in ("simple", "atom") else text, text, end))
            end = match.end()
        if end != len(self.text):
            self.fail(end, f"{quoted(self.text[end])} cannot stand here")
        tokens.append(_Token("end", "the end", end))
        return tokens

    def fail(self, at: int, why: str, kind: type[ProgramError] = ProgramError) -> NoReturn:
        line = self.text.count("\n", 0, at) + 1
        column = at - self.text.rfind("\n", 0, at)
        raise kind(f"{self.source}, line {line}, column {column}: {why}")

    def program(self, loop: bool) -> Program:
        if self.tokens[0].kind == "loop":
            loop = True
            self.next = 1
        if self.tokens[self.next].kind == "end":
            self.fail(self.tokens[self.next].start, "the program has no statement; write at least one operation")
        while self.tokens[self.next].kind != "end":
            self.statement()
        return Program(self.words, np.frombuffer(b"".join(self.pieces), INSTRUCTION), loop)

    def statement(self) -> None:
        token = self.tokens[self.next]
        if token.kind == "simple":
            self.next += 1
            self.simple(token)
        elif token.kind == "atom":
            self.next += 1
            self.emit(self.meaning(token.text, token.start, want_action=True))
        elif token.kind == "if":
            self.if_statement()
        elif token.kind == "while":
            self.while_statement()
        elif token.kind == "{":
            self.block()
        elif token.kind == "else":
            self.fail(token.start, "'else' has no 'if' before it")
        elif token.kind == "loop":
            self.fail(token.start, "'loop' can only be the first word of a program")
        else:
            self.expected("an operation, if, while or a block", token)

    def simple(self, token: _Token) -> None:
        """One operation, perhaps behind one test."""
        packed = self.words.statements.get(token.text)
        if packed is None:
            parts = _PARTS.fullmatch(token.text)
            assert parts is not None
            packed = self.meaning(parts["action"], token.start + parts.start("action"), want_action=True)
            if parts["test"] is not None:
                test = self.meaning(parts["test"], token.start + parts.start("test"), want_action=False)
                packed = test + _BEHIND[parts["guard"]](packed)
            self.words.statements[token.text] = packed
        self.emit(packed)

    def meaning(self, text: str, at: int, want_action: bool) -> bytes:
        try:
            packed = self.words.meaning(text)
        except PolicyError as error:
            self.fail(at, str(error))
        is_action = packed[:2] == _ACT_BYTES
        if want_action and not is_action:
            self.fail(at, f"{quoted(text)} is a condition; write if(…) and an operation")
        if not want_action and is_action:
            self.fail(at, f"{quoted(text)} is an operation, where a condition is needed")
        return packed

    def if_statement(self) -> None:
        self.next += 1
        self.deeper()
        self.condition_in_parentheses()
        head = self.placeholder()
        self.statement()
        if self.tokens[self.next].kind == "else":
            self.next += 1
            middle = self.placeholder()
            self.fill(head, IF)
            self.statement()
            self.fill(middle, ELSE, arg=middle.position - head.position)
        else:
            self.fill(head, IF)
        self.nesting -= 1

    def while_statement(self) -> None:
        self.next += 1
        self.deeper()
        start = self.size
        self.condition_in_parentheses()
        head = self.placeholder()
        self.statement()
        self.emit(instruction(AGAIN, jump=start - self.size - 1))
        self.fill(head, WHILE)
        self.nesting -= 1

    def block(self) -> None:
        opening = self.take("{")
        self.deeper()
        if self.tokens[self.next].kind == "}":
            self.fail(opening.start, "the block is empty; put an operation between the braces")
        while self.tokens[self.next].kind != "}":
            if self.tokens[self.next].kind == "end":
                self.fail(opening.start, "the block is never closed; a '}' is missing")
            self.statement()
        self.next += 1
        self.nesting -= 1

    def condition_in_parentheses(self) -> None:
        self.take("(")
        self.condition()
        self.take(")")

    def condition(self) -> None:
        self.conjunction()
        while self.tokens[self.next].kind == "or":
            self.next += 1
            self.conjunction()
            self.emit(instruction(OR))

    def conjunction(self) -> None:
        self.negation()
        while self.tokens[self.next].kind == "and":
            self.next += 1
            self.negation()
            self.emit(instruction(AND))

    def negation(self) -> None:
        token = self.tokens[self.next]
        self.deeper()
        if token.kind == "not":
            self.next += 1
            self.negation()
            self.emit(instruction(NOT))
        elif token.kind == "(":
            self.condition_in_parentheses()
        elif token.kind in ("atom", "simple"):
            self.next += 1
            self.emit(self.meaning(token.text, token.start, want_action=False))
        else:
            self.expected("a condition", token)
        self.nesting -= 1

    def emit(self, packed: bytes) -> None:
        self.pieces.append(packed)
        self.size += len(packed) // INSTRUCTION.itemsize

    def placeholder(self) -> _Gap:
        """Room for a jump whose target is not known yet."""
        gap = _Gap(len(self.pieces), self.size)
        self.emit(bytes(INSTRUCTION.itemsize))
        return gap

    def fill(self, gap: _Gap, op: int, arg: int = 0) -> None:
        """The jump leads to what comes next."""
        self.pieces[gap.piece] = instruction(op, arg, jump=self.size - gap.position - 1)

    def deeper(self) -> None:
        self.nesting += 1
        if self.nesting > MAX_NESTING:
            why = f"nested more than {MAX_NESTING} deep; take a part out"
            self.fail(self.tokens[self.next].start, why, NestingError)

    def take(self, mark: str) -> _Token:
        token = self.tokens[self.next]
        if token.kind != mark:
            self.expected(f"'{mark}'", token)
        self.next += 1
        return token

    def expected(self, what: str, token: _Token) -> NoReturn:
        found = token.text if token.kind == "end" else quoted(token.text)
        hint = ""
        if token.kind not in (*KEYWORDS, *"(){}", "atom", "simple", "end"):
            hint = f"; operations are written with parentheses, as in {next(iter(self.words.actions))}"
        self.fail(token.start, f"{what} is expected here, not {found}{hint}")


_BEHIND = {
    "if": lambda action: instruction(IF, jump=1) + action,
    "while": lambda action: instruction(WHILE, jump=2) + action + instruction(AGAIN, jump=-4),
}
"""What follows a single test, and guards an operation."""
_ACT_BYTES, _BELIEF_BYTES = instruction(ACT)[:2], instruction(BELIEF)[:2]
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
