"""The language of evolved programs: words that come from the domain, text, compiled form, interpreter."""

from harness.program.compiled import Program
from harness.program.parser import NestingError, ProgramError, constant_spans, parse
from harness.program.words import Words, words_of

__all__ = ["NestingError", "Program", "ProgramError", "Words", "constant_spans", "parse", "words_of"]
