"""XML as a tree with lines, read by expat with everything refused that a model file has no need of.

A document type can define entities, which a few bytes can make gigabytes of, and name files to be read in: a file with
one is refused before it is followed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from harness.errors import HarnessError, quoted

_DEEPEST = 500
"""Elements within elements; a decision diagram takes two for each variable."""


@dataclass(slots=True)
class Element:
    """An element of a file."""

    name: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def words(self) -> list[str]:
        """The words of its text."""
        return "".join(self.pieces).split()

    def all(self, *names: str) -> Iterator[Element]:
        """Its children with these names."""
        return (child for child in self.children if child.name in names)


def parse(contents: bytes, file: str) -> Element:
    """The outermost element of a document.

    Raises:
        HarnessError: it is no XML, has a document type, or is too deep.
    """
    builder = _Builder(file)
    try:
        builder.parser.Parse(contents, True)
    except expat.ExpatError as error:
        raise HarnessError(f"{file}, line {error.lineno}: no XML ({expat.ErrorString(error.code)}); mend it") from None
    except (LookupError, ValueError) as error:
        if isinstance(error, HarnessError):
            raise
        raise HarnessError(f"{file}: its encoding is not known; save it as UTF-8") from None
    return builder.open[0].children[0]


class _Builder:
    def __init__(self, file: str) -> None:
        self.file, self.open = file, [Element("", {}, 0)]
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refuse

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        if len(self.open) > _DEEPEST:
            raise HarnessError(f"{self.file}, line {line}: over {_DEEPEST} elements within each other; flatten it")
        element = Element(name, attributes, line)
        self.open[-1].children.append(element)
        self.open.append(element)

    def _end(self, name: str) -> None:
        self.open.pop()

    def _text(self, piece: str) -> None:
        self.open[-1].pieces.append(piece)

    def _refuse(self, name: str, *_: object) -> None:
        line = self.parser.CurrentLineNumber
        raise HarnessError(
            f"{self.file}, line {line}: a document type ({quoted(name)}) is not read; take <!DOCTYPE> out"
        )
