"""Which files are model files, by their names."""

from __future__ import annotations

from pathlib import Path

FORMATS = ("pomdp", "pomdpx")


def is_model_file(path: Path) -> bool:
    """Whether a name ends in ``.pomdp`` or ``.pomdpx``, or in one of these and ``.gz``."""
    return Path(path.name.removesuffix(".gz")).suffix[1:] in FORMATS
