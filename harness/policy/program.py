"""Programs as policies: a script in the language of :mod:`harness.program` (SPEC section 4)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.tables import STOP, Records, compiled
from harness.policy.base import fitting
from harness.program import Program, parse, words_of
from harness.program.machine import next_action

_ENDED = -1  # instead of a place in the program


def stored_program(path: Path, domain: Domain) -> Program:
    """The program of a ``best.json``, as a run of evolution writes it.

    Raises:
        PolicyError: the file is damaged, or the program was evolved on another model.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        text, _ = "\n".join(record["program"]), record["model_hash"]
    except (OSError, ValueError, KeyError, TypeError):
        raise PolicyError(f"{path}: not a readable best.json of a run; evolve the program again") from None
    require_model(record, path, domain, "evolved", "evolve it again")
    return parse(text, words_of(domain), source=str(path))


def require_model(record: Mapping[str, Any], path: Path, domain: Domain, made: str, mend: str) -> None:
    """Do nothing where the record of a file is of a domain's model.

    Raises:
        PolicyError: it is of another one.
    """
    if record["model_hash"] != domain.model_hash:
        raise PolicyError(
            f"{path}: {made} on {record.get('domain')} version {record.get('domain_version')}, another model than "
            f"{domain.name} version {domain.version}; {mend}"
        )


class ProgramPolicy:
    """Runs a program in every episode. At its end the policy stops, and with it the episode."""

    name = "program"
    """What tables call it; a table of several programs gives each object a name of its own."""
    memory = ("_place", "_registers", "_last")

    def __init__(self, program: Program) -> None:
        """``program``: compiled for the domain that it will run on.

        Raises:
            PolicyError: it has a section for each agent, which :func:`harness.policy.team.policy_of` plays.
        """
        if program.parts:
            raise PolicyError("a program with a section for each agent is played by a team, not by one controller")
        self.program = program
        self.uses_belief = program.uses_belief

    def reset(self, batch: Batch) -> None:
        """All episodes begin at the top, with nothing checked.

        Raises:
            PolicyError: the program was compiled for a domain with other words.
        """
        _require_same_words(self.program.words.domain, batch.domain)
        self._place = np.zeros(batch.size, dtype=np.int64)
        self._registers = np.full((batch.size, len(self.program.words.checks)), -1, dtype=np.int32)
        self._last = np.full(batch.size, STOP, dtype=np.int32)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """Run every episode's program up to its next operation."""
        words, last = self.program.words, fitting(batch, self._last)
        _act(
            self.program.code,
            self.program.loop,
            words.register,
            words.numbers,
            batch.domain.visible_values,
            batch.visible,
            batch.observation,
            batch.tracked() if self.program.uses_belief else batch.marginals,
            batch.done,
            fitting(batch, self._place),
            fitting(batch, self._registers),
            last,
        )
        return last

    def outlook(self, batch: Batch) -> NDArray[np.bool_]:
        """(E, K) of which factors the program may yet look at the belief; forgets readings that it will not ask for."""
        live = self.program.live[self.at]
        n = self._registers.shape[1]
        self._registers[~live[:, :n]] = -1
        return live[:, n:]

    @property
    def at(self) -> NDArray[np.int64]:
        """(E,) instruction of each episode's last operation; −1 where the program has come to its end."""
        return np.where(self._place == _ENDED, -1, self._place - 1)


def _require_same_words(mine: Domain, other: Domain) -> None:
    """Compiled code finds actions, observations, beliefs and visible numbers by their index."""
    for what in ("actions", "observations", "factor_labels", "visible_names", "sensors"):
        if getattr(mine, what) != getattr(other, what):
            raise PolicyError(f"the program was compiled for {mine.name}, not for {other.name}: parse it again")


@compiled
def _act(
    code: Records,
    loop: bool,
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    visible: NDArray[np.int32],
    observation: NDArray[np.int32],
    marginals: NDArray[np.float64],
    done: NDArray[np.bool_],
    place: NDArray[np.int64],
    registers: NDArray[np.int32],
    last: NDArray[np.int32],
) -> None:
    """``last``: the actions of the step before; those of this step are written there."""
    n = len(code)
    for e in range(len(visible)):
        if done[e] or place[e] == _ENDED:
            continue
        if last[e] != STOP and register[last[e]] >= 0:
            registers[e, register[last[e]]] = observation[e]
        last[e], place[e] = next_action(
            code,
            0,
            n,
            place[e],
            loop,
            marginals,
            registers,
            e,
            observation[e],
            numbers,
            visible_values,
            visible[e],
        )
        if last[e] == STOP:
            place[e] = _ENDED
