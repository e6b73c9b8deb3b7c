"""Files that are whole at any moment, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from harness.errors import HarnessError


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file that takes the place of ``path`` when the block ends well: written beside it, then renamed.

    Whoever reads ``path`` meanwhile finds the old contents or the new ones whole; after an error, the old ones.

    Raises:
        HarnessError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    except OSError as error:
        raise HarnessError(f"cannot write {path}: {error.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)  # an interrupt may come just after the rename
        if isinstance(error, OSError):
            raise HarnessError(f"cannot write {path}: {error.strerror}") from None
        raise


LARGEST_TEXT = 2**20
"""Bytes of a program or a grammar, 1 MiB."""


def read_text(path: Path, kind: type[HarnessError] = HarnessError) -> str:
    """A UTF-8 text of a user's, of :data:`LARGEST_TEXT` at most; what is longer, or has no end, is not read on.

    Raises:
        HarnessError: of the given kind; it cannot be read, is no UTF-8 text or too long.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_TEXT + 1)
        if len(text) > LARGEST_TEXT:
            raise kind(f"cannot read {path}: it is longer than {LARGEST_TEXT:,} bytes")
        return text.decode().replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise kind(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise kind(f"cannot read {path}: it is no UTF-8 text") from None


def replace_text(path: Path, text: str) -> None:
    """Write a text file atomically, UTF-8."""
    with replacing(path) as file:
        file.write(text.encode())


def replace_json(path: Path, record: Any) -> None:
    """Write a JSON file atomically, for people to read too."""
    replace_text(path, json.dumps(record, indent=2) + "\n")
