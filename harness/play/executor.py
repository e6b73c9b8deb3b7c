"""Many calls of one function, somewhere: in threads, in processes of this machine, or on a Dask cluster.

What plays much cuts its work into items (batches of episodes, points of a sweep, programs) and hands them to
:func:`each`. That puts items together into tasks of about :data:`TASK` seconds, keeps the workers busy, tries again
what was lost with a worker, and gives back the results as they come. As episodes are numbered, an item's result is the
same wherever and whenever it is played: no executor changes a number.

Of what all items share, domains and whatever else is large are sent to every worker once; a task carries the rest.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import os
import pickle
import platform
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import cloudpickle

from harness import host
from harness.errors import HarnessError, printable
from harness.model.domain import Domain
from harness.policy import own

TASK = 1.0
"""Seconds that a task is meant to take: long beside the milliseconds that it costs to send, short beside a wait."""

TRIES = 3
"""A task that has failed so often ends the work."""

PATIENCE = 300.0
"""Seconds without a single worker after which the work ends."""

_INLINE = 100_000  # bytes that every task carries itself; more is sent to a worker once
_TICK = 0.5  # seconds between looks at how many workers there are

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


class Workers(Protocol):
    """Where tasks run: what the kinds of :mod:`harness.play.cluster` have in common."""

    name: str
    """As messages call them."""
    here: bool
    """Whether they are on this machine, and see its files."""

    def slots(self) -> int:
        """How many tasks can run at a time, now."""

    def share(self, key: str, thing: object) -> Any:
        """What stands for a thing among the arguments of tasks; the thing itself goes to every worker once."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Begin a task."""

    def recover(self) -> None:
        """Make ready to go on after a task was lost with its worker, or with what it was given.

        Raises:
            HarnessError: there is nobody left to go on with.
        """


_CURRENT: ContextVar[Workers | None] = ContextVar("workers", default=None)
_IN_TASK: ContextVar[bool] = ContextVar("in_task", default=False)


def current() -> Workers | None:
    """The workers of the surrounding ``with harness.cluster(…)``; None where there is none, and inside a task."""
    return None if _IN_TASK.get() else _CURRENT.get()


def threads(given: int | None) -> int:
    """How many threads of this process may play: one inside a task, for the other cores have tasks of their own.

    Raises:
        HarnessError: ``given`` is no number of them.
    """
    count = host.workers(given)
    return 1 if _IN_TASK.get() else count


@contextlib.contextmanager
def using(workers: Workers) -> Iterator[None]:
    """Within, :func:`current` gives these workers."""
    before = _CURRENT.set(workers)
    try:
        yield
    finally:
        _CURRENT.reset(before)


@contextlib.contextmanager
def _in_task() -> Iterator[None]:
    before = _IN_TASK.set(True)
    try:
        yield
    finally:
        _IN_TASK.reset(before)


def ordered(
    workers: Workers | None,
    function: Callable[..., _Result],
    items: Sequence[_Item],
    *shared: object,
    name: Callable[[_Item], str],
    alike: bool = True,
) -> Iterator[_Result]:
    """Yield ``function(*shared, item)`` for every item in their order, each as soon as it and all before it are there.

    Arguments and errors are those of :func:`each`.
    """
    found: dict[int, _Result] = {}
    following = 0
    numbered = each(
        workers, _numbered, list(enumerate(items)), function, *shared, name=lambda pair: name(pair[1]), alike=alike
    )
    for (number, _), result in numbered:
        found[number] = result
        while following in found:
            yield found.pop(following)
            following += 1


def _numbered(function: Callable[..., _Result], *arguments: Any) -> _Result:
    *shared, (_, item) = arguments
    return function(*shared, item)


class _Task(NamedTuple):
    items: list[Any]
    failures: int = 0


def each(
    workers: Workers | None,
    function: Callable[..., _Result],
    items: Sequence[_Item] | deque[_Item],
    *shared: object,
    name: Callable[[_Item], str],
    alike: bool = True,
) -> Iterator[tuple[_Item, _Result]]:
    """Yield every item with ``function(*shared, item)``, in the order in which the results come.

    Args:
        workers: where; None: in this thread, one after another.
        function: of a module, so that workers find it by its name. Its arguments, its results and what it raises are
            pickled.
        items: small things. Of a deque they are taken away, and more may be added to it meanwhile.
        shared: the same for all items.
        name: what an item is called, in the message that says it failed.
        alike: whether items take about the same time, and so can be put together into tasks.

    Raises:
        HarnessError: the function raised it; or a task has failed :data:`TRIES` times; or there are no workers left.
            Tasks under way are cancelled then, as by Ctrl-C or when the iterator is closed.
    """
    waiting = items if isinstance(items, deque) else deque(items)
    if workers is None:
        while waiting:
            item = waiting.popleft()
            yield item, function(*shared, item)
        return
    call, pace, again = _Call(workers, function, shared), _Pace(alike), deque[_Task]()
    under_way: dict[Future[Any], _Task] = {}
    last_seen = time.monotonic()
    try:
        while waiting or again or under_way:
            slots = workers.slots()
            while (waiting or again) and len(under_way) < 2 * max(1, slots):
                task = again.popleft() if again else _Task(pace.take(waiting, slots))
                under_way[call.begin(task.items)] = task
            done = wait(under_way, timeout=_TICK, return_when=FIRST_COMPLETED)[0]
            last_seen = _seen(workers, bool(done or slots), last_seen)
            for future in done:
                task = under_way.pop(future)
                try:
                    seconds, results = future.result()
                except HarnessError:
                    raise
                except Exception as error:  # whatever it is: of a user's policy, of the machine, of the network
                    again.append(_again(task, error, name))
                    _recover(workers, call, error)
                else:
                    pace.see(seconds, len(results))
                    yield from zip(task.items, results, strict=True)
    finally:
        for future in under_way:
            future.cancel()


def _seen(workers: Workers, there: bool, last: float) -> float:
    """When there was last a worker."""
    now = time.monotonic()
    if not there and now - last > PATIENCE:
        raise HarnessError(f"{workers.name} has had no worker for {PATIENCE:.0f} seconds; start some and go on")
    return now if there else last


def _again(task: _Task, error: Exception, name: Callable[[Any], str]) -> _Task:
    """The task, to be tried once more."""
    if task.failures + 1 < TRIES:
        return task._replace(failures=task.failures + 1)
    words = name(task.items[0]) + (f" and {len(task.items) - 1} more" if len(task.items) > 1 else "")
    lost = isinstance(error, (CancelledError, BrokenExecutor)) or type(error).__name__ == "KilledWorker"
    why = "its worker was gone, perhaps for want of memory" if lost else f"{type(error).__name__}: {error}"
    raise HarnessError(f"{words} failed {TRIES} times, the last time because {printable(why)}") from error


def _recover(workers: Workers, call: _Call, error: Exception) -> None:
    if isinstance(error, (CancelledError, BrokenExecutor)):
        workers.recover()
        call.share()


class _Pace:
    """How many items make a task."""

    def __init__(self, alike: bool) -> None:
        self._alike, self._seconds, self._items = alike, 0.0, 0

    def see(self, seconds: float, items: int) -> None:
        self._seconds += seconds
        self._items += items

    def take(self, waiting: deque[_Item], slots: int) -> list[_Item]:
        """The first items: one while nobody knows how long it takes, later :data:`TASK` seconds' worth; but so few
        towards the end that all workers have some."""
        count = 1
        if self._alike and self._items:
            worth = int(TASK * self._items / max(self._seconds, 1e-9))
            count = max(1, min(worth, len(waiting) // (2 * max(1, slots))))
        return [waiting.popleft() for _ in range(count)]


class _Call:
    """A function and what all its items share, packed once."""

    def __init__(self, workers: Workers, function: Callable[..., Any], shared: tuple[object, ...]) -> None:
        self._workers, self._function = workers, function
        self._packed, self._domains = pack(shared)
        self.share()

    def share(self) -> None:
        """See to it that the workers have what is large."""
        self._handles = {key: self._workers.share(key, domain) for key, domain in self._domains.items()}
        self._small: Any = self._packed
        if len(self._packed) > _INLINE:
            self._small = self._workers.share(f"harness-{hashlib.sha256(self._packed).hexdigest()}", self._packed)

    def begin(self, items: list[Any]) -> Future[Any]:
        """A task of these items."""
        try:
            return self._workers.submit(work, fingerprint(), self._function, self._small, self._handles, items)
        except BrokenExecutor as error:  # found out only now
            failed: Future[Any] = Future()
            failed.set_exception(error)
            return failed


def work(
    wanted: str, function: Callable[..., Any], packed: Any, handles: dict[str, Any], items: list[Any]
) -> tuple[float, list[Any]]:
    """A task, on a worker: the seconds that it took, and the results.

    Raises:
        HarnessError: the worker has other versions than ``wanted``.
    """
    if wanted != (found := fingerprint()):
        raise HarnessError(
            f"the worker on {platform.node()} (process {os.getpid()}) has {found}, and here is {wanted}; install the "
            "same on both"
        )
    with _in_task():
        shared = unpack(opened(packed), {key: opened(handle) for key, handle in handles.items()})
        began = time.perf_counter()
        results = [function(*shared, item) for item in items]
    return time.perf_counter() - began, results


@functools.cache
def fingerprint() -> str:
    """All that decides numbers, in words: versions, and a hash of this package's sources."""
    package = Path(__file__).resolve().parent.parent
    total = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        total.update(f"{path.relative_to(package).as_posix()}\n".encode() + path.read_bytes())
    of = host.versions("numpy", "numba")
    return f"pomdp-harness {of['pomdp-harness']} ({total.hexdigest()[:8]}), NumPy {of['numpy']}, Numba {of['numba']}"


class Stored(NamedTuple):
    """A file of a thing that processes of one machine share."""

    path: str


def opened(handle: Any) -> Any:
    """The thing that a handle stands for, on the worker; Dask has put most of them in their place itself."""
    return _read(handle.path) if isinstance(handle, Stored) else handle


@functools.lru_cache(maxsize=8)
def _read(path: str) -> Any:
    return pickle.loads(Path(path).read_bytes())


def pack(shared: tuple[object, ...]) -> tuple[bytes, dict[str, Domain]]:
    """The shared arguments without the domains that they hold, and these by their keys.

    Raises:
        HarnessError: something cannot be pickled.
    """
    file = io.BytesIO()
    packer = _Packer(file)
    try:
        with _own_code_by_value():
            packer.dump(shared)
    except Exception as error:
        what = ", ".join(type(each).__name__ for each in shared if not isinstance(each, (Domain, str, int)))
        raise HarnessError(
            f"{what} cannot be sent to workers ({type(error).__name__}: {error}); play it without a cluster"
        ) from error
    return file.getvalue(), packer.domains


def unpack(packed: bytes, domains: dict[str, Domain]) -> Any:
    """Inverse of :func:`pack`."""
    return _Unpacker(io.BytesIO(packed), domains).load()


class _Packer(cloudpickle.Pickler):
    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self.domains: dict[str, Domain] = {}

    def persistent_id(self, thing: object) -> str | None:
        if not isinstance(thing, Domain):
            return None
        identity = thing.name, thing.version, thing.shaping, thing.model_hash
        key = f"harness-{hashlib.sha256(repr(identity).encode()).hexdigest()}"
        self.domains.setdefault(key, thing)
        return key


class _Unpacker(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, domains: dict[str, Domain]) -> None:
        super().__init__(file)
        self._domains = domains

    def persistent_load(self, key: str) -> Domain:
        return self._domains[key]


@contextlib.contextmanager
def _own_code_by_value() -> Iterator[None]:
    """Send the classes of a user's ``own.py`` whole: workers have no module of that name."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(own.PREFIX)]
    for module in modules:
        cloudpickle.register_pickle_by_value(module)
    try:
        yield
    finally:
        for module in modules:
            cloudpickle.unregister_pickle_by_value(module)
