"""What the README shows is what comes out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import harness
from tests.conftest import FULL

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["rocksample-7x8", "bordercross-7x8"])
def test_the_tables_are_as_printed(name):
    """Each line must come out again, character for character: rollout's, half a minute, in full size only."""
    shown = README[README.index(f"{name} (version") :]
    shown = shown[: shown.index("\nreturn: ")]
    rows = [line for line in shown.splitlines()[4:] if line and (FULL or not line.startswith("rollout"))]
    specs = [line.split()[0] for line in rows]
    text = harness.render(harness.compare(name, specs, engine="tables"))
    assert [_squeeze(line) for line in rows] == [_squeeze(line) for line in text.splitlines()[4 : 4 + len(rows)]]
    assert shown.splitlines()[0] == text.splitlines()[0]


def _squeeze(line):
    return re.sub(r"  +", "  ", line)  # the columns are as wide as the widest row


def test_the_python_examples_run():
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    scope: dict = {}
    for block in blocks:
        exec(block, scope)
    assert scope["result"].policy == "belief:0.84"
    assert scope["table"]["policy"].tolist() == ["check then leave", "belief:0.84", "sarsop"]
    assert len(blocks) >= 2


def test_every_command_of_the_readme_exists(capsys):
    from harness.cli import main

    for command in set(re.findall(r"^\| `harness ([a-z-]+)|, `harness ([a-z-]+)", README, re.MULTILINE)):
        with pytest.raises(SystemExit) as stop:
            main([next(filter(None, command)), "--help"])
        assert stop.value.code == 0
