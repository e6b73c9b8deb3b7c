"""The notebooks, run from top to bottom. What came out is kept in ``build/notebooks``: so git keeps none of it, and the
pages need not run again what the tests have run."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted((ROOT / "notebooks").glob("*.ipynb"))
KEPT = ROOT / "build" / "notebooks"


def run(path: Path, size: str) -> NotebookNode:
    """A notebook with its outputs, run as a person runs it: in its folder, by this Python. ``size``: small or full."""
    book = nbformat.read(path, as_version=4)
    client = NotebookClient(
        book, timeout=1200, kernel_name="python3", resources={"metadata": {"path": str(path.parent)}}
    )
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]  # this checkout's harness
    client.execute(env={**os.environ, "HARNESS_NOTEBOOK_SIZE": size, "PYTHONPATH": os.pathsep.join(paths)})
    KEPT.mkdir(parents=True, exist_ok=True)
    for old in KEPT.glob(f"{path.stem}-{size}-*"):
        old.unlink()
    nbformat.write(book, _kept(path, size))
    return book


def page(path: Path, size: str) -> NotebookNode:
    """The notebook as a page: with its outputs, and the pictures' texts where MyST-NB looks for them."""
    kept = _kept(path, size)
    book = nbformat.read(kept, as_version=4) if kept.exists() else run(path, size)
    for cell in book.cells:
        for output in cell.get("outputs", ()):
            if alt := output.get("metadata", {}).get("image/png", {}).get("alt"):
                cell.metadata["mystnb"] = {"image": {"alt": alt}}
    return book


def _kept(path: Path, size: str) -> Path:
    """Where the outputs of the present notebook by the present package are."""
    total = hashlib.sha256(path.read_bytes())
    for source in sorted((ROOT / "harness").rglob("*.py")):
        total.update(source.read_bytes())
    return KEPT / f"{path.stem}-{size}-{total.hexdigest()[:16]}.ipynb"
