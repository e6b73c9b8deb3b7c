"""The command line: exit statuses, one clear sentence for every misuse, output for people and programs."""

from __future__ import annotations

import importlib.metadata
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import harness
from harness.cli import main

PATIENCE = 600
"""Seconds until what does not end counts as hanging, on the busiest of machines."""
NO_JULIA = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON_JULIACALL")}


def run(*arguments, env=NO_JULIA):
    command = [sys.executable, "-m", "harness", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=env, check=False)


def misuse(capsys, *arguments):
    """The one line on standard error of a command that must end with status 2."""
    try:
        status = main([str(a) for a in arguments])
    except SystemExit as error:  # argparse
        status = error.code
    captured = capsys.readouterr()
    assert status == 2
    assert captured.out == ""
    assert captured.err.startswith("harness: ")
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["compare", "rocksampl-7x8"], "did you mean 'rocksample-7x8'"),
        (["compare", "rocksample-7x8", "--policy", "sarsp"], "did you mean 'sarsop'"),
        (["compare", "rocksample-7x8", "--policy", "belief:2"], "out of range"),
        (["compare", "rocksample-7x8", "--episodes", "0"], "'0' is not a whole number from 1 to 2,305,843,009,213,"),
        (["compare", "rocksample-7x8", "--episodes", "1" + "0" * 12], "a whole number from 1 to 100,000,000, not 1000"),
        (["show", "rocksample-7x8", "exit", "--seed", str(2**64)], "is not a whole number from 0 to 2,305,843,"),
        (["show", "rocksample-7x8", "exit", "--seed=--"], "--seed needs a value, not '--'"),
        (["show", "rocksample-7x8", "rollout:1000000000000"], "from 1 to 1,000,000, not '1000000000000'"),
        (["show", "rocksample-7x8", "rollout:00000000000000000001"], "from 1 to 1,000,000, not '0000"),
        (["show", "rocksample-7x8", "rollout:" + "9" * 5000], "from 1 to 1,000,000, not '9999"),
        (["compare", "rocksample-7x8", "--episodes", "many"], "'many' is not a whole number"),
        (["compare", "rocksample-7x8", "--seed", "-1"], "'-1' is not a whole number"),
        (["compare", "rocksample-7x8", "--engine", "table"], "did you mean 'tables'"),
        (["compare", "rocksample-7x8", "--format", "xml"], "invalid choice: 'xml'"),
        (["compare", "rocksample-7x8", "--policy", "exit", "--episodes", "3", "--engine=tables", "--out", "/no/file"],
         "cannot write /no/file"),
        (["compare", "none.npz"], "none.npz: no such file"),
        (["show", "rocksample-7x8", "sarsp"], "did you mean"),
        (["comparre", "rocksample-7x8"], "invalid choice"),
        ([], "required"),
        (["solve", "rocksample-7x8", "--time", "-3"], "'-3' is not a number above 0"),
        (["solve", "rocksample-7x8", "--gap", "nan"], "'nan' is not a number above 0"),
        (["solve", "rocksample-7x8", "--solver", "qmdp", "--time", "3"], "timeout is a limit of sarsop"),
    ],
)  # fmt: skip
def test_misuse_gets_one_sentence_and_status_2(capsys, arguments, words):
    assert words in misuse(capsys, *arguments)


def test_a_truncated_snapshot_is_one_sentence(capsys, tmp_path):
    path = tmp_path / "half.npz"
    path.write_bytes(b"PK\x03\x04 and then nothing")
    assert "not a readable domain file" in misuse(capsys, "compare", path)


@pytest.mark.parametrize(
    "arguments", [["compare", "rocksample-7x8", "--engine", "julia"], ["export"], ["julia", "test"]]
)
def test_julia_without_julia_is_one_sentence(arguments):
    result = run(*arguments)
    assert result.returncode == 2
    assert "Julia is not set up" in result.stderr
    assert "harness julia" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    "command",
    [["compare"], ["show", "random"], ["solve"], ["check-domain"], ["policies"], ["tune", "--policy=x"]],
)
def test_a_julia_file_without_julia_is_one_sentence_and_imports_no_juliacall(tmp_path, command):
    """Importing juliacall would look for a Julia on the network."""
    (tmp_path / "juliacall.py").write_text("raise SystemExit('juliacall was imported')")
    (tmp_path / "model.jl").write_text("error()")
    env = {**NO_JULIA, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    for name, words in (("model.jl", "Julia is not set up"), ("none.jl", "none.jl': no such file")):
        result = run(command[0], tmp_path / name, *command[1:], env=env)
        assert result.returncode == 2
        assert words in result.stderr
        assert result.stderr.count("\n") == 1


def test_half_a_set_up_says_what_is_missing():
    result = run("julia", env={**NO_JULIA, "PYTHON_JULIACALL_EXE": sys.executable})
    assert result.returncode == 1
    assert "set PYTHON_JULIACALL_PROJECT too" in result.stdout
    result = run("julia", env={**NO_JULIA, "PYTHON_JULIACALL_EXE": sys.executable, "PYTHON_JULIACALL_PROJECT": "/"})
    assert "does not have PomdpHarness" in result.stdout
    assert "--engine auto means 'tables'" in result.stdout


def test_compare_prints_the_table(capsys):
    assert main(["compare", "rocksample-7x8", "--policy", "exit", "--episodes", "5", "--engine", "tables"]) == 0
    out = capsys.readouterr().out
    assert "rocksample-7x8 (version 1), horizon 50, engine tables, seed 0" in out
    assert "10.00 ± 0.00" in out


def test_compare_writes_json(tmp_path):
    path = tmp_path / "rows.json"
    arguments = ["--policy", "exit", "--episodes", "5", "--engine", "tables", "--format", "json", "--out", str(path)]
    assert main(["compare", "rocksample-7x8", *arguments]) == 0
    (row,) = json.loads(path.read_text())
    assert row["policy"] == "exit"
    assert row["mean"] == 10
    assert row["engine"] == "tables"
    assert row["domain_version"] == 1


def test_domains_and_policies_are_listed(capsys):
    assert main(["domains"]) == 0
    out = capsys.readouterr().out
    for name, size in (("rocksample-7x8", "12,545"), ("rocksample-15x15", "7,372,801"), ("bordercross-7x8", "1,765")):
        line = next(line for line in out.splitlines() if line.startswith(f"{name} "))
        assert size in line
        assert "POMDPs.jl" in line
    assert main(["policies", "bordercross-7x8"]) == 0
    out = capsys.readouterr().out
    assert "sarsop" in out
    assert "belief" not in out


def test_show_replays_the_episode_that_compare_scores(capsys, rocksample):
    from harness.play.evaluation import evaluate

    returns = evaluate(rocksample, "belief:0.84", episodes=6, seed=4, engine="tables").returns
    for episode, value in enumerate(returns):
        assert (
            main(["show", "rocksample-7x8", "belief", "--seed", "4", "--episode", str(episode), "--engine", "tables"])
            == 0
        )
        out = capsys.readouterr().out
        assert f"return {value:g}, discounted" in out.splitlines()[-2]
    assert "check(3), reading " in out
    assert "rock 3 0." in out


@pytest.mark.parametrize("domain", ["bordercross-7x8", "bordercross-7x8-random"])
def test_show_draws_bordercross(capsys, domain):
    assert main(["show", domain, "sarsop", "--engine", "tables"]) == 0
    out = capsys.readouterr().out
    assert "cooperate()" in out
    assert "return 500" in out
    assert out.count("X >") >= 7


def test_escape_sequences_of_a_program_do_not_reach_the_terminal(capsys, tmp_path):
    (tmp_path / "p.txt").write_text("# \x1b]0;title\x07\nright()\n\x1b]0;title\x07")
    error = misuse(capsys, "show", "rocksample-7x8", f"program:{tmp_path / 'p.txt'}")
    assert "line 3, column 1: " in error
    assert error[:-1].isprintable()


def test_check_domain_passes(capsys):
    assert main(["check-domain", "bordercross-7x8-random", "--engine", "tables"]) == 0
    assert "all checks passed" in capsys.readouterr().out


LONG = """
from pathlib import Path
from harness.policy.rollout import RolloutPolicy

class Long(RolloutPolicy):
    def __init__(self, domain):
        super().__init__(domain, 2000)

    def act(self, batch):
        Path("begun").touch()
        return super().act(batch)
"""


def interrupted_when_long(command, folder):
    """Output, errors and the process of a command that is interrupted as soon as the policy LONG in a folder acts."""
    path = os.pathsep.join([str(Path(harness.__file__).parent.parent), os.environ.get("PYTHONPATH", "")])
    options = {"cwd": folder, "env": {**NO_JULIA, "PYTHONPATH": path}, "text": True}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options) as process:
        while not (folder / "begun").exists() and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        return *process.communicate(timeout=PATIENCE), process


def test_ctrl_c_stops_between_steps(tmp_path):
    """A long comparison in a process of its own, interrupted for real: the rows finished by then are printed."""
    (tmp_path / "long.py").write_text(LONG)
    policies = ["--policy", "exit", "--policy", "long.py:Long", "--policy", "random"]
    command = [sys.executable, "-m", "harness", "compare", "rocksample-7x8", "--episodes", "100000", *policies]
    out, err, process = interrupted_when_long(command, tmp_path)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "10.00 ± 0.00" in out  # exit had finished
    assert "random" not in out
    assert "Long" not in out
    assert "Traceback" not in err


_SWALLOWS_CTRL_C = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(9)
except BaseException:
    pass
"""


@pytest.mark.parametrize("module", ["argparse", "tabulate"])  # at the parser's import, and at the command's
def test_ctrl_c_during_an_import_that_swallows_it_is_one_line(tmp_path, module):
    (tmp_path / f"{module}.py").write_text(_SWALLOWS_CTRL_C)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    result = run("domains", env={**NO_JULIA, "PYTHONPATH": path})
    assert (result.returncode, result.stderr) == (130, "harness: interrupted\n")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
@pytest.mark.parametrize(
    "arguments", [["policies", "rocksample-7x8"], ["--help"], ["show", "bordercross-7x8", "sarsop", "--engine=tables"]]
)
def test_a_full_disk_behind_the_output_is_one_sentence(arguments):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "harness", *arguments]
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=NO_JULIA, check=False)
    assert result.returncode == 2
    assert result.stderr == "harness: cannot read or write the output: No space left on device\n"


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_an_encoding_without_our_signs_is_no_error(encoding):
    result = run("policies", "rocksample-7x8", env={**NO_JULIA, "PYTHONIOENCODING": encoding})
    assert (result.returncode, result.stderr) == (0, "")
    assert "threshold \\u03b3" in result.stdout
    result = run("compare", "γ\udcff", env={**NO_JULIA, "PYTHONIOENCODING": encoding})
    assert result.returncode == 2
    assert result.stderr.startswith("harness: no domain '\\u03b3\\udcff'")


def test_misuse_echoes_little_of_a_long_argument(capsys):
    for arguments in (
        ["x" * 5000],
        ["domains", "x\n" * 5000],
        ["compare", "--episodes", "\x1b" * 5000, "rocksample-7x8"],
    ):
        error = misuse(capsys, *arguments)
        assert len(error) < 310
        assert error[:-1].isprintable()


def test_the_parser_imports_nothing_that_commands_need():
    script = "import sys, harness.cli; harness.cli._parsers(); print({'numpy', 'harness.registry'} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "set()"


def test_the_words_of_evolutions_parameters_are_those_that_there_are():
    from harness.ge import initialisation, operators, parameters

    assert tuple(initialisation.METHODS) == parameters.INITIALISATIONS
    assert tuple(operators.CROSSOVERS) == parameters.CROSSOVERS
    assert (*operators.MUTATIONS, parameters.EDITS) == parameters.MUTATIONS


@pytest.mark.parametrize(
    ("line", "completed"),
    [
        ("harness comp", ["compare "]),
        ("harness compare --epi", ["--episodes "]),
        ("harness compare bordercross-7x8-", ["bordercross-7x8-random "]),
        ("harness solve bordercross-7x8 --solver native", ["native-sarsop "]),
    ],
)
def test_a_shell_completes(tmp_path, line, completed):
    """Asked as argcomplete's shell function asks."""
    pytest.importorskip("argcomplete")
    out = tmp_path / "out"
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n"}
    run(env={**os.environ, **asked, "_ARGCOMPLETE_STDOUT_FILENAME": str(out)})
    assert out.read_text().split("\n") == completed


def test_the_version_is_the_installed_packages(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"harness {importlib.metadata.version('pomdp-harness')}\n"
    assert harness.__version__ == importlib.metadata.version("pomdp-harness")


_USER_CODE = """
import harness

domain = harness.load("rocksample-7x8")
mean: float = harness.evaluate(domain, "belief", episodes=100).score.mean
size: str = domain.n_states
harness.evalute(domain, "belief")
"""


def test_a_users_code_is_type_checked_against_us(tmp_path):
    """As an installed package has it: mypy looks into one only where it has a py.typed. With what `make lint` knows."""
    package = Path(harness.__file__).parent
    assert (package / "py.typed").is_file()
    (tmp_path / "user.py").write_text(_USER_CODE)
    kept = ["--config-file", str(package.parent / "pyproject.toml"), "--cache-dir", str(package.parent / ".mypy_cache")]
    command = [sys.executable, "-m", "mypy", *kept, str(tmp_path / "user.py")]
    env = {**os.environ, "MYPYPATH": str(package.parent)}
    result = subprocess.run(command, capture_output=True, text=True, env=env, cwd=tmp_path, check=False)
    assert [line.split(": ", 1)[0].rpartition(":")[2] for line in result.stdout.splitlines()[:-1]] == ["6", "7"]


def test_a_reader_that_stops_reading_is_no_error():
    command = f"{sys.executable} -m harness show rocksample-7x8 random --engine tables | head -n 2"
    result = subprocess.run(command, shell=True, capture_output=True, text=True, env=NO_JULIA, check=False)
    assert result.stderr == ""


def test_importing_harness_loads_nothing_heavy():
    heavy = "{'juliacall', 'juliapkg', 'numba', 'pandas', 'tqdm', 'tabulate', 'cma', 'matplotlib'}"
    script = f"import sys, harness; print({heavy} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "set()"
