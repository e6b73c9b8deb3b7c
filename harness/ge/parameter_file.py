"""Parameters of a run as a TOML file: what a user writes, and what every run writes so that it can be had again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from harness import files
from harness.errors import HarnessError
from harness.ge.parameters import Parameters, check_value

NAME = "parameters.toml"
"""In the folder of a run."""

_MOST_BYTES = 100_000


def read(path: Path) -> dict[str, Any]:
    """Names and values from a file; those that it leaves out keep their defaults.

    Raises:
        HarnessError: it cannot be read, is no TOML, or holds an unknown name or a wrong value; the message names it.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise HarnessError(f"cannot read {path}: {error.strerror}") from None
    if len(content) > _MOST_BYTES:
        raise HarnessError(f"{path}: more than {_MOST_BYTES:,} bytes; a file of parameters has a line for each")
    try:
        record = files.toml(content.decode())
    except ValueError as error:
        raise HarnessError(f"{path}: no TOML ({error}); a line is like: population = 250") from None
    try:
        for name, value in record.items():
            check_value(name, value)
    except HarnessError as error:
        raise HarnessError(f"{path}: {error}") from None
    return record


def text(parameters: Parameters, domain: str) -> str:
    """The file of a run on a domain: all its parameters.

    The domain and the grammar are no parameters; a comment says how they are given.
    """
    command = f"harness evolve DOMAIN --grammar grammar.bnf --parameters {NAME} --out ANOTHER"
    lines = [f"# A run on {json.dumps(domain)}. To have it again, in this folder: {command}"]
    lines += [f"{name} = {json.dumps(value)}" for name, value in parameters.__dict__.items()]
    return "\n".join(lines) + "\n"
