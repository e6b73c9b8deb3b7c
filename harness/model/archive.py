"""The file format of snapshots and solved policies: one ``.npz`` with arrays and a JSON record, guarded by a hash.

A file is read as what a stranger may have sent: its headers say how much memory it takes, and nothing is unpacked
unless that is within :data:`LARGEST`.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from harness import files
from harness.errors import SnapshotError, quoted

FORMAT = 1
LARGEST = 2**30
"""Bytes that the arrays of a file may take together, 1 GiB; the largest file of the package takes 59 MB."""
_MOST_ARRAYS = 100
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_UNREADABLE = (
    OSError, ValueError, TypeError, KeyError, EOFError, OverflowError, RuntimeError, MemoryError, SyntaxError,
    IndexError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What NumPy, zipfile and json raise for files with flipped bits."""

Arrays = dict[str, NDArray[Any]]


def digest(arrays: Mapping[str, NDArray[Any]], record: Any) -> str:
    """SHA-256 (hexadecimal) of arrays (names, types, shapes, little-endian bytes) and a JSON-able record."""
    total = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.reshape(-1).view(np.uint8).data)
    return total.hexdigest()


def write(
    path: Path, kind: str, record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], *, compressed: bool = True
) -> None:
    """Write an archive atomically; what is large and soon replaced is better not ``compressed``."""
    stored = {"kind": kind, "format": FORMAT, **record}
    stored["content_hash"] = digest(arrays, stored)
    with files.replacing(path) as file:
        pack = np.savez_compressed if compressed else np.savez
        pack(file, record=np.array(json.dumps(stored)), **arrays)  # type: ignore[arg-type]


def read(
    path: Path, kind: str | tuple[str, ...], mend: str = "export it again", *, largest: int | None = None
) -> tuple[dict[str, Any], Arrays]:
    """Record and arrays of an archive of the given kind, or of one of several.

    ``mend`` is what error messages tell the user to do, ``largest`` how many bytes the arrays may take, by
    default :data:`LARGEST`.

    Raises:
        SnapshotError: the file is missing, truncated, changed by hand, too large, or not of this kind or format.
    """
    kinds = (kind,) if isinstance(kind, str) else kind
    wanted = " or ".join(kinds)
    try:
        arrays = _arrays(path, LARGEST if largest is None else largest)
        record = json.loads(str(arrays.pop("record")))
    except SnapshotError:
        raise
    except FileNotFoundError:
        raise SnapshotError(f"{path}: no such file") from None
    except _UNREADABLE:
        raise SnapshotError(
            f"{path}: not a readable {wanted} file (truncated, or not made by this harness); {mend}"
        ) from None
    if not isinstance(record, dict) or record.get("kind") not in kinds:
        found = record.get("kind") if isinstance(record, dict) else None
        raise SnapshotError(f"{path}: this is a file of kind {quoted(found)}, a '{wanted}' is needed here")
    if record.get("format") != FORMAT:
        raise SnapshotError(
            f"{path}: written in format {quoted(record.get('format'))}, this harness reads format {FORMAT}; {mend}"
        )
    claimed = record.pop("content_hash", None)
    if digest(arrays, record) != claimed:
        raise SnapshotError(f"{path}: contents do not match their hash (damaged or changed by hand); {mend}")
    return record, arrays


def _arrays(path: Path, largest: int) -> Arrays:
    with zipfile.ZipFile(path) as stored:
        members = stored.infolist()
        size = sum(member.file_size for member in members)
        if size > largest or len(members) > _MOST_ARRAYS:
            raise SnapshotError(
                f"{path}: {len(members)} arrays of {size:,} bytes are too much; a file holds {_MOST_ARRAYS} of "
                f"{largest:,} bytes at most"
            )
        if any(member.compress_type not in _PACKINGS for member in members):  # others unpack without a limit
            raise zipfile.BadZipFile
        return {member.filename.removesuffix(".npy"): _array(stored, member) for member in members}


def _array(stored: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """An array whose header tells of as many bytes as there are: np.load would take the memory first."""
    with stored.open(member) as file:
        shape, column_major, dtype = _header(file)
        data = file.read()
    if dtype.hasobject or min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(data):
        raise ValueError
    array = np.empty(shape, dtype, order="F" if column_major else "C")
    array.reshape(-1, order="A").view(np.uint8)[:] = np.frombuffer(data, np.uint8)
    return array


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers as Python 2 wrote them
        header: tuple[tuple[int, ...], bool, np.dtype[Any]] = _HEADERS[np.lib.format.read_magic(file)](file)
    return header
