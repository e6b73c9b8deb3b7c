"""Tuning the numbers in a policy: sweeps, and six ways uphill on a return.

What is tuned is a :class:`Tunable`; how, is a :class:`~harness.tuning.method.Method`; neither knows of the other. A
method asks for points, an :class:`~harness.tuning.objective.Objective` plays episodes there, and a
:class:`~harness.tuning.journal.Journal` keeps every answer, so that a run killed at any moment is resumed by asking the
method again and answering from the journal.
"""

from harness.tuning.constants import Constants
from harness.tuning.outcome import Tuned
from harness.tuning.run import resume, tune
from harness.tuning.sweeping import sweep
from harness.tuning.tunable import Tunable, tunable

__all__ = ["Constants", "Tunable", "Tuned", "resume", "sweep", "tunable", "tune"]
