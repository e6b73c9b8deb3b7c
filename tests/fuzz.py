"""Hostile inputs: each is accepted, or refused in one short printable sentence; nothing crashes, hangs or fills memory.

    python -m tests.fuzz --count 100000            # all kinds in turn; `make fuzz`
    python -m tests.fuzz --only 4711 --seed 3      # one input again, with its traceback

Valid files and texts are changed at random; a changed snapshot or policy gets a right hash again, for a hash keeps no
one out who wants in. Input n of a seed is always the same. Inputs run in a worker with limited memory; when it dies or
stops answering, that input has failed and another worker goes on with the next. A few hundred are in the tests.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import io
import re
import resource
import select
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import harness
from harness.errors import LONGEST_QUOTE, LONGEST_SENTENCE, printable
from tests import hostile
from tests.hostile import CASES, ORDER, prepare

MEMORY = 4 * 2**30
"""Bytes of address space of a worker; compiling alone maps more than one of them."""
SECONDS = 20
"""Of the processor that an input may take."""
HARD_SECONDS = 300
"""Until a worker that hears no alarm, as inside compiled code, counts as hanging."""
START_SECONDS = 3600
"""Until a worker must be ready: it compiles what nobody has compiled yet."""


class Timeout(BaseException):
    """An input took longer than it may."""


# One input


def attempt(seed: int, number: int, folder: Path) -> str:
    """What became of an input: ``accepted``, ``refused``, or what was wrong."""
    name = ORDER[number % len(ORDER)]
    hostile.TRIED.clear()
    _REACHED.clear()
    result = _used(name, np.random.default_rng([seed, number]), folder, shown=number == _SHOWN)
    if _REACHED and name not in hostile.CHOSEN:
        return f"data made it reach {_REACHED[0]}"[:200]
    return result


def _used(name: str, rng: hostile.Rng, folder: Path, shown: bool) -> str:
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _alarm(), warnings.catch_warnings():
            warnings.simplefilter("error")
            CASES[name](rng, folder)
    except harness.ConformanceError as error:  # lists all that it found
        return "" if str(error).isprintable() else "an unprintable message"
    except harness.HarnessError as error:
        return _fault_of(str(error), hostile.TRIED) or "refused"
    except Timeout:
        return f"took over {SECONDS} s"
    except BaseException as error:  # whatever it is, it is what we look for
        if shown:
            traceback.print_exc()
        return printable(f"{type(error).__name__}: {error}"[:200])
    if shown:
        print(err.getvalue(), end="")
    if not out.getvalue().replace("\n", "").isprintable():
        return "unprintable output"
    said = err.getvalue().removesuffix("\n")
    if not said:
        return "accepted"
    return _fault_of(said.removeprefix("harness: "), hostile.TRIED) or "refused"


_SHOWN: int | None = None
_REACHED: list[str] = []
_SECOND = re.compile(r"[.!?] [A-Z]")
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")


def listen(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook: what data must never lead to."""
    started = event == "subprocess.Popen" and "git" not in list(arguments[1])[:1]  # it asks for our revision
    if started or event in ("os.system", "os.exec", "os.posix_spawn"):
        _REACHED.append(f"{event} {arguments[:2]!r}")
    elif event == "open" and arguments[0] == hostile.SECRET:
        _REACHED.append(hostile.SECRET)


def _fault_of(message: str, texts: Sequence[str] = ()) -> str:
    """What is wrong with a refusal; nothing for one short printable sentence that repeats little of the input."""
    if not 0 < len(message) <= LONGEST_SENTENCE:
        return f"a message of {len(message)} characters"
    if not message.isprintable():
        return "an unprintable message"
    if _SECOND.search(_QUOTED.sub("", message)):
        return f"more than a sentence: {message}"
    if any(_repeats(message, each) for text in texts for each in {text, printable(text)}):
        return f"it repeats more than {LONGEST_QUOTE} characters: {message}"
    return ""


def _repeats(message: str, text: str) -> bool:
    return any(message[at : at + LONGEST_QUOTE + 1] in text for at in range(len(message) - LONGEST_QUOTE))


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    def ring(*_: Any) -> None:
        raise Timeout

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


# Many inputs


def work(seed: int, first: int, last: int) -> None:
    """In a worker: a line ``number outcome`` for each input."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    sys.addaudithook(listen)
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.redirect_stdout(io.StringIO()):  # a line there says that an input is done
            prepare(Path(folder))
        print("ready", flush=True)
        for number in range(first, last):
            print(number, attempt(seed, number, Path(folder)), flush=True)


class Outcome(NamedTuple):
    number: int
    kind: str
    result: str

    @property
    def failed(self) -> bool:
        return self.result not in ("accepted", "refused")


def outcomes(seed: int, first: int, last: int) -> Iterator[Outcome]:
    """What became of the inputs ``first … last − 1`` of a seed."""
    while first < last:
        end = None
        for line in _lines(seed, first, last):
            number, _, end = line.partition(" ")
            if end and number.isdecimal():
                yield _outcome(first, end)
                first += 1
        if first < last:
            yield _outcome(first, "the worker died or hung")
            first += 1


def _outcome(number: int, result: str) -> Outcome:
    return Outcome(number, ORDER[number % len(ORDER)], result)


def _lines(seed: int, first: int, last: int) -> Iterator[str]:
    command = [sys.executable, "-m", "tests.fuzz", "--worker", str(seed), str(first), str(last)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, bufsize=1) as worker:
        assert worker.stdout is not None
        try:
            patience = START_SECONDS
            while select.select([worker.stdout], [], [], patience)[0] and (line := worker.stdout.readline()):
                patience = HARD_SECONDS
                yield line.rstrip("\n")
        finally:
            worker.kill()


def report(seed: int, first: int, last: int) -> int:
    """Print counts and every failure; the number of failures."""
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    failures = 0
    for outcome in outcomes(seed, first, last):
        counts[outcome.kind, "failed" if outcome.failed else outcome.result] += 1
        if outcome.failed:
            failures += 1
            print(f"input {outcome.number} of seed {seed} ({outcome.kind}): {outcome.result}", flush=True)
    for kind in CASES:
        print(f"{kind:>12}  " + "  ".join(f"{r} {counts[kind, r]:,}" for r in ("accepted", "refused", "failed")))
    print(f"{last - first:,} inputs of seed {seed}, {failures} failures")
    return failures


def command() -> int:
    parser = argparse.ArgumentParser(description="Try hostile inputs.")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int, help="one input, here, with its traceback")
    parser.add_argument("--worker", type=int, nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(*options.worker)
        return 0
    if options.only is not None:
        global _SHOWN
        _SHOWN = options.only
        sys.addaudithook(listen)
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            print(attempt(options.seed, options.only, Path(folder)))
        return 0
    return int(report(options.seed, options.first, options.first + options.count) > 0)


if __name__ == "__main__":
    sys.exit(command())
