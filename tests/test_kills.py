"""A few kills and failing disks; `make kills` has hundreds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import size
from tests.test_cli import NO_JULIA


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the strikes are at forks")
def test_what_is_struck_ends_equal():
    least, cases = size(2, 8), ["evolve-runs-threads", "check --update", "tune"][: size(2, 3)]
    command = [sys.executable, "-m", "tests.kills", "--strikes", str(least), *cases]
    root = Path(__file__).parent.parent
    done = subprocess.run(command, cwd=root, env=NO_JULIA, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    equal, strikes = map(int, re.findall(r"^(\d+) of (\d+) ended equal$", done.stdout, flags=re.MULTILINE)[0])
    assert equal == strikes >= least
