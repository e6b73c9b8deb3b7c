"""The file format of snapshots and solved policies: one ``.npz`` with arrays and a JSON record, guarded by a hash."""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import files
from harness.errors import SnapshotError, quoted

FORMAT = 1
Arrays = dict[str, NDArray[Any]]


def digest(arrays: Mapping[str, NDArray[Any]], record: Any) -> str:
    """SHA-256 (hexadecimal) of arrays (names, types, shapes, little-endian bytes) and a JSON-able record."""
    total = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def write(path: Path, kind: str, record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write an archive atomically."""
    stored = {"kind": kind, "format": FORMAT, **record}
    stored["content_hash"] = digest(arrays, stored)
    with files.replacing(path) as file:
        np.savez_compressed(file, record=np.array(json.dumps(stored)), **arrays)  # type: ignore[arg-type]


def read(path: Path, kind: str, mend: str = "export it again") -> tuple[dict[str, Any], Arrays]:
    """Record and arrays of an archive of the given kind; ``mend`` is what error messages tell the user to do.

    Raises:
        SnapshotError: the file is missing, truncated, changed by hand, or not of this kind or format.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        record = json.loads(str(arrays.pop("record")))
    except FileNotFoundError:
        raise SnapshotError(f"{path}: no such file") from None
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error):
        raise SnapshotError(
            f"{path}: not a readable {kind} file (truncated, or not made by this harness); {mend}"
        ) from None
    if not isinstance(record, dict) or record.get("kind") != kind:
        found = record.get("kind") if isinstance(record, dict) else None
        raise SnapshotError(f"{path}: this is a file of kind {quoted(found)}, a '{kind}' is needed here")
    if record.get("format") != FORMAT:
        raise SnapshotError(
            f"{path}: written in format {record.get('format')}, this harness reads format {FORMAT}; {mend}"
        )
    claimed = record.pop("content_hash", None)
    if digest(arrays, record) != claimed:
        raise SnapshotError(f"{path}: contents do not match their hash (damaged or changed by hand); {mend}")
    return record, arrays
