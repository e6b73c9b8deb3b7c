"""A short cut of the parser: programs as evolution writes them, piece by piece, each compiled once only.

Operations behind one test at most, and blocks behind a condition, are pieces that come again in thousands of programs.
Whatever else a text has, an error above all, is left to the parser.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from harness.program.words import AGAIN, CALL, ELSE, IF, INSTRUCTION, WHILE, Words, instruction

TEST = rf"(?:{CALL}|\d+)\s*(?:==|<|>)\s*(?:\d+(?:\.\d+)?|\"[^\"\n]*\"|'[^'\n]*'|[A-Za-z_]\w*)"
SIMPLE = rf"(?:(?P<guard>if|while)\s*\(\s*(?P<test>{TEST})\s*\)\s*)?(?P<action>{CALL})(?!\s*(?:==|<|>|else\b))"
"""A whole operation, behind one test at most."""
_PLAIN = r"[^(){}\"'#]|\"[^\"\n]*\"|'[^'\n]*'"
_CONDITION = rf"(?:{_PLAIN}|\((?:{_PLAIN}|\((?:{_PLAIN})*\))*\))*"
"""With parentheses in pairs, so that it ends where the parser ends it; those of calls and two more at most."""
_PIECE = re.compile(
    rf"\s+|(?P<simple>{SIMPLE})|(?P<if>if\s*\({_CONDITION}\)\s*\{{)|(?P<while>while\s*\({_CONDITION}\)\s*\{{)"
    r"|(?P<else>\}\s*else\s*\{)|(?P<end>\})|(?P<rest>[\s\S]+)"
)
"""What is no such piece is taken with all after it, so that no place of it is looked at twice."""
_STATEMENTS = re.compile(rf"{re.sub(r'[?]P<[a-z]+>', '?:', SIMPLE)}|\S[\s\S]*")
_LOOP = re.compile(r"\s*loop\s")
_DEEP = 20  # blocks within one another; more are left to the parser, which says how many there may be
_SIZE = INSTRUCTION.itemsize


class Short(NamedTuple):
    """What the short cut has compiled."""

    code: bytes
    loop: bool


class _Block(NamedTuple):
    """One that has not ended yet; places are instructions of the program."""

    op: int
    start: int
    """Where its condition begins."""
    jump: int
    """Where the jump stands whose target is its end."""


def short(text: str, words: Words, compiled: Callable[[str], bytes]) -> Short | None:
    """The code of a program whose pieces are all known or ``compiled``; None for what is left to the parser.

    Raises:
        ProgramError: by ``compiled``, whose places are those of the piece.
    """
    if plain := _plain(text, words):
        return Short(plain, False)
    loop = _LOOP.match(text)
    code, open_blocks = bytearray(), list[_Block]()
    for piece in _PIECE.finditer(text, loop.end() if loop else 0):
        kind = piece.lastgroup
        if kind == "simple":
            code += _known(piece.group(), words, compiled)
        elif kind in _OPENING:
            start = len(code) // _SIZE
            code += _head(piece.group(), kind, words, compiled)
            open_blocks.append(_Block(_OPENING[kind][0], start, len(code) // _SIZE - 1))
        elif kind in ("end", "else"):
            if not open_blocks or not _closed(code, open_blocks, kind):
                return None
        elif kind is not None or len(open_blocks) > _DEEP:
            return None
    return Short(bytes(code), loop is not None) if code and not open_blocks else None


def _plain(text: str, words: Words) -> bytes | None:
    """A list of nothing but operations that have been met before: scripts without feedback, in half the time."""
    try:
        return b"".join([words.statements[statement] for statement in _STATEMENTS.findall(text)])
    except KeyError:
        return None


_OPENING = {"if": (IF, 1), "while": (WHILE, 2)}
"""What a head compiles to, and the instructions that end it with a block of one operation."""


def _known(piece: str, words: Words, compiled: Callable[[str], bytes]) -> bytes:
    found = words.statements.get(piece)
    if found is None:
        found = words.statements[piece] = compiled(piece)
    return found


def _head(head: str, kind: str, words: Words, compiled: Callable[[str], bytes]) -> bytes:
    """A condition and the room for its jump: what a block of any one operation begins with."""
    whole = _known(f"{head}{next(iter(words.actions))}}}", words, compiled)
    return whole[: -_OPENING[kind][1] * _SIZE]


def _closed(code: bytearray, open_blocks: list[_Block], kind: str) -> bool:
    """The last block ends, and perhaps its ``else`` begins; whether that could be."""
    block = open_blocks.pop()
    if len(code) == (block.jump + 1) * _SIZE or (kind == "else" and block.op != IF):
        return False
    middle = len(code) // _SIZE
    if kind == "else":
        code += bytes(_SIZE)
        open_blocks.append(_Block(ELSE, block.jump, middle))
    elif block.op == WHILE:
        code += instruction(AGAIN, jump=block.start - middle - 1)
    arg = block.jump - block.start if block.op == ELSE else 0
    jump = instruction(block.op, arg, jump=len(code) // _SIZE - block.jump - 1)
    code[block.jump * _SIZE : (block.jump + 1) * _SIZE] = jump
    return True
