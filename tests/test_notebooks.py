"""The notebooks run from top to bottom, in a small size, and are committed without outputs."""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
import pytest

sys.path.append(str(Path(__file__).parent.parent / "docs"))

import stories

NOTEBOOKS = stories.SOURCES

PICTURES = {
    "1-baselines": 5,
    "2-evolve-and-tune": 5,
    "3-bordercross": 4,
    "4-your-own-model": 3,
    "5-agents-that-learn": 2,
}
"""How many figures each notebook shows."""


def outputs(book, kind):
    return [output for cell in book.cells for output in cell.get("outputs", ()) if output["output_type"] == kind]


def test_all_notebooks_are_known():
    assert [path.stem for path in NOTEBOOKS] == sorted(PICTURES)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_committed_valid_and_without_outputs(path):
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    for cell in book.cells:
        assert not cell.get("outputs"), "clear the outputs before committing: see CONTRIBUTING.md"
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path):
    """Without an error, without a warning, and with its pictures, each with a text for those who cannot see it."""
    book = stories.run(path, "small")
    texts = [output["text"] for output in outputs(book, "stream") if output["name"] == "stderr"]
    assert texts == []
    shown = outputs(book, "display_data") + outputs(book, "execute_result")
    pictures = [output for output in shown if "image/png" in output["data"]]
    assert len(pictures) == PICTURES[path.stem]
    for picture in pictures:
        assert len(picture["metadata"]["image/png"]["alt"]) > len("Figure.")
