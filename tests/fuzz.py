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
import json
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import harness
from harness import registry
from harness.cli import main
from harness.errors import LONGEST_SENTENCE
from harness.ge import grammar as bnf
from harness.ge.fitness import check_language
from harness.ge.folder import RunFolder
from harness.ge.initialisation import METHODS
from harness.ge.mapping import derive
from harness.model import archive
from harness.play.evaluation import evaluate
from harness.policy import make
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of
from harness.regression import stored
from harness.report import inputs

MEMORY = 4 * 2**30
"""Bytes of address space of a worker; compiling alone maps more than one of them."""
SECONDS = 20
"""That an input may take; many of them at once on few cores take long."""
HARD_SECONDS = 60
"""Until a worker that hears no alarm, as inside compiled code, counts as hanging."""
START_SECONDS = 600
"""Until a worker must be ready: it compiles what nobody has compiled yet."""

Rng = np.random.Generator
Case = Callable[[Rng, Path], None]

DOMAINS = ("rocksample-7x8", "bordercross-7x8-random")
PLAYED = ("random-legal", "rollout:1", "accuracy", "belief", "thresholds", "exit", "qmdp")
ODD_TEXTS = ("", "\x1b[31m", "\n", "a" * 5000, "γ", "\ud800", "'", '"', "%s", "{}", "../../etc/passwd", "check(01)")
ODD_NUMBERS = (-1, 0, 1, -(2**31), 2**31 - 1, 2**63 - 1, 10**400, 0.5, -0.0, 1e308, float("nan"), float("inf"))
ODD_VALUES = (*ODD_TEXTS, *ODD_NUMBERS, None, True, [], {}, [[]], ["a", "a"], [["a", 0, 0]], [["a"] * 3])


class Timeout(BaseException):
    """An input took longer than it may."""


def pick(rng: Rng, options: Any) -> Any:
    return options[int(rng.integers(len(options)))]


# What is changed, and how


def change_array(rng: Rng, arrays: dict[str, Any]) -> None:
    """One array: an entry, its type, its shape, its order; or it is gone."""
    name = pick(rng, sorted(arrays))
    array = np.atleast_1d(arrays[name])  # an earlier change may have left a single number
    kind = int(rng.integers(10))
    if kind < 6 and array.size and array.dtype.kind in "biuf":
        arrays[name] = _with_entries(rng, array)
    elif kind == 6:
        arrays[name] = array.astype(pick(rng, ["f4", "i8", "u1", "U3", "c16", "M8[s]", ">i4", "?"]))
    elif kind == 7:
        arrays[name] = pick(rng, [array[:-1], array[..., None], array.ravel(), array[:0], np.array(3), array.T])
    elif kind == 8:
        arrays[name] = rng.permutation(array)
    else:
        del arrays[name]


def _with_entries(rng: Rng, array: Any) -> Any:
    array = array.copy()
    flat = array.reshape(-1)
    whole = array.dtype.kind in "iu"
    low, high = (np.iinfo(array.dtype).min, np.iinfo(array.dtype).max) if whole else (0, 1)
    values = (low, high, flat[0] - 1 if array.dtype.kind == "i" else 0, flat[-1], len(array), np.nan, np.inf, -0.5)
    value = pick(rng, values if array.dtype.kind == "f" else values[:5])
    where = rng.integers(len(flat), size=int(pick(rng, [1, 1, 1, 3, len(flat)])))
    with contextlib.suppress(OverflowError):
        flat[where] = value
    return array


def change_record(rng: Rng, record: Any) -> None:
    """One value somewhere inside nested lists and tables: another, gone, or twice."""
    while isinstance(record, (dict, list)) and record:
        key = pick(rng, sorted(record) if isinstance(record, dict) else range(len(record)))
        inner = record[key]
        if not isinstance(inner, (dict, list)) or not inner or rng.random() < 0.4:
            break
        record = inner
    else:
        return
    kind = int(rng.integers(4))
    if kind == 0:
        del record[key]
    elif kind == 1 and isinstance(record, list):
        record.append(inner)
    else:
        record[key] = pick(rng, ODD_VALUES)


def change_bytes(rng: Rng, data: bytes) -> bytes:
    """A few bytes flipped, cut out, doubled; or the end missing."""
    for _ in range(int(rng.integers(1, 4))):
        at, size = int(rng.integers(len(data) + 1)), int(rng.integers(1, 40))
        kind = int(rng.integers(5))
        if kind < 2 and at < len(data):
            data = data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]
        elif kind == 2:
            data = data[:at] + data[at + size :]
        elif kind == 3:
            data = data[:at] + data[at : at + size] * int(rng.integers(2, 5)) + data[at + size :]
        else:
            data = data[:at]
    return data


def change_text(rng: Rng, text: str, tokens: tuple[str, ...]) -> str:
    """Words of the language and odd ones put in, taken out, moved, or repeated very often."""
    parts = re.findall(r"\w+|\s+|.", text)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(parts) + 1))
        new = pick(rng, tokens if rng.random() < 0.9 else ODD_TEXTS)
        kind = int(rng.integers(6))
        if kind == 0:
            parts[at:at] = [new] * int(pick(rng, [1, 1, 2, 60, 3000]))
        elif kind == 1:
            parts[at : at + 1] = [new]
        elif kind == 2:
            parts[at:at] = [new]
        elif kind == 3:
            del parts[at : at + int(rng.integers(1, 8))]
        elif kind == 4:
            parts[at:at] = parts[: int(rng.integers(len(parts) + 1))]
        elif rng.random() < 0.3:
            parts = [parts[i] for i in rng.permutation(len(parts))]
    return "".join(parts)[:200_000]


# The kinds of input: each makes one and uses it as the commands would


def seal(path: Path, record: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Write an archive under a right hash."""
    record.pop("content_hash", None)
    try:
        record["content_hash"] = archive.digest(arrays, record)
        np.savez(path, record=np.array(json.dumps(record)), **arrays)
    except (ValueError, TypeError, UnicodeEncodeError):  # such a file cannot be written at all
        path.write_bytes(b"")


def unsealed(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    return json.loads(str(arrays.pop("record"))), arrays


def _changed(rng: Rng, source: Path, path: Path) -> None:
    record, arrays = unsealed(source)
    for _ in range(int(pick(rng, [1, 1, 1, 2]))):
        if rng.random() < 0.7 and arrays:
            with warnings.catch_warnings(), contextlib.suppress(ValueError, TypeError, OverflowError, RuntimeError):
                warnings.simplefilter("ignore")  # what NumPy says of such changes is not what we are after
                change_array(rng, arrays)
        else:
            change_record(rng, record)
    seal(path, record, arrays)


def snapshot(rng: Rng, folder: Path) -> None:
    path = folder / "hostile.npz"
    _changed(rng, registry.snapshot_path(pick(rng, DOMAINS)), path)
    domain = harness.load(path)
    for spec in PLAYED:
        with contextlib.suppress(harness.HarnessError):
            evaluate(domain, spec, episodes=3, horizon=5, engine="tables", workers=1)
    words_of(domain)
    main(["show", str(path), "random", "--horizon", "3", "--engine", "tables"])


def policy(rng: Rng, folder: Path) -> None:
    name, word = pick(rng, [("rocksample-7x8", "qmdp"), ("bordercross-7x8-random", "qmdp"), ("rocksample-7x8", "mdp")])
    path = folder / "hostile.npz"
    _changed(rng, registry.policy_path(name, word), path)
    evaluate(name, f"alpha:{path}", episodes=5, horizon=20, engine="tables", workers=1)


def damaged(rng: Rng, folder: Path) -> None:
    sources = [registry.snapshot_path(name) for name in DOMAINS]
    sources += [registry.policy_path("rocksample-7x8", word) for word in ("qmdp", "mdp")]
    path = folder / "hostile.npz"
    path.write_bytes(change_bytes(rng, pick(rng, sources).read_bytes()))
    if rng.random() < 0.5:
        harness.load(path)
    else:
        make(f"alpha:{path}", harness.load("rocksample-7x8"))


PROGRAM = (
    'if(belief(3) > 0.74) sample()\nif(3 == "good") {\n  right()\n} else up()\nwhile(not x() == 2) left()\ncheck(3)\n'
)
PROGRAM_TOKENS = (
    "if", "else", "while", "and", "or", "not", "loop", "(", ")", "}", "<", ">", "==", "#", "0.5", "3", ",", ".", "?",
    "belief(3)", "right()", "check(1)", "x()", "reading()", '"good"', "check(", " " * 50, "\n", "\t",
    "9" * 400, "if(", "not ", "{", "(", "# ", "::=",
)  # fmt: skip


def program(rng: Rng, folder: Path) -> None:
    domain = harness.load("rocksample-7x8")
    text = change_text(rng, pick(rng, [PROGRAM, "right()\n" * 20, ""]), PROGRAM_TOKENS)
    made = parse(text, words_of(domain))
    assert parse(made.text, words_of(domain)).text == made.text
    evaluate(domain, ProgramPolicy(made), episodes=3, horizon=20, engine="tables", workers=1)


GRAMMAR = "<code> ::= <line> | <code> <line>\n<line> ::= <op> | if(<test>) <op>\n"
GRAMMAR += '<test> ::= belief(3) > 0.<d><d> | 3 == "good"\n'
GRAMMAR += "<op> ::= up() | right() | check(3)\n<d> ::= 0 | 1 | 9  # digits\n"
GRAMMAR_TOKENS = (
    "<code>", "<line>", "<op>", "<d>", "<new>", "::=", "|", "'", "<", ">", "#", "up()", "right()", "if(", "{", '""',
    "\n<code> ::= ", "\n",
    "<code> <code>", "<op> <op> ", "\n<new> ::= ", " | ", '"', " " * 50, "<a" * 20,
)  # fmt: skip


def grammar(rng: Rng, folder: Path) -> None:
    sources = [GRAMMAR, "<code> ::= <code> <code> | right()", registry.grammar_path("rocksample-feedback").read_text()]
    made = bnf.parse(change_text(rng, pick(rng, sources), GRAMMAR_TOKENS))
    with contextlib.suppress(harness.HarnessError):
        check_language(made, words_of(harness.load("rocksample-7x8")))
    for method in METHODS.values():
        for codons in method(made, 2, 50, 1000, 0.5, rng):
            derive(made, codons, int(rng.integers(3)))


def score_file(rng: Rng, folder: Path) -> None:
    path = folder / "scores.toml"
    text = (Path(__file__).parent.parent / "scores.toml").read_text()
    if rng.random() < 0.5:
        text = change_text(rng, text, ("[", "]", "=", "[[score]]", "[[stored]]", "1e9", "[" * 300, "9" * 5000, "nan"))
        path.write_text(text, errors="replace")
    else:
        path.write_bytes(change_bytes(rng, text.encode()))
    stored.read(path)


def run_folder(rng: Rng, folder: Path) -> None:
    run = folder / "run"
    shutil.copytree(folder / "template", run)
    try:
        for _ in range(int(rng.integers(1, 3))):
            _damage_file(rng, pick(rng, sorted(path for path in run.rglob("*") if path.is_file())))
        made = RunFolder(run)
        readers: list[Callable[[], Any]] = [made.config, made.grammar, made.state, lambda: inputs.read(run)]
        pick(rng, readers)()
    finally:
        shutil.rmtree(run)


def _damage_file(rng: Rng, path: Path) -> None:
    data = path.read_bytes()
    if path.suffix == ".json" and rng.random() < 0.6:
        with contextlib.suppress(ValueError):  # damaged before, or nothing that JSON can say
            record = json.loads(data)
            change_record(rng, record)
            path.write_text(json.dumps(record), errors="replace")
    elif rng.random() < 0.05:
        path.unlink()
    else:
        path.write_bytes(change_bytes(rng, data))


COMMANDS = (
    "compare rocksample-7x8 --policy exit --policy random --episodes 3 --horizon 3 --engine tables --format csv",
    "show rocksample-7x8 belief:0.84 --episode 2 --seed 3 --horizon 3 --engine tables",
    "policies bordercross-7x8",
    "show bordercross-7x8-random rollout:2 --episode 1 --horizon 2 --engine tables",
    "show rocksample-7x8 thresholds:accept=0.9 --horizon 2 --engine tables",
)
HOSTILE_WORDS = (
    "", "-", "--", "-1", "0", "9" * 5000, "1" + "0" * 12, str(2**64), "1e5", "nan", "inf", "x" * 5000, "\x1b[31m", "\n",
    "rollout:" + "9" * 5000, "rollout:1000000000000", "rollout:00000000000000000000001", "rollout:-1", "belief:nan",
    "accuracy:1e400", "program:/dev/zero", "program:/etc/passwd", "program:", "alpha:/dev/null", "alpha:", "belief:",
    "thresholds:accept=", "thresholds:accept=1,accept=1", "x.npz", "/dev/null.npz", "--help", "--seed=--", "--episodes",
    "--seed=" + str(2**61), "--horizon=0", "γ", "٣", "--policy=no", "--out=/nowhere/x", "--engine=julia2", "%s", "{0}",
)  # fmt: skip


def command_line(rng: Rng, folder: Path) -> None:
    words = pick(rng, COMMANDS).split()
    for _ in range(int(rng.integers(1, 3))):
        at = int(rng.integers(len(words) + 1))
        words[at : at + int(rng.integers(2))] = [pick(rng, HOSTILE_WORDS)]
    status = 0
    try:
        status = main(words)
    except SystemExit as stop:
        status = int(stop.code or 0)
    assert status in (0, 2), f"exit status {status}"


CASES: dict[str, Case] = {
    case.__name__: case for case in (snapshot, policy, damaged, program, grammar, score_file, run_folder, command_line)
}


# One input


def prepare(folder: Path) -> None:
    """A small evolutionary run, whose folder is damaged; and everything is compiled that inputs use."""
    small = {"population": 6, "generations": 2, "episodes": 3, "max_init_depth": 8, "engine": "tables"}
    harness.evolve(
        DOMAINS[0], out=folder / "template", test_episodes=5, validation_episodes=5, score_episodes=5, **small
    )
    for spec in PLAYED:
        evaluate(DOMAINS[0], spec, episodes=3, horizon=5, engine="tables", workers=1)
    for method in METHODS.values():
        derive(bnf.parse(GRAMMAR), method(bnf.parse(GRAMMAR), 1, 9, 1000, 0.5, np.random.default_rng(0))[0])


def attempt(seed: int, number: int, folder: Path) -> str:
    """What became of an input: ``accepted``, ``refused``, or what was wrong."""
    name = list(CASES)[number % len(CASES)]
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _alarm(), warnings.catch_warnings():
            warnings.simplefilter("error")
            CASES[name](np.random.default_rng([seed, number]), folder)
    except harness.HarnessError as error:
        return _fault_of(str(error)) or "refused"
    except Timeout:
        return f"took over {SECONDS} s"
    except BaseException as error:  # whatever it is, it is what we look for
        if number == _SHOWN:
            traceback.print_exc()
        return f"{type(error).__name__}: {error}"[:200]
    shown, said = out.getvalue(), err.getvalue()
    if not shown.replace("\n", "").isprintable():
        return "unprintable output"
    return _fault_of(said.removesuffix("\n")) or ("refused" if said else "accepted")


_SHOWN: int | None = None


def _fault_of(message: str) -> str:
    if len(message) > LONGEST_SENTENCE + len("harness: ") + 40:  # a misuse ends with: (see: harness COMMAND --help)
        return f"a message of {len(message)} characters"
    return "" if message.isprintable() else "an unprintable message"


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    def ring(*_: Any) -> None:
        raise Timeout

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


# Many inputs


def work(seed: int, first: int, last: int) -> None:
    """In a worker: a line ``number outcome`` for each input."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as folder:
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
    return Outcome(number, list(CASES)[number % len(CASES)], result)


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
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            print(attempt(options.seed, options.only, Path(folder)))
        return 0
    return int(report(options.seed, options.first, options.first + options.count) > 0)


if __name__ == "__main__":
    sys.exit(command())
