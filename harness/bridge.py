"""The one module that touches Julia. Importing it starts nothing; the first call that needs Julia does.

Julia and its packages come through juliapkg (``julia/juliapkg.json``), into an environment of this Python
environment's own. A Julia that is already there is used instead when ``PYTHON_JULIACALL_EXE`` and
``PYTHON_JULIACALL_PROJECT`` name it and a project that has the package.
"""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import JuliaError, quoted
from harness.model import domain as domains
from harness.model.domain import Domain

_EXE, _PROJECT = "PYTHON_JULIACALL_EXE", "PYTHON_JULIACALL_PROJECT"

# What juliacall must be told before it is imported. Julia's threads need its own signal handling; `_keep_ctrl_c`
# then gives Ctrl-C back to Python.
_DEFAULTS = {"PYTHON_JULIACALL_HANDLE_SIGNALS": "yes", "PYTHON_JULIACALL_THREADS": "auto"}


def package_folder() -> Path:
    """Folder of the Julia package: ``julia/`` of a checkout, or where the wheel puts it."""
    here = Path(__file__).resolve().parent.parent
    for folder in (here / "julia", here / "pomdp_harness_julia"):
        if (folder / "src" / "PomdpHarness.jl").is_file():
            return folder
    raise JuliaError("the Julia package of the harness is missing from this installation; install the harness again")


@dataclass(frozen=True)
class Check:
    """One step of the set-up: what it is, whether it is in order, and what was found or is to be done."""

    name: str
    ok: bool
    text: str


def status() -> list[Check]:
    """What is set up and what is missing, step by step, without starting Julia or reaching for the network."""
    checks = [Check("Julia package of the harness", True, str(package_folder()))]
    if importlib.util.find_spec("juliacall") is None:
        return [*checks, Check("juliacall", False, "not installed: pip install juliacall")]
    checks.append(Check("juliacall", True, f"version {importlib.metadata.version('juliacall')}"))
    own = {name: os.environ.get(name) for name in (_EXE, _PROJECT)}
    return checks + (_check_own_julia(own) if any(own.values()) else _check_juliapkg())


def _check_own_julia(own: Mapping[str, str | None]) -> list[Check]:
    missing = [name for name, value in own.items() if not value]
    if missing:
        return [Check("your own Julia", False, f"{_EXE} and {_PROJECT} go together: set {missing[0]} too")]
    exe, project = str(own[_EXE]), Path(str(own[_PROJECT]))
    if shutil.which(exe) is None:
        return [Check("your own Julia", False, f"{_EXE} names no program: {exe}")]
    checks = [Check("your own Julia", True, f"{exe} (from {_EXE})")]
    manifest = "".join(path.read_text() for path in sorted(project.glob("*Manifest*.toml")))
    if "PomdpHarness" not in manifest:
        mend = f"""julia --project={project} -e 'using Pkg; Pkg.develop(path="{package_folder()}")'"""
        return [*checks, Check("project", False, f"{project} (from {_PROJECT}) does not have PomdpHarness: {mend}")]
    found = re.search(r'^\[\[deps\.PythonCall\]\](?:\n(?!\[\[).*)*?\nversion = "(.*?)"', manifest, re.MULTILINE)
    installed = importlib.metadata.version("juliacall")
    if found is None or found[1] != installed:
        text = f"{project} has PythonCall {found[1] if found else 'not at all'}, juliacall is {installed}: "
        mend = f"they must be of one version: pip install juliacall=={found[1]}" if found else "add PythonCall to it"
        return [*checks, Check("project", False, text + mend)]
    return [*checks, Check("project", True, f"{project} (from {_PROJECT})")]


def _check_juliapkg() -> list[Check]:
    from juliapkg.deps import can_skip_resolve, load_meta

    if not can_skip_resolve():
        return [
            Check("Julia and its packages", False, "not resolved yet: harness julia setup (downloads Julia ≥ 1.10)")
        ]
    meta = load_meta()
    return [Check("Julia and its packages", True, f"Julia {meta['version']}, {meta['executable']}")]


@functools.cache
def is_set_up() -> bool:
    """Whether the ``julia`` engine can be used. Starts nothing and downloads nothing."""
    return all(check.ok for check in status())


def require_set_up() -> None:
    """Do nothing where Julia is set up.

    Raises:
        JuliaError: something is missing; the message says what.
    """
    if is_set_up():  # remembered: asking anew starts a Julia to learn its version
        return
    missing = next(check for check in status() if not check.ok)
    raise JuliaError(f"Julia is not set up for the harness ({missing.name}: {missing.text}); see `harness julia`")


def setup() -> None:
    """Resolve Julia and its packages (downloads), with their own progress on the terminal.

    Raises:
        JuliaError: it did not work; the message says why.
    """
    if os.environ.get(_EXE) or os.environ.get(_PROJECT):
        require_set_up()
        return
    import juliapkg

    try:
        juliapkg.resolve()
    except subprocess.CalledProcessError as error:
        raise JuliaError("Julia could not be set up: a Julia command failed, as it says above") from error
    except Exception as error:  # juliapkg raises bare exceptions of many kinds
        raise JuliaError(f"Julia could not be set up: {_first_line(error)}; see `harness julia`") from error
    is_set_up.cache_clear()


def run_tests() -> int:
    """Run the Julia package's own tests with the Julia that is set up; the exit status.

    Raises:
        JuliaError: Julia is not set up.
    """
    require_set_up()
    exe, project = os.environ.get(_EXE), os.environ.get(_PROJECT)
    if exe is None or project is None:
        import juliapkg

        script = ["-e", 'using Pkg; Pkg.test("PomdpHarness")']
        exe, project = juliapkg.executable(), juliapkg.project()
    else:
        script = [str(package_folder() / "test" / "runtests.jl")]
    return subprocess.run([exe, f"--project={project}", "--threads=auto", *script], check=False).returncode


def julia() -> Any:
    """The module ``PomdpHarness`` of a running Julia, which is started at the first call.

    Raises:
        JuliaError: Julia is not set up, or does not start.
    """
    return _started().PomdpHarness


@functools.cache
def _started() -> Any:
    """A Julia module that has imported PomdpHarness and PythonCall.

    Raises:
        JuliaError: Julia is not set up, or does not start.
    """
    require_set_up()
    if threading.current_thread() is not threading.main_thread():
        raise JuliaError("Julia must be started from the main thread")
    for name, value in _DEFAULTS.items():
        if os.environ.setdefault(name, value) != value and name.endswith("SIGNALS"):
            warnings.warn(f"{name} is set to '{os.environ[name]}': Julia threads need 'yes'", stacklevel=2)
    handler = signal.getsignal(signal.SIGINT)
    if sys.stderr.isatty():
        print("starting Julia …", end="\r", file=sys.stderr, flush=True)
    try:
        import juliacall

        jl = juliacall.newmodule("HarnessBridge")
        jl.seval("import PomdpHarness, PythonCall")
    except Exception as error:
        raise JuliaError(f"Julia did not start: {_first_line(error)}; see `harness julia`") from error
    _keep_ctrl_c(handler)
    return jl


def _keep_ctrl_c(handler: Any) -> None:
    """Give SIGINT back to Python's main thread.

    With its own signal handling Julia blocks SIGINT in every thread and waits for it in one of its own, so that
    Ctrl-C would not reach Python. Unblocked in the main thread, it is delivered there first.
    """
    if handler is None:  # Python did not set it: Julia is the host, and Ctrl-C its business
        return
    signal.signal(signal.SIGINT, handler)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def call(function: Callable[..., Any], *args: Any, **options: Any) -> Any:
    """Call a Julia function.

    Raises:
        JuliaError: with the first line of what Julia said.
    """
    import juliacall

    try:
        return function(*args, **options)
    except juliacall.JuliaError as error:
        text = _first_line(error)
        raise JuliaError(text.removeprefix("ArgumentError: ")) from error


def to_python(value: Any) -> Any:
    """A Julia dictionary, vector, string or number as plain Python, all the way down."""
    if isinstance(value, Mapping):
        return {str(key): to_python(item) for key, item in value.items()}
    if isinstance(value, (str, bool, int, float)) or value is None:
        return value
    if isinstance(value, np.generic):
        return value.item()
    return [to_python(item) for item in value]


def model(domain: Domain) -> Any:
    """The (harnessed) Julia model of a domain, with its reward shaping.

    Raises:
        JuliaError: Julia is not set up, or its package defines another version of the domain than the snapshot.
    """
    jl = julia()
    made = domain.live
    if made is None:
        instance = call(jl.instance, domain.name)
        if instance.version != domain.version:
            raise JuliaError(
                f"{domain.name}: the snapshot is version {domain.version}, the Julia package defines version "
                f"{instance.version}; export it again (harness export {domain.name})"
            )
        made = instance.make()
    return call(jl.shaped, made, domain.shaping) if domain.shaping != "none" else made


def instance_names() -> list[str]:
    """Names of the instances that the Julia package defines."""
    return [str(instance.name) for instance in julia().INSTANCES]


def export(name: str) -> Domain:
    """The named instance as its Julia definition has it now."""
    jl = julia()
    instance = call(jl.instance, name)
    sources = to_python(instance.sources)
    about = {
        "name": name,
        "version": instance.version,
        "title": str(instance.title),
        "provenance": {
            "exported": datetime.now(timezone.utc).date().isoformat(),
            "versions": to_python(jl.versions()),
            "history": to_python(instance.history),
            "sources": sources,
            "source_hash": str(jl.source_hash(instance.sources)),
        },
    }
    return _from_model(instance.make(), about, None)


def from_model(made: Any, name: str, title: str = "") -> Domain:
    """A domain from any finite POMDPs.jl model that lives in this process's Julia."""
    jl = julia()
    harnessed = call(jl.harnessed, made)
    about = {"name": name, "version": 0, "title": title, "provenance": {"versions": to_python(jl.versions())}}
    return _from_model(harnessed, about, harnessed)


def from_file(path: Path) -> Domain:
    """A domain from a Julia file whose last expression is a POMDPs.jl model.

    Raises:
        JuliaError: there is no such file, Julia is not set up, the file does not run, or does not end in a POMDP.
    """
    made = _value_of(path)
    if not julia().seval("x -> x isa POMDP")(made):
        raise JuliaError(f"{path}: the last expression of the file must be a POMDPs.jl model (a POMDP)")
    try:
        return from_model(made, path.stem, f"from {path.name}")
    except JuliaError as error:
        raise JuliaError(f"{path.name}: {error}") from error


def _value_of(path: Path) -> Any:
    """What the last expression of a Julia file gives."""
    if not os.path.isfile(path):
        raise JuliaError(f"{quoted(path)}: no such file")
    jl = julia()
    import juliacall  # only now: where no Julia is set up, importing it reaches for the network

    return call(jl.run_file, juliacall.newmodule("UserFile"), str(path.resolve()))


def _from_model(made: Any, about: Mapping[str, Any], live: Any) -> Domain:
    jl = julia()
    exported, described = call(jl.tables, made), to_python(call(jl.describe, made))
    arrays = {name: exported_array(getattr(exported, name)) for name in domains.types(described.get("sensors", ()))}
    return domains.from_export({**about, **described}, arrays, live)


def exported_array(value: Any) -> NDArray[Any]:
    """A Julia array as a NumPy array of its own."""
    return np.array(value)


def solve(
    domain: Domain, solver: str, options: Mapping[str, Any], progress: Callable[[float, float, float], bool]
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Solve a domain in Julia: what to record, and the alpha vectors (``visible``, ``actions`` 0-based, ``values``).

    ``solver`` is one of ours by name, or a Julia file that ends in one (see :func:`planned`).

    ``progress(seconds, lower, upper)`` is called now and then by a solver that reports its bounds; when it returns
    False, the solver stops and what it has so far is the result.

    Raises:
        JuliaError: the solver failed.
    """
    jl = julia()
    if Path(solver).suffix == ".jl":
        found = planned(domain, Path(solver))
        return _solution(found.model, *call(jl.solve_file, found.value))
    made = model(domain)
    options = dict(options)
    if solver == "mdp":
        bound = call(jl.mdp_bound, made, **options)
        record = {name: getattr(bound, name) for name in ("discounted", "undiscounted", "horizon", "tolerance")}
        return {"solver": "value iteration (DiscreteValueIteration.jl)", **record}, {}
    if solver == "sarsop":
        as_bool = _started().seval("f -> (numbers...) -> PythonCall.pyconvert(Bool, f(numbers...))")
        options["progress"] = as_bool(progress)
    function = {"qmdp": jl.solve_qmdp, "sarsop": jl.solve_sarsop, "native-sarsop": jl.solve_native_sarsop}[solver]
    return _solution(made, *call(function, made, **options))


def _solution(made: Any, alpha: Any, record: Any) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    arrays = {
        "visible": exported_array(alpha.visible).astype(np.int32) - 1,
        "actions": exported_array(alpha.actions).astype(np.int32) - 1,
        "values": exported_array(alpha.values).astype(np.float32),
    }
    return {**to_python(record), "initial_value": call(julia().initial_value, made, alpha)}, arrays


@dataclass(frozen=True)
class Planned:
    """A policy of a Julia file, solved for a domain."""

    value: Any
    """A Julia ``Planned`` (julia/src/players.jl)."""
    model: Any
    """The harnessed Julia model that it is for."""
    about: str
    """Packages with their versions, solver and settings."""
    quick: bool
    """Whether it decides without planning."""
    copy_size: int
    """Bytes that each episode's copy of it takes, about."""


def planned(domain: Domain, path: Path) -> Planned:
    """The policy, or the solver's policy for the domain, that the last expression of a Julia file gives.

    Raises:
        JuliaError: there is no such file, Julia is not set up, the file does not run, or does not end in one of these.
    """
    value = _value_of(path)
    jl = julia()
    made = call(jl.planned, value, model(domain), str(path.resolve()))
    return Planned(made, made.model, str(made.about), bool(jl.is_quick(made.policy)), int(jl.copy_size(made)))


def players(planned: Planned, buffers: Mapping[str, NDArray[Any]]) -> Callable[[], None]:
    """A function that writes into ``buffers["actions"]`` what the policy does next (see ``Players`` in julia/src)."""
    jl = julia()
    made = call(jl.Players, planned.value, _named_tuple(buffers))
    watch = _started().seval("f -> () -> (f(); nothing)")(_listen)
    return functools.partial(call, getattr(jl, "act!"), made, watch)


def _listen() -> None:
    """Nothing; while it runs, Python notices Ctrl-C."""


def _named_tuple(buffers: Mapping[str, NDArray[Any]]) -> Any:
    make = julia().seval("(names, arrays...) -> NamedTuple{Tuple(Symbol.(names))}(arrays)")
    return make(tuple(buffers), *buffers.values())


def simulator(domain: Domain, buffers: Mapping[str, NDArray[Any]]) -> tuple[Callable[[], None], Callable[[], None]]:
    """Functions that reset and step a batch of episodes in Julia, in place (see ``Simulator`` in julia/src)."""
    jl = julia()
    made = call(jl.Simulator, model(domain), _named_tuple(buffers))
    return functools.partial(call, getattr(jl, "reset!"), made), functools.partial(call, getattr(jl, "step!"), made)
