"""Where compiled code is kept: a folder for every state of the sources that it was compiled from.

Numba looks at one source file a function. It does not see that a small function which it put into another one has
changed since in a file of its own (and would go on with the old code), and fails on what it kept when a class has moved
to another module. So everything is kept under a digest of all sources that compiled code can come from: after a change
of one of them nothing old is found.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba

_config: Any = numba.config
PACKAGE = Path(__file__).resolve().parent.parent
_KEPT = 4  # folders of earlier sources that stay, so that going back and forth between branches compiles nothing
_MARKS = (b"\n@compiled\n", b"\n@inlined\n", b"\n@lean\n")
_IMPORTS = re.compile(rb"^(?:from|import) (harness(?:\.\w+)*)(?: import ([^(\n]+|\([^)]*\)))?", re.MULTILINE)


@contextlib.contextmanager
def cache_folder() -> Iterator[bool]:
    """Functions that are declared in this block are kept in :func:`folder`; yields whether anything can be kept."""
    before, chosen = _config.CACHE_DIR, folder()
    _config.CACHE_DIR = "" if chosen is None else str(chosen)
    try:
        yield chosen is not None
    finally:
        _config.CACHE_DIR = before


@functools.cache
def folder() -> Path | None:
    """The folder of the present sources, made if need be: in ``NUMBA_CACHE_DIR`` if that is set, else beside the
    package's byte code, else in the user's own cache; None where nobody lets us write."""
    name = f"harness-{digest(PACKAGE)[:20]}"
    for base in _bases():
        made = base / name
        with contextlib.suppress(OSError):
            new = not made.exists()
            made.mkdir(parents=True, exist_ok=True)
            if os.access(made, os.W_OK):
                if new:
                    _forget_old(base, made)
                return made
    return None


def _bases() -> Iterator[Path]:
    yield Path(_config.CACHE_DIR or PACKAGE / "__pycache__")
    if (own := user_folder()) is not None:
        yield own


def user_folder() -> Path | None:
    """The user's own cache for this package, which need not exist; None where nobody's home is known."""
    with contextlib.suppress(RuntimeError):
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pomdp-harness"
    return None


def _forget_old(base: Path, new: Path) -> None:
    others = [path for path in base.glob("harness-*") if path != new]
    for path in sorted(others, key=lambda path: path.stat().st_mtime)[:-_KEPT]:
        shutil.rmtree(path, ignore_errors=True)


def digest(package: Path) -> str:
    """SHA-256 of the sources that compiled code comes from: the modules with compiled functions, and all that these
    import from the package, for a constant of theirs is part of the machine code."""
    sources = _sources(str(package))
    waiting = [module for module, text in sources.items() if any(mark in text for mark in _MARKS)]
    found = set(waiting)
    while waiting:
        new = {name for name in _imported(sources[waiting.pop()]) if name in sources} - found
        found |= new
        waiting += new
    total = hashlib.sha256()
    for module in sorted(found):
        total.update(f"{module} {len(sources[module])}\n".encode() + sources[module])
    return total.hexdigest()


def _sources(package: str) -> dict[str, bytes]:
    """The text of every module, by its dotted name; strings, not paths, since this runs at every import."""
    sources = {}
    for folder, _, names in os.walk(package):
        room = "harness" + folder[len(package) :].replace(os.sep, ".")
        for name in names:
            if name.endswith(".py"):
                with open(f"{folder}{os.sep}{name}", "rb") as file:
                    sources[f"{room}.{name[:-3]}".removesuffix(".__init__")] = file.read()
    return sources


def _imported(source: bytes) -> Iterator[str]:
    """The modules that a source's imports may mean: of ``from a import b`` both a and a.b."""
    for match in _IMPORTS.finditer(source):
        module = match[1].decode()
        yield module
        yield from (f"{module}.{name}" for name in re.findall(r"\w+", (match[2] or b"").decode()))
