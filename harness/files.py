"""Files that are whole at any moment, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import errno
import glob
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from harness.errors import HarnessError, quoted

_NAME = 60  # characters of a file's name in that of its temporary neighbour: file systems end names at 255 bytes


def named(path: str | Path) -> Path:
    """A path that a user gave, where it can be the name of a file, and be printed.

    Raises:
        HarnessError: no file system takes it, or there are escape sequences, line breaks or the like in it.
    """
    try:
        if not str(path).isprintable():
            raise ValueError
        os.stat(path)
    except (OSError, ValueError) as error:  # a NUL, half a character, too many characters
        if isinstance(error, OSError) and error.errno != errno.ENAMETOOLONG:
            return Path(path)
        raise HarnessError(f"{quoted(str(path))} cannot be the name of a file; give another") from None
    return Path(path)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file that takes the place of ``path`` when the block ends well: written beside it, synced, then renamed.

    Whoever reads ``path`` meanwhile finds the old contents or the new ones whole; after an error or a loss of power,
    the old ones or the new ones. A symbolic link stays one, and a file keeps its mode.

    Raises:
        HarnessError: it cannot be written.
    """
    target = Path(os.path.realpath(path))
    try:
        mode = _mode(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:_NAME]}.", suffix=".part")
    except OSError as error:
        raise _unwritable(path, error) from None
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, mode)
        os.replace(temporary, target)
        _sync_folder(target.parent)
    except BaseException as error:
        with contextlib.suppress(OSError):  # an interrupt may come just after the rename
            os.unlink(temporary)
        if isinstance(error, OSError):
            raise _unwritable(path, error) from None
        raise


def _mode(path: Path) -> int:
    """That of a file that is there already."""
    if not path.exists():
        return 0o644
    if not path.is_file():
        raise OSError(None, "there is a folder or a device of that name")
    return path.stat().st_mode & 0o7777


def _sync_folder(folder: Path) -> None:
    """Make a rename in it outlast a loss of power, where the file system can do that for folders."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _unwritable(path: Path, error: OSError) -> HarnessError:
    return HarnessError(f"cannot write {path}: {error.strerror or error}")


def clear(folder: Path, name: str | None = None) -> None:
    """Remove what processes left that were killed while they wrote: beside the file ``name``, or in all of a folder.

    Only for who knows that no other process writes there (:mod:`harness.locking`).
    """
    pattern = "*" if name is None else glob.escape(name[:_NAME])
    for left in folder.glob(f".{pattern}.*.part"):
        with contextlib.suppress(OSError):
            left.unlink()


LARGEST_SOURCE = 2**20
"""Bytes of a program, a grammar or a list of scores, 1 MiB."""


def read_source(path: Path, kind: type[HarnessError] = HarnessError) -> str:
    """A UTF-8 text of a user's, of :data:`LARGEST_SOURCE` at most; what is longer, or has no end, is not read on.

    Raises:
        HarnessError: of the given kind; it cannot be read, is no UTF-8 text or too long.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_SOURCE + 1)
        if len(text) > LARGEST_SOURCE:
            raise kind(f"cannot read {quoted(path)}: it is longer than {LARGEST_SOURCE:,} bytes")
        return text.decode().replace("\r\n", "\n").replace("\r", "\n")
    except HarnessError:
        raise
    except OSError as error:
        raise kind(f"cannot read {quoted(path)}: {error.strerror}") from None
    except ValueError:  # no UTF-8, or a name with a NUL
        raise kind(f"cannot read {quoted(path)}: it is no UTF-8 text") from None


_MOST_DOTS = 100  # in a line of TOML: to read a key of many parts takes the square of their number


def toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: it is none, or would take long to read; the message says where.
    """
    for number, line in enumerate(text.split("\n"), 1):
        if line.count(".") > _MOST_DOTS:
            raise ValueError(f"over {_MOST_DOTS} dots in line {number}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except (ValueError, RecursionError):  # numbers of thousands of digits, and nesting without end
        raise ValueError("a number or a nesting without end") from None


def replace_text(path: Path, text: str) -> None:
    """Write a text file atomically, UTF-8; half a character, which that cannot say, as an escape (``\\ud800``)."""
    with replacing(path) as file:
        file.write(text.encode(errors="backslashreplace"))


def replace_json(path: Path, record: Any) -> None:
    """Write a JSON file atomically, for people to read too."""
    replace_text(path, json.dumps(record, indent=2) + "\n")


def read_text(path: Path, mend: str) -> str:
    """Read a text file, UTF-8; ``mend`` is what the error message tells the user to do.

    Raises:
        HarnessError: it is not there, cannot be read, or is no text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise HarnessError(f"{path} cannot be read ({reason}); {mend}") from None


def read_json(path: Path, mend: str) -> Any:
    """Read a JSON file; ``mend`` is what the error message tells the user to do.

    Raises:
        HarnessError: it is not there, cannot be read, or is no JSON.
    """
    try:
        return json.loads(read_text(path, mend))
    except HarnessError:
        raise
    except (ValueError, RecursionError):  # also numbers of thousands of digits, and nesting without end
        raise HarnessError(f"{path} cannot be read (not JSON); {mend}") from None
