"""Model files of the literature, in and out: Cassandra's ``.pomdp`` and APPL's POMDPX, without Julia.

A file is read as what a stranger may have sent: nothing in it is executed or followed, and what it would take in memory
is checked before it is taken (:mod:`harness.formats.limits`).
"""

from __future__ import annotations

import logging
from pathlib import Path

from harness.errors import HarnessError, quoted
from harness.formats import cassandra, pomdpx, text
from harness.formats.assembling import assemble
from harness.formats.suffixes import is_model_file
from harness.model.domain import Domain

log = logging.getLogger(__name__)
_PARSERS = {".pomdp": cassandra.parse, ".pomdpx": pomdpx.parse}


def load(path: Path) -> Domain:
    """A domain from a model file: ``.pomdp`` or ``.pomdpx``, or either with ``.gz``.

    What its variables have become, and what was lost, is in :attr:`Domain.notes <harness.Domain.notes>`, and is logged.

    Raises:
        HarnessError: it cannot be read, or is no model of its format; the message has file, line and mend.
    """
    if not is_model_file(path):
        raise HarnessError(f"{quoted(path)} is no model file; its name must end in .pomdp, .pomdpx, or these with .gz")
    name = path.name.removesuffix(".gz")
    parse = _PARSERS[Path(name).suffix]
    domain = assemble(parse(text.read(path), path.name), name, f"from {path.name}")
    for note in domain.notes:
        log.info("%s: %s", path.name, note)
    return domain
