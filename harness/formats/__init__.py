"""Model files of the literature, in and out: Cassandra's ``.pomdp`` and APPL's POMDPX, without Julia.

A file is read as what a stranger may have sent: nothing in it is executed or followed, and what it would take in memory
is checked before it is taken (:mod:`harness.formats.limits`).
"""

from __future__ import annotations

import contextlib
import gzip
import logging
from pathlib import Path
from typing import BinaryIO

from harness import files
from harness.errors import HarnessError, quoted
from harness.formats import cassandra, outgoing, pomdp_writer, pomdpx, pomdpx_writer, text
from harness.formats.assembling import assemble
from harness.formats.plain import from_arrays
from harness.formats.suffixes import is_model_file
from harness.model.domain import Domain

__all__ = ["from_arrays", "is_model_file", "load", "write_model"]

log = logging.getLogger(__name__)
_PARSERS = {".pomdp": cassandra.parse, ".pomdpx": pomdpx.parse}
_WRITERS = {".pomdp": pomdp_writer.lines, ".pomdpx": pomdpx_writer.lines}


def write_model(domain: Domain, path: Path | str) -> list[str]:
    """Write a domain as a model file, in the format of its name: ``.pomdp``, ``.pomdpx``, or either with ``.gz``.

    Read again, it has the same tables to the last bit, save what is returned: what of the domain is not in the file.

    Raises:
        HarnessError: the format cannot say it, there are too many states for ``.pomdp``, or it cannot be written.
    """
    target = files.named(path)
    _check(target)
    packed = target.suffix == ".gz"
    lines = _WRITERS[Path(target.name.removesuffix(".gz")).suffix](domain)
    with files.replacing(target) as file, _packed(file) if packed else contextlib.nullcontext(file) as out:
        out.writelines(f"{line}\n".encode() for line in lines)
    return outgoing.losses(domain)


def _packed(file: BinaryIO) -> gzip.GzipFile:
    """The same bytes at any time, under any name."""
    return gzip.GzipFile("", "wb", fileobj=file, mtime=0)


def _check(path: Path) -> None:
    if not is_model_file(path):
        raise HarnessError(f"{quoted(path)} is no model file; its name must end in .pomdp, .pomdpx, or these with .gz")


def load(path: Path) -> Domain:
    """A domain from a model file: ``.pomdp`` or ``.pomdpx``, or either with ``.gz``.

    What its variables have become, and what was lost, is in the domain's :attr:`~harness.model.domain.Domain.notes`,
    and is logged.

    Raises:
        HarnessError: it cannot be read, or is no model of its format; the message has file, line and mend.
    """
    _check(path)
    name = path.name.removesuffix(".gz")
    parse = _PARSERS[Path(name).suffix]
    domain = assemble(parse(text.read(path), path.name), name, f"from {path.name}")
    for note in domain.notes:
        log.info("%s: %s", path.name, note)
    return domain
