"""A compiled program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from harness import cards
from harness.model.tables import Records, compiled
from harness.program.liveness import live
from harness.program.printer import lines
from harness.program.words import ACT, AGAIN, BELIEF, ELSE, IF, WHILE, Words


@dataclass(frozen=True, eq=False)
class Program:
    """A compiled program (SPEC section 4)."""

    words: Words
    code: Records
    """(n,) of :data:`harness.program.words.INSTRUCTION`; read-only."""
    loop: bool
    """Whether it starts again at the top until the episode ends."""
    parts: tuple[Program, ...] = ()
    """A program for each agent, of which :attr:`code` is one after the other; none where one controller runs it."""

    def __deepcopy__(self, memo: object) -> Program:
        """Itself: a program never changes, so copies of what holds it share it."""
        return self

    @cached_property
    def text(self) -> str:
        """The program, one statement a line; parsing it gives this program again."""
        if self.parts:
            return "".join(f"agent({i}):\n{part.text}" for i, part in enumerate(self.parts, 1))
        head = ["loop"] if self.loop else []
        return "\n".join([*head, *lines(self.code, self.words)]) + "\n"

    @cached_property
    def line_of(self) -> NDArray[np.int64]:
        """(n,) line of :attr:`text`, counted from 0, that an operation stands on; −1 for instructions that are none."""
        found = np.full(len(self.code), -1)
        # Of printed lines those with an operation end with its parenthesis, and only those: one each, in order.
        found[self.code["op"] == ACT] = [i for i, line in enumerate(self.text.split("\n")) if line.endswith(")")]
        return found

    @cached_property
    def length(self) -> int:
        """Number of statements; an ``if`` or ``while`` over a single operation is one statement with it."""
        return int(_statements(self.code))

    @cached_property
    def live(self) -> NDArray[np.bool_]:
        """(n + 1, registers + factors) at each place, which readings and beliefs may be asked for from there on."""
        domain = self.words.domain
        sizes = len(self.words.checks), len(domain.factors)
        return live(self.code, self.loop, self.words.register, sizes[0], domain.factor_of, sizes[1])

    @property
    def uses_belief(self) -> bool:
        """Whether any test asks for the belief."""
        return bool((self.code["op"] == BELIEF).any())

    @property
    def constants(self) -> NDArray[np.float64]:
        """The numbers that belief features are compared with, in the order of the text."""
        return self.code["value"][self.code["op"] == BELIEF].copy()

    def with_constants(self, values: NDArray[np.float64]) -> Program:
        """The same program with other :attr:`constants`."""
        code = self.code.copy()
        code["value"][code["op"] == BELIEF] = values
        code.flags.writeable = False
        return replace(self, code=code)

    def __repr__(self) -> str:
        """How long it is and how it begins, on one line."""
        return f"<Program of {self.length} statements: {cards.brief(self.text)}>"

    def _repr_html_(self) -> str:
        return cards.card("Program", f"of {self.length} statements", {}, self.text)


@compiled
def _statements(code: Records) -> int:
    count = 0
    for i in range(len(code)):
        op, jump = code[i].op, code[i].jump
        if op == ACT:
            count += 1
        elif op in (IF, WHILE):
            single = jump == 1 or (jump == 2 and code[i + 2].op in (ELSE, AGAIN))
            if not single or code[i + 1].op != ACT:
                count += 1
    return count
