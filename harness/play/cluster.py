"""``harness.cluster``: the workers that everything within plays on.

Three kinds behind one contract (:class:`harness.play.executor.Workers`), each a ``concurrent.futures`` executor:
threads, processes of this machine (loky's), and a Dask cluster: one that is there, one started here, or jobs of a
batch system.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness import files, host
from harness.errors import HarnessError, nearest, quoted
from harness.play.executor import Stored, Workers, current, fingerprint, using

if TYPE_CHECKING:
    from distributed import Client

FORMS = "tcp://HOST:PORT, local:N, processes:N, threads:N, slurm:FILE.toml or pbs:FILE.toml"
CONNECT = 10.0
"""Seconds to wait for a scheduler."""

_ANY_PORT = {"dashboard_address": ":0"}  # the usual one may be taken by a neighbour's cluster
_SHARED = 8  # domains and large policies that workers keep at a time


@contextlib.contextmanager
def cluster(where: str | Client) -> Iterator[None]:
    """Play on a cluster whatever is played within: the numbers stay the same, bit for bit.

    Args:
        where: a ``dask.distributed.Client``, or a text: ``tcp://HOST:PORT`` (a Dask scheduler), ``local:N`` (one
            started here with N worker processes), ``slurm:FILE.toml`` and ``pbs:FILE.toml`` (one here, its workers
            jobs of a batch system), ``processes:N`` and ``threads:N`` (of this machine, without Dask).

    What plays in Julia, and policies that cannot be copied, play on this machine all the same.

    Raises:
        HarnessError: the text is none of these, nobody answers there, Dask is not installed, or a worker has other
            versions of the package, of NumPy or of Numba.
    """
    with _workers(where) as workers, using(workers):
        yield


@contextlib.contextmanager
def workers_for(count: int, *, away: bool = True) -> Iterator[Workers | None]:
    """Those of the surrounding :func:`cluster`, unless the work cannot go ``away``; else ``count`` processes of this
    machine, or for a single one None, which is this process itself."""
    if away and (found := current()) is not None:
        yield found
    elif count == 1:
        yield None
    else:
        with processes(count) as made:
            yield made


def _workers(where: str | Client) -> contextlib.AbstractContextManager[Workers]:
    if not isinstance(where, str):
        return _of_client(where)
    kind, _, rest = where.partition(":")
    if kind == "tcp":
        return _at(where)
    if kind in _COUNTED and rest.isdecimal() and 1 <= int(rest) <= host.MOST_WORKERS:
        return _COUNTED[kind](int(rest))
    if kind in _BATCH_SYSTEMS and rest:
        return _jobs(kind, Path(rest))
    raise HarnessError(f"no cluster {quoted(where)}{nearest(kind, (*_COUNTED, *_BATCH_SYSTEMS))} (known: {FORMS})")


class _Threads:
    name, here = "threads", True

    def __init__(self, count: int, executor: Executor) -> None:
        self._count, self._executor = count, executor

    def slots(self) -> int:
        return self._count

    def share(self, key: str, thing: object) -> object:
        return thing

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        return self._executor.submit(function, *arguments)

    def recover(self) -> None:
        """Threads are not lost."""


@contextlib.contextmanager
def threads(count: int) -> Iterator[Workers]:
    """Threads of this process."""
    executor = ThreadPoolExecutor(count)
    try:
        yield _Threads(count, executor)
    finally:
        executor.shutdown(cancel_futures=True)


class _Processes:
    name, here = "processes", True

    def __init__(self, count: int, folder: Path) -> None:
        self._count, self._folder = count, folder
        self._executor = self._new()

    def _new(self) -> Any:
        from loky import ProcessPoolExecutor

        return ProcessPoolExecutor(self._count, initializer=host.end_with, initargs=(os.getpid(),))

    def slots(self) -> int:
        return self._count

    def share(self, key: str, thing: object) -> Stored:
        path = self._folder / key
        if not path.exists():
            path.write_bytes(pickle.dumps(thing, protocol=5))
        return Stored(str(path))

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = self._executor.submit(function, *arguments)
        return future

    def recover(self) -> None:
        """A pool breaks with one of its processes."""
        if self._executor._flags.broken is not None:
            self._executor = self._new()

    def close(self, *, at_once: bool) -> None:
        self._executor.shutdown(kill_workers=at_once)


@contextlib.contextmanager
def processes(count: int) -> Iterator[Workers]:
    """Processes of this machine."""
    with tempfile.TemporaryDirectory(prefix="harness-") as folder:
        workers = _Processes(count, Path(folder))
        try:
            yield workers
        except BaseException:
            workers.close(at_once=True)
            raise
        workers.close(at_once=False)


class _Dask:
    here = False

    def __init__(self, client: Client) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        self.name = str(client.scheduler.address if client.scheduler else "the cluster")
        self._shared: dict[str, Any] = {}
        self._slots, self._looked = 0, -float("inf")

    def slots(self) -> int:
        """Looked up once a second: a worker may join late."""
        if time.monotonic() - self._looked > 1:
            self._wait_for_scheduler()
            with _told(self.name):
                self._slots = sum(self._client.nthreads().values())
            self._looked = time.monotonic()
        return self._slots

    def share(self, key: str, thing: object) -> Any:
        if key not in self._shared:
            with _told(self.name):
                self._shared[key] = self._client.scatter({key: thing}, broadcast=True)[key]
            for old in list(self._shared)[:-_SHARED]:
                del self._shared[old]
        return self._shared[key]

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        return self._executor.submit(function, *arguments)

    def recover(self) -> None:
        """What was scattered may be gone with the worker that had it, or with the scheduler."""
        self._wait_for_scheduler()
        self._shared.clear()
        self._looked = -float("inf")

    def _wait_for_scheduler(self) -> None:
        """The client connects again by itself, if somebody is there."""
        until = time.monotonic() + CONNECT
        while self._client.status != "running" and time.monotonic() < until:
            time.sleep(0.1)
        if self._client.status != "running":
            raise HarnessError(f"the scheduler {self.name} is gone; start one again and go on")


@contextlib.contextmanager
def _of_client(client: Client) -> Iterator[Workers]:
    workers = _Dask(client)
    _check_versions(client, workers.name)
    yield workers


def _check_versions(client: Client, name: str) -> None:
    """Refuse workers of other versions at once; who joins later is refused by its first task."""
    _wait_for_workers(client, name)
    wanted = fingerprint()
    try:
        found = client.run(fingerprint, on_error="return")
    except Exception as error:
        raise HarnessError(f"{name}: its workers cannot be asked for their versions: {error}") from error
    for worker, answer in found.items():
        if isinstance(answer, BaseException):
            raise HarnessError(
                f"the worker {worker} has no pomdp-harness of this version ({type(answer).__name__}: {answer}); "
                f"install there {wanted}"
            )
        if answer != wanted:
            raise HarnessError(f"the worker {worker} has {answer}, and here is {wanted}; install the same on both")


def _wait_for_workers(client: Client, name: str) -> None:
    """However long that takes, as jobs may be queued; said once, since nothing else is seen to happen."""
    if client.nthreads():
        return
    warnings.warn(f"{name}: waiting for the first worker (Ctrl-C ends that)", stacklevel=2)
    while not client.nthreads():
        time.sleep(0.5)


@contextlib.contextmanager
def _at(address: str) -> Iterator[Workers]:
    """The scheduler at an address."""
    with _told(address), _connected(address) as client, _of_client(client) as workers:
        yield workers


@contextlib.contextmanager
def _local(count: int) -> Iterator[Workers]:
    """A scheduler here, with so many worker processes."""
    import logging

    options = {"threads_per_worker": 1, "silence_logs": logging.CRITICAL, **_ANY_PORT}
    with (
        _needed("distributed").LocalCluster(n_workers=count, **options) as made,
        _connected(made) as client,
        _of_client(client) as workers,
    ):
        yield workers


@contextlib.contextmanager
def _jobs(kind: str, path: Path) -> Iterator[Workers]:
    """A scheduler here, its workers jobs of a batch system."""
    count, options = job_options(path)
    made = getattr(_needed("dask_jobqueue"), _BATCH_SYSTEMS[kind])(**options, scheduler_options=_ANY_PORT)
    with made, _connected(made) as client:
        made.scale(jobs=count)
        with _of_client(client) as workers:
            yield workers


@contextlib.contextmanager
def _connected(to: Any) -> Iterator[Client]:
    distributed = _needed("distributed")
    try:
        client = distributed.Client(to, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise HarnessError(f"no Dask scheduler answers at {quoted(str(to))}: {error}") from None
    with client:
        yield client


@contextlib.contextmanager
def _told(name: str) -> Iterator[None]:
    """What Dask says of a connection that is gone, as a sentence."""
    try:
        yield
    except HarnessError:
        raise
    except (OSError, TimeoutError) as error:
        raise HarnessError(f"the scheduler {name} does not answer any more: {error}") from error


def _needed(module: str) -> Any:
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError:
        raise HarnessError(f"this needs {module}: pip install 'pomdp-harness[cluster]'") from None


_COUNTED: dict[str, Callable[[int], contextlib.AbstractContextManager[Workers]]] = {
    "local": _local,
    "processes": processes,
    "threads": threads,
}
_BATCH_SYSTEMS = {"slurm": "SLURMCluster", "pbs": "PBSCluster"}

_KEYS: dict[str, tuple[type, str]] = {  # in the file: its type, and what dask-jobqueue calls it
    "jobs": (int, ""),
    "cores": (int, "cores"),
    "memory": (str, "memory"),
    "walltime": (str, "walltime"),
    "queue": (str, "queue"),
    "account": (str, "account"),
    "interface": (str, "interface"),
    "python": (str, "python"),
    "directives": (list, "job_extra_directives"),
    "prologue": (list, "job_script_prologue"),
}
_NEEDED = ("jobs", "cores", "memory")


def job_options(path: Path) -> tuple[int, dict[str, Any]]:
    """How many jobs a file asks for, and the arguments of dask-jobqueue's cluster: one process a core.

    Raises:
        HarnessError: the file cannot be read, or a key is missing, unknown or of the wrong type.
    """
    table = _table(path)
    for key in _NEEDED:
        if key not in table:
            raise HarnessError(f"{path}: '{key}' is missing (needed: {', '.join(_NEEDED)})")
    for key, value in table.items():
        if key not in _KEYS:
            raise HarnessError(f"{path}: no key {quoted(key)}{nearest(key, _KEYS)} (known: {', '.join(_KEYS)})")
        if not _fits(value, _KEYS[key][0]):
            raise HarnessError(f"{path}: '{key}' must be {_WORDS[_KEYS[key][0]]}, not {quoted(value)}")
    options = {_KEYS[key][1]: value for key, value in table.items() if key != "jobs"}
    return table["jobs"], {**options, "processes": table["cores"]}


_WORDS = {int: "a whole number, 1 or more", str: "a text", list: "a list of texts"}


def _table(path: Path) -> Mapping[str, Any]:
    text = files.read_source(files.named(path))
    try:
        return files.toml(text)
    except ValueError as error:
        raise HarnessError(f"{path}: {error}") from None


def _fits(value: object, kind: type) -> bool:
    if kind is list:
        return isinstance(value, list) and all(isinstance(each, str) for each in value)
    return isinstance(value, kind) and not isinstance(value, bool) and (kind is not int or value >= 1)  # type: ignore[operator]
