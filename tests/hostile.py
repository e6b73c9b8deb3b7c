"""Hostile inputs: what is changed, how, and the kinds of input, each used as the commands and Python would use it."""

from __future__ import annotations

import contextlib
import fnmatch
import json
import os
import re
import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot

import harness
from harness import registry
from harness.cli import main
from harness.ge import grammar as bnf
from harness.ge import parameter_file
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
from harness.report import inputs, write_report
from harness.reproduction import Sizes, reproduce
from harness.tuning import resume as resume_tuning
from harness.tuning.sweeping import resume as resume_sweep

TRIED: list[str] = []
"""The texts of the present input, so that a message can be searched for pieces of them."""


def tried(text: str | bytes) -> None:
    TRIED.append(text if isinstance(text, str) else text.decode("utf-8", "replace"))


Rng = np.random.Generator
Case = Callable[[Rng, Path], None]

DOMAINS = ("rocksample-7x8", "bordercross-7x8-random")
PLAYED = ("random-legal", "rollout:1", "accuracy", "belief", "thresholds", "exit", "qmdp")
SECRET = "/etc/passwd"
ODD_TEXTS = (
    "", "\x1b[31m", "\n", "a" * 5000, "γ", "\ud800", "'", '"', "%s", "{}", "../../etc/passwd", "check(01)", "\0",
    f"program:{SECRET}", f"alpha:{SECRET}", "/nowhere/x.jl", "/nowhere/own.py:Name", "os:system",
)  # fmt: skip
ODD_NUMBERS = (-1, 0, 1, -(2**31), 2**31 - 1, 2**63 - 1, 10**400, 0.5, -0.0, 1e308, float("nan"), float("inf"))
ODD_VALUES = (*ODD_TEXTS, *ODD_NUMBERS, None, True, [], {}, [[]], ["a", "a"], [["a", 0, 0]], [["a"] * 3])


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
    tried(text)
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
    text = change_text(rng, pick(rng, sources), GRAMMAR_TOKENS)
    tried(text)
    made = bnf.parse(text)
    with contextlib.suppress(harness.HarnessError):
        check_language(made, words_of(harness.load("rocksample-7x8")))
    for method in METHODS.values():
        for codons in method(made, 2, 50, 1000, 0.5, rng):
            derive(made, codons, int(rng.integers(3)))


SCORE_TOKENS = ("[", "]", "=", "[[score]]", "[[stored]]", "1e9", "[" * 300, "9" * 5000, "nan", '"', "-", "0", "policy")


def score_file(rng: Rng, folder: Path) -> None:
    path = folder / "scores.toml"
    _damage_toml(rng, (Path(__file__).parent.parent / "scores.toml").read_text(), path, SCORE_TOKENS)
    stored.read(path)


def score_check(rng: Rng, folder: Path) -> None:
    """A short list with its stored scores, which is also played."""
    path = folder / "short.toml"
    _damage_toml(rng, (folder / "template.toml").read_text(), path, SCORE_TOKENS)
    words = ["check", str(path), *pick(rng, [[], [], ["--exact"], ["--seed", "7"], ["--update"], ["--engine", "x"]])]
    status = main(words)
    assert status in (0, 1, 2), f"exit status {status}"


def parameter_file_(rng: Rng, folder: Path) -> None:
    path = folder / "parameters.toml"
    _damage_toml(rng, (folder / "template" / "parameters.toml").read_text(), path, (*SCORE_TOKENS, "population = 3\n"))
    parameter_file.read(path)


def _damage_toml(rng: Rng, text: str, path: Path, tokens: tuple[str, ...]) -> None:
    if rng.random() < 0.5:
        path.write_text(change_text(rng, text, tokens), errors="replace")
    else:
        path.write_bytes(change_bytes(rng, text.encode()))
    tried(path.read_bytes())


def result_table(rng: Rng, folder: Path) -> None:
    """What a report is made of."""
    source = folder / pick(rng, ["table.csv", "table.json", "sweep/sweep.csv"])
    path = folder / f"hostile{source.suffix}"
    shutil.copy(source, path)
    for _ in range(int(rng.integers(1, 3))):
        if source.suffix == ".csv" and rng.random() < 0.6:
            _change_cell(rng, path)
        else:
            _damage_file(rng, path, spare=True)
    tried(path.read_bytes())
    write_report(path, folder / "page", episodes=1)


def _change_cell(rng: Rng, path: Path) -> None:
    rows = [line.split(",") for line in path.read_text(errors="replace").split("\n")]
    row = pick(rng, rows)
    row[int(rng.integers(len(row)))] = str(pick(rng, [x for x in ODD_VALUES if x != 10**400]))
    path.write_text("\n".join(",".join(row) for row in rows), errors="replace")


def run_folder(rng: Rng, folder: Path) -> None:
    with _copy_damaged(rng, folder / "template") as run:
        made = RunFolder(run)
        readers: list[Callable[[], Any]] = [made.config, made.grammar, made.state, lambda: inputs.read(run)]
        readers += [lambda: harness.resume(run, workers=1)] * 2
        pick(rng, readers)()


def runs_folder(rng: Rng, folder: Path) -> None:
    """Of several runs, with their plan."""
    with _copy_damaged(rng, folder / "runs") as run:
        pick(rng, [lambda: inputs.read(run), lambda: harness.resume(run, workers=1)])()


def tuned_folder(rng: Rng, folder: Path) -> None:
    word = pick(rng, ["tune", "sweep"])
    with _copy_damaged(rng, folder / word) as run:
        kind = rng.random()
        if kind < 0.3:
            inputs.read(run)
        elif kind < 0.32:  # with its picture, which takes long
            main([word, "--resume", str(run)])
        else:
            {"tune": resume_tuning, "sweep": resume_sweep}[word](run)


def reproduced_folder(rng: Rng, folder: Path) -> None:
    with _copy_damaged(rng, folder / "reproduction", ("report.md", "figure4.txt", "figure7.txt", "front*")) as run:
        (run / "report.md").unlink(missing_ok=True)
        reproduce(run, REPRODUCED, workers=1)


def _is_one(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatch.fnmatch(name, pattern) for pattern in patterns)


@contextlib.contextmanager
def _copy_damaged(rng: Rng, source: Path, spared: tuple[str, ...] = ()) -> Iterator[Path]:
    run = source.with_name("copy")
    shutil.copytree(source, run)
    try:
        for _ in range(int(rng.integers(1, 3))):
            files = [path for path in run.rglob("*") if path.is_file() and not _is_one(path.name, spared)]
            _damage_file(rng, pick(rng, sorted(files)))
        for path in sorted(run.rglob("*")):
            if path.suffix in (".json", ".csv", ".txt", ".bnf", ".md") and path.is_file():
                tried(path.read_bytes())
        yield run
    finally:
        shutil.rmtree(run)


def _damage_file(rng: Rng, path: Path, *, spare: bool = False) -> None:
    data = path.read_bytes()
    if path.suffix == ".json" and rng.random() < 0.6:
        with contextlib.suppress(ValueError):  # damaged before, or nothing that JSON can say
            record = json.loads(data)
            change_record(rng, record)
            path.write_text(json.dumps(record), errors="replace")
    elif rng.random() < 0.05 and not spare:
        path.unlink()
    else:
        path.write_bytes(change_bytes(rng, data))


COMMANDS = (
    "compare rocksample-7x8 --policy exit --policy random --episodes 3 --horizon 3 --engine tables --format csv",
    "show rocksample-7x8 belief:0.84 --episode 2 --seed 3 --horizon 3 --engine tables",
    "policies bordercross-7x8",
    "show bordercross-7x8-random rollout:2 --episode 1 --horizon 2 --engine tables",
    "show rocksample-7x8 thresholds:accept=0.9 --horizon 2 --engine tables",
    "check-policy rocksample-7x8 exit --episodes 3",
    "check-domain bordercross-7x8-random --engine tables",
    "sweep rocksample-7x8 --policy belief --from 0.6 --to 0.9 --points 2 --episodes 3 --horizon 3 --engine tables",
    "sweep rocksample-7x8 --policy belief --points 2 --episodes 3 --horizon 3 --engine tables --out DIR/sweep",
    "tune rocksample-7x8 --policy belief:0.6 --method spsa --measure return --seed 3 --horizon 3 --engine tables "
    "--set iterations=1 --set validation_episodes=3 --set final_episodes=3 --set episodes=3 --out DIR/tuning",
    "evolve rocksample-7x8 --engine tables --population 4 --generations 1 --episodes 2 --max-init-depth 6 "
    "--test-episodes 2 --validation-episodes 2 --score-episodes 2 --workers 1 --out DIR/run",
    "report DIR/table.csv --out DIR/page --episodes 1 --seed 3",
    "domains",
)
HOSTILE_WORDS = (
    "", "-", "--", "-1", "0", "9" * 5000, "1" + "0" * 12, str(2**64), "1e5", "nan", "inf", "x" * 5000, "\x1b[31m", "\n",
    "rollout:" + "9" * 5000, "rollout:1000000000000", "rollout:00000000000000000000001", "rollout:-1", "belief:nan",
    "accuracy:1e400", "program:/dev/zero", "program:/etc/passwd", "program:", "alpha:/dev/null", "alpha:", "belief:",
    "thresholds:accept=", "thresholds:accept=1,accept=1", "x.npz", "/dev/null.npz", "--help", "--seed=--", "--episodes",
    "--seed=" + str(2**61), "--set=episodes=2.5", "--set=nan", "--out=DIR/new", "--resume=DIR",
    "--population=" + "9" * 7, "--horizon=0", "γ", "٣", "--policy=no", "--out=/nowhere/x", "--engine=julia2", "%s",
    "{0}",
)  # fmt: skip


MILD_WORDS = ("--seed=2", "--horizon=2", "--episodes=2", "2", "exit", "belief:0.9", "--engine=tables")


def command_line(rng: Rng, folder: Path) -> None:
    words = pick(rng, COMMANDS).split()
    for _ in range(int(rng.integers(1, 3))):
        at = int(rng.integers(len(words) + 1))
        words[at : at + int(rng.integers(2))] = [pick(rng, HOSTILE_WORDS if rng.random() < 0.7 else MILD_WORDS)]
    place = folder / "place"
    place.mkdir()
    shutil.copy(folder / "table.csv", place)
    words = [word.replace("DIR", str(place)) for word in words]
    tried("\n".join(words))
    status = 0
    try:
        os.chdir(place)  # where words may name files to be written
        status = main(words)
    except SystemExit as stop:
        status = int(stop.code or 0)
    finally:
        os.chdir(folder)
        shutil.rmtree(place)
    assert status in (0, 2), f"exit status {status}"


# Python: entry points with odd arguments of the types that they are documented to take, and policies of a user's own

TINY: dict[str, Any] = {"engine": "tables", "seed": 1, "horizon": 3}
EVOLVED: dict[str, Any] = {"population": 4, "generations": 1, "episodes": 2, "max_init_depth": 6, "engine": "tables"}
EVOLVED |= {"test_episodes": 2, "validation_episodes": 2, "score_episodes": 2, "workers": 1}
CALLS: tuple[tuple[Callable[..., Any], dict[str, Any]], ...] = (
    (harness.evaluate, {"domain": DOMAINS[0], "policy": "belief", "episodes": 3, "first": 0, "workers": 1, **TINY}),
    (harness.compare, {"domain": DOMAINS[0], "policies": ["exit"], "against": "exit", "episodes": 3, "workers": 1,
                       **TINY}),
    (lambda **given: list(harness.replay(**given)), {"domain": DOMAINS[1], "spec": "random", "episode": 2, **TINY}),
    (harness.draw_beliefs, {"domain": DOMAINS[0], "policy": "belief", "episode": 2, **TINY}),
    (harness.draw_episode, {"domain": DOMAINS[1], "policy": "random", "episode": 2, **TINY}),
    (harness.draw_layout, {"domain": DOMAINS[0]}),
    (harness.load, {"name": DOMAINS[0]}),
    (harness.check_domain, {"domain": DOMAINS[1], "engine": "tables", "episodes": 5, "seed": 1}),
    (harness.check_policy, {"policy": "exit", "domain": DOMAINS[0], "episodes": 5, "seed": 1, "horizon": 3}),
    (harness.sweep, {"domain": DOMAINS[0], "policy": "belief", "parameter": "threshold", "start": 0.6, "stop": 0.9,
                     "points": 2, "episodes": 3, "workers": 1, **TINY}),
    (harness.sweep, {"domain": DOMAINS[0], "policy": "belief", "values": [0.6], "episodes": 3, "workers": 1, **TINY}),
    (harness.tune, {"domain": DOMAINS[0], "policy": "belief:0.6", "method": "spsa", "measure": "return", "episodes": 3,
                    "iterations": 1, "validation_episodes": 3, "final_episodes": 3, "workers": 1, **TINY}),
    (harness.evolve, {"domain": DOMAINS[0], "grammar": None, "runs": 1, "seed": 1, "tail": 0.5, "max_wraps": 0,
                      "tournament": 2, "elites": 1, "mutation": "subtree", "crossover": "subtree", "penalty": 0.1,
                      "free_length": 9, "codon_size": 99, "max_codons": 99, "refine": 1, "refine_episodes": 2,
                      "refine_every": 1, "finalists": 2, **EVOLVED}),
    (harness.resume, {"out": "TEMPLATE", "generations": 2, "workers": 1}),
    (harness.check_scores, {"path": "SCORES", "seed": 3, "engine": "tables"}),
    (harness.write_report, {"sources": "TABLE", "out": "PAGE", "episodes": 1, "seed": 3}),
    (lambda **given: harness.render(harness.compare(DOMAINS[0], ["exit"], episodes=3), **given), {"format": "csv"}),
)  # fmt: skip
WHOLE = (-1, 0, 1, 2, -(2**31), 2**31 - 1, 2**63 - 1, 2**63, 2**64 - 1, 2**64, 10**30, 10**400)
NUMBERS = (*WHOLE, -0.0, 0.5, 1.0, 1.5, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"))
SPECS = tuple(word for word in (*HOSTILE_WORDS, *ODD_TEXTS) if word != "program:/dev/zero")


def python(rng: Rng, folder: Path) -> None:
    call, given = pick(rng, CALLS)
    given = dict(given)
    for _ in range(int(rng.integers(1, 3))):
        name = pick(rng, sorted(given))
        given[name] = _odd(rng, given[name])
    shutil.copy(folder / "template.toml", folder / "short.toml")
    places = {"TEMPLATE": "copy", "SCORES": "short.toml", "TABLE": "table.csv", "PAGE": "page"}
    given = {k: folder / places[x] if isinstance(x, str) and x in places else x for k, x in given.items()}
    tried("\n".join(str(x) for x in given.values() if x != 10**400))
    shutil.copytree(folder / "template", folder / "copy")
    try:
        call(**given)
    finally:
        shutil.rmtree(folder / "copy")
        pyplot.close("all")


def _odd(rng: Rng, value: Any) -> Any:
    """Something of the same type."""
    if isinstance(value, list):
        other = [_odd(rng, value[0])] if value else []
        return pick(rng, [[], value * 2, other, value + other])
    if value is None or isinstance(value, str):
        return pick(rng, SPECS)
    return pick(rng, NUMBERS if isinstance(value, float) else WHOLE)


class Own:
    """A policy whose actions and attributes are given."""

    def __init__(self, actions: Any, attributes: dict[str, Any]) -> None:
        self.actions = actions
        vars(self).update(attributes)

    def reset(self, batch: Any) -> None:
        """Nothing to forget."""

    def act(self, batch: Any) -> Any:
        return self.actions(batch.size)


ACTIONS: tuple[Callable[[int], Any], ...] = (
    lambda n: None, lambda n: "up", lambda n: [], lambda n: [0] * n, lambda n: [[0] * n], lambda n: [0] * (n + 1),
    lambda n: np.zeros(n), lambda n: np.full(n, np.nan), lambda n: np.full(n, 2**40), lambda n: np.full(n, -1),
    lambda n: np.full(n, -2), lambda n: np.full(n, 13, dtype="u1"), lambda n: np.zeros(n, dtype="?"), lambda n: {},
    lambda n: np.zeros(n, dtype="M8[s]"), lambda n: np.array([None] * n), lambda n: [10**400] * n, lambda n: [[0], []],
    lambda n: np.full(n, 2**64 - 1, dtype="u8"), lambda n: range(n), lambda n: np.zeros((n, 1), dtype=int),
    lambda n: np.zeros(n, dtype=">i8"), lambda n: np.zeros(2 * n, dtype=int)[::2], lambda n: ["\x1b[31m" * 99] * n,
)  # fmt: skip
ATTRIBUTES: tuple[dict[str, Any], ...] = (
    {}, {}, {"uses_belief": None}, {"batch_size": 0}, {"batch_size": -1}, {"batch_size": 10**30}, {"batch_size": "x"},
    {"batch_size": 1.5}, {"max_episodes": 0}, {"max_episodes": "x"}, {"clone": None}, {"clone": lambda: None},
    {"clone": 3}, {"clone": lambda: Own(lambda n: [0] * n, {})}, {"uses_belief": "no"}, {"max_episodes": -1},
)  # fmt: skip


def own_policy(rng: Rng, folder: Path) -> None:
    policy = Own(pick(rng, ACTIONS), pick(rng, ATTRIBUTES))
    use: Callable[..., Any] = pick(rng, [harness.evaluate, harness.compare, harness.check_policy, harness.replay])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Own cannot be copied", UserWarning)
        if use is harness.check_policy:
            use(policy, DOMAINS[0], episodes=30, horizon=3)
        elif use is harness.replay:
            list(use(DOMAINS[0], policy, horizon=3, engine="tables"))
        else:
            use(DOMAINS[0], policy, episodes=30, horizon=3, engine="tables", workers=2)


CASES: dict[str, Case] = {
    case.__name__.rstrip("_"): case
    for case in (
        snapshot, policy, damaged, program, grammar, score_file, score_check, parameter_file_, result_table, run_folder,
        runs_folder, tuned_folder, reproduced_folder, command_line, python, own_policy,
    )
}  # fmt: skip
ORDER = [
    kind for turn in range(4) for kind in CASES if turn % {"reproduced_folder": 4, "runs_folder": 2}.get(kind, 1) == 0
]
"""Kinds in the order in which they come; those that take long come less often."""
CHOSEN = ("command_line", "python")
"""Kinds whose words are the user's own: they may name any file. Data may not."""


SCORES = """[[score]]
domain = "rocksample-7x8"
policy = "belief:0.84"
episodes = 30
max_episodes = 60

[[score]]
domain = "bordercross-7x8"
policy = "random"
episodes = 30
max_episodes = 30
horizon = 5
"""
REPRODUCED = Sizes(
    episodes=10, rollout_episodes=3, sweep_points=3, sweep_episodes=5, gradient_episodes=10, runs=1, population=6,
    training_episodes=2, generations=1, threshold_generations=1, test_episodes=5,
)  # fmt: skip


def prepare(folder: Path) -> None:
    """Small results of all kinds, to be damaged; and everything is compiled that inputs use."""
    harness.evolve(DOMAINS[0], out=folder / "template", **{**EVOLVED, "generations": 2})
    harness.evolve(DOMAINS[0], out=folder / "runs", runs=2, **EVOLVED)
    main([word.replace("DIR/sweep", str(folder / "sweep")) for word in COMMANDS[8].split()])
    main([word.replace("DIR/tuning", str(folder / "tune")) for word in COMMANDS[9].split()])
    (folder / "template.toml").write_text(SCORES)
    harness.update_scores(folder / "template.toml")
    table = harness.compare(DOMAINS[0], ["exit", "belief", "mdp"], episodes=5, engine="tables")
    for form in ("csv", "json"):
        (folder / f"table.{form}").write_text(harness.render(table, form))
    reproduce(folder / "reproduction", REPRODUCED, workers=1)
    for spec in PLAYED:
        evaluate(DOMAINS[0], spec, episodes=3, horizon=5, engine="tables", workers=1)
    for method in METHODS.values():
        derive(bnf.parse(GRAMMAR), method(bnf.parse(GRAMMAR), 1, 9, 1000, 0.5, np.random.default_rng(0))[0])
