"""Policies of the user's own, named by where they are: ``own.py:Name``, ``package.module:Name``, or an entry point.

Such a name makes Python code run. Only what the user wrote may lead here; names that stand in data go through
:func:`harness.policy.make_from_data`.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import sys
import traceback
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from harness.errors import PolicyError, nearest, quoted
from harness.model.domain import Domain
from harness.policy.base import Policy

GROUP = "pomdp_harness.policies"
"""Entry points of installed packages that bring policies; each stands for what ``module:Name`` may stand for."""

PREFIX = "harness_own_"
"""Of the names of modules that are files."""

POLICY = "policy: an object with reset(batch) and act(batch)"


def installed() -> dict[str, EntryPoint]:
    """Policies that installed packages bring, by name."""
    return _installed(tuple(sys.path))


@functools.lru_cache(maxsize=1)
def _installed(_: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Looked for once, as long as packages are looked for in the same places: that reads a file of each."""
    return {point.name: point for point in entry_points(group=GROUP)}


def is_path(spec: str) -> bool:
    """Whether a policy string is of the form ``own.py:Name`` or ``package.module:Name``."""
    where, _, name = spec.rpartition(":")
    return name.isidentifier() and (where.endswith(".py") or all(part.isidentifier() for part in where.split(".")))


def is_there(spec: str) -> bool:
    """Whether the module of a path is to be found; runs nothing. A file has a message of its own."""
    where = spec.rpartition(":")[0]
    _look_in(Path.cwd())
    return where.endswith(".py") or importlib.util.find_spec(where.split(".")[0]) is not None


def load(spec: str, domain: Domain, kind: Any = Policy, what: str = POLICY) -> Any:
    """The policy that a path stands for; the module that it names is run.

    The name may stand for a class, which is given the domain where it has a parameter ``domain``; for a function from
    the domain to a policy; or for a policy. ``kind`` is the protocol that is needed, ``what`` the words for it.

    Raises:
        PolicyError: there is no such module or name, its code fails, or it makes no policy.
    """
    where, _, name = spec.rpartition(":")
    try:
        module = _file(Path(where)) if where.endswith(".py") else importlib.import_module(where)
    except PolicyError:
        raise
    except (Exception, SystemExit) as error:
        raise PolicyError(f"{quoted(spec)}: {_told(error)}") from error
    if not hasattr(module, name):
        raise PolicyError(f"{quoted(where)} has no {quoted(name)}{nearest(name, vars(module))}")
    return _made(getattr(module, name), domain, spec, kind, what)


def load_installed(point: EntryPoint, domain: Domain) -> Policy:
    """The policy of an installed package.

    Raises:
        PolicyError: its code fails, or it makes no policy.
    """
    try:
        found = point.load()
    except Exception as error:
        raise PolicyError(f"{quoted(point.name)} ({quoted(point.value)}): {_told(error)}") from error
    return _made(found, domain, point.name, Policy, POLICY)


def _file(path: Path) -> ModuleType:
    if not path.is_file():
        raise PolicyError(f"{quoted(path)}: no such file")
    name = f"{PREFIX}{path.stem}"
    found = importlib.util.spec_from_file_location(name, path)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[name] = module  # as dataclasses and pickle need it
    _look_in(path.resolve().parent)
    found.loader.exec_module(module)
    return module


def _look_in(folder: Path) -> None:
    """Let modules beside the user's own be imported; last, so that they stand in nobody's way."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))


def _made(found: Any, domain: Domain, spec: str, kind: Any, what: str) -> Any:
    try:
        made = found if _is(found, kind) else _call(found, domain)
    except Exception as error:
        raise PolicyError(f"{quoted(spec)}: {_told(error)}") from error
    if not _is(made, kind):
        raise PolicyError(f"{quoted(spec)} makes no {what} is needed")
    return made


def _is(found: Any, kind: Any) -> bool:
    return isinstance(found, kind) and not isinstance(found, type)


def _call(found: Any, domain: Domain) -> Any:
    if isinstance(found, type):
        return found(domain=domain) if "domain" in inspect.signature(found).parameters else found()
    return found(domain) if callable(found) else found


def _told(error: BaseException) -> str:
    """What went wrong in the user's code, and in which line of it."""
    between = (__file__, importlib.__file__)
    tail = traceback.extract_tb(error.__traceback__)
    frames = [f for f in tail if f.filename not in between and not f.filename.startswith("<")]
    line = f" in line {frames[-1].lineno} of {quoted(Path(frames[-1].filename))}" if frames else ""
    return f"{type(error).__name__}{line}: {error}"
