"""Everything that the paper shows, regenerated: tables, figures, programs, and a report that stands each beside ours.

A :class:`~harness.reproduction.steps.Step` writes its results into the folder; the report reads them from there. Steps
whose results are there are skipped, so that an interrupted reproduction goes on where it was.
"""

from harness.reproduction.sizes import FULL, QUICK, Sizes
from harness.reproduction.steps import reproduce

__all__ = ["FULL", "QUICK", "Sizes", "reproduce"]
