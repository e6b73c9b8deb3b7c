"""Files that are whole at any moment, whatever happens while they are written."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any


def replace(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file atomically: a temporary file in the same folder, then a rename."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def replace_text(path: Path, text: str) -> None:
    """Write a text file atomically, UTF-8."""
    replace(path, lambda file: file.write(text.encode()))


def replace_json(path: Path, record: Any) -> None:
    """Write a JSON file atomically, for people to read too."""
    replace_text(path, json.dumps(record, indent=2) + "\n")
