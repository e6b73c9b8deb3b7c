"""The words of a ``.pomdp`` file, split piece by piece, and the lines that they stand in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from harness.errors import HarnessError, quoted
from harness.formats import text

_PIECE = 2**20
_COMMENT = re.compile(rb"#[^\n]*")


class Words:
    """Reads one word after the other; a colon is a word of its own. Lines are counted only when they are asked for."""

    def __init__(self, contents: bytes, file: str) -> None:
        """For the contents of a file, which messages call ``file``."""
        self.file, self._contents = file, contents
        self._pieces = _split(contents)
        self._words: list[str] = []
        self._place = self._before = 0

    @property
    def token(self) -> int:
        """How many words have been read."""
        return self._before + self._place

    def next(self) -> str | None:
        """The next word, None at the end."""
        if self._place == len(self._words) and not self._more():
            return None
        self._place += 1
        return self._words[self._place - 1]

    def peek(self, ahead: int = 0) -> str | None:
        """A word that is still to be read."""
        while self._place + ahead >= len(self._words):
            if not self._more():
                return None
        return self._words[self._place + ahead]

    def ahead(self, count: int) -> list[str]:
        """The next words, fewer at the end; they are still to be read."""
        while len(self._words) - self._place < count and self._more():
            pass
        return self._words[self._place : self._place + count]

    def skip(self, count: int) -> None:
        """Take some words that were seen ahead as read."""
        self._place += count

    def _more(self) -> bool:
        """Take in the next piece; whether there was one."""
        piece = next(self._pieces, None)
        if piece is None:
            return False
        self._before += self._place
        self._words = self._words[self._place :] + piece
        self._place = 0
        return True

    def need(self, what: str) -> str:
        """The next word, which must be there."""
        word = self.next()
        if word is None:
            raise self.error(f"the file ends where {what} is needed; is it whole?")
        return word

    def expect(self, sign: str) -> None:
        """The next word must be this one."""
        word = self.need(f"'{sign}'")
        if word != sign:
            raise self.error(f"{quoted(word)} stands where '{sign}' is needed")

    def until(self, ends: Callable[[str, str | None], bool]) -> list[str]:
        """All words up to the one that ends a list."""
        words = []
        while (word := self.peek()) is not None and not ends(word, self.peek(1)):
            words.append(word)
            self.skip(1)
        return words

    def number(self) -> float:
        """The next word as a number."""
        word = self.need("a number")
        try:
            return text.number(word, "")
        except HarnessError:
            raise self.error(f"{quoted(word)} stands where a number is needed") from None

    def numbers(self, count: int) -> list[float]:
        """The next words as numbers."""
        first = self.token
        found = self.ahead(count)
        try:
            values = [text.number(word, "") for word in found]
        except HarnessError:
            values = []
        if len(values) < count:
            self._fail(found, count, first)
        self._place += count
        return values

    def _fail(self, found: list[str], count: int, first: int) -> None:
        """Say which of some words is no number, or that there are too few."""
        for _ in found:
            word = self.peek() or ""
            if not _is_number(word):
                got = self.token - first
                self._place += 1
                raise self.error(
                    f"{quoted(word)} stands where a number is needed: {got:,} of {count:,} numbers are there"
                )
            self._place += 1
        raise self.error(f"the file ends after {len(found):,} of {count:,} numbers; is it whole?")

    def place(self) -> str:
        """File and line of the word that was read last."""
        return f"{self.file}, line {self.line()}"

    def line(self) -> int:
        """Line of the word that was read last."""
        return self.line_of(max(self.token - 1, 0))

    def line_of(self, token: int) -> int:
        """Line, from 1, of the word with a number; of one beyond the end, the last line with a word."""
        counted, last = 0, 1
        for number, line in enumerate(self._contents.split(b"\n"), 1):
            if words := len(_words(line)):
                counted, last = counted + words, number
            if counted > token:
                break
        return last

    def error(self, message: str) -> HarnessError:
        """What is wrong where the last word stands."""
        return HarnessError(f"{self.place()}: {message}")


def _is_number(word: str) -> bool:
    try:
        text.number(word, "")
    except HarnessError:
        return False
    return True


def _split(contents: bytes) -> Iterator[list[str]]:
    begin = 0
    while begin < len(contents):
        end = contents.find(b"\n", begin + _PIECE) + 1 or len(contents)
        yield _words(contents[begin:end])
        begin = end


def _words(piece: bytes) -> list[str]:
    """Those of some whole lines; what is no UTF-8 in a comment does no harm, and is no name elsewhere."""
    bare = _COMMENT.sub(b"", piece).replace(b":", b" : ")
    return bare.decode(errors="replace").split()
