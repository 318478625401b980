"""Executors: processes of this machine, or a Dask cluster.

Only a few items for each worker are queued, so that memory does not grow with the number of items.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from importlib.metadata import version
from math import inf
from multiprocessing import active_children
from time import monotonic
from typing import Any, Protocol, Self, TypeVar

from .pool import Pool
from .start import end_with_parent, ignoring_interrupts, preloaded, sigterm_deferred

Item = TypeVar("Item")
Result = TypeVar("Result")

_AHEAD = 2
"""Items in flight for each worker: one at work, one waiting."""
_ITEMS_A_POOL = 200
"""Items after which a worker is replaced by a fresh one, which frees the memory that libraries
leak."""
_LOOK_AFTER_S = 2.0
_CONNECT_S = 4.0
_NO_WORKER_S = 60.0


class Workers(Protocol):
    """Workers that take items."""

    @property
    def ahead(self) -> int:
        """Number of items that may be in flight."""

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """Hand over one item."""

    def check(self) -> None:
        """Raise InputError if no worker is left for the items in flight."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None: ...


def workers_of(workers: int, scheduler: str | None) -> Workers:
    """Return processes of this machine, or the cluster at a scheduler's address.

    Raises InputError if Dask is not installed, no scheduler answers, or it has no workers.
    """
    return Processes(workers) if scheduler is None else Cluster(scheduler)


def as_finished(
    crew: Workers, function: Callable[[Item], Result], items: Iterable[Item]
) -> Iterator[tuple[Item, Future[Result]]]:
    """Yield each item with its finished future, in the order in which they finish.

    A worker process that dies does not report its item.  All items that were in flight are then
    done again one at a time, and only an item whose worker dies while it is alone fails, with
    `BrokenProcessPool`.

    `function`: picklable: a module's function, or a `functools.partial` of one.  `items`: taken
    only as there is room.
    """
    source = iter(items)
    again: deque[Item] = deque()
    running: dict[Future[Result], Item] = {}
    alone: Future[Result] | None = None
    while True:
        careful = bool(again)
        while len(running) < (1 if careful else crew.ahead):
            try:
                item = again.popleft() if careful else next(source)
            except StopIteration:
                break
            future = crew.submit(function, item)
            running[future] = item
            alone = future if careful else None
        if not running:
            return
        done, _ = wait(running, _LOOK_AFTER_S, FIRST_COMPLETED)
        if not done:
            crew.check()
        for future in done:
            item = running.pop(future)
            if future is not alone and _worker_died(future):
                again.append(item)
            else:
                yield item, future


def _worker_died(future: Future[Result]) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenProcessPool)


class Processes:
    """Worker processes on this machine.

    Ctrl-C reaches only the parent, which then ends its workers: they print nothing and leave
    nothing behind.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool = self._open()
        self._given = 0

    @property
    def ahead(self) -> int:
        """Number of items that may be in flight."""
        return _AHEAD * self._workers

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """Hand over one item; to fresh processes, if the old ones have died or done enough."""
        if self._given == _ITEMS_A_POOL * self._workers:
            self._renew()
        try:
            return self._submit(function, item)
        except BrokenProcessPool:
            self._renew()
            return self._submit(function, item)

    def check(self) -> None:
        """Do nothing: a process that dies sets an exception in its future."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the workers: after their work, or at once if something went wrong."""
        if kind is not None:
            # Otherwise the pool would first finish what it has begun.
            for worker in active_children():
                worker.terminate()
        self._pool.shutdown(cancel_futures=True)

    def _open(self) -> Pool:
        return Pool(self._workers, preloaded(("identify",)), end_with_parent)

    def _renew(self) -> None:
        self._pool.shutdown(wait=False)  # it finishes the items that it has begun
        self._pool = self._open()
        self._given = 0

    def _submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        self._given += 1
        with sigterm_deferred(), ignoring_interrupts():  # a worker may start here
            return self._pool.submit(function, item)


class Cluster:
    """The workers of a Dask scheduler, however many there are at the moment.

    The scheduler gives the items of a lost worker to another one.

    `address`: such as ``tcp://host:8786``.  Raises InputError if Dask is not installed, no
    scheduler answers there, or it has no workers.
    """

    def __init__(self, address: str) -> None:
        import asyncio
        import logging

        from dbc import InputError

        try:
            import distributed
        except ImportError:
            raise InputError(
                "--scheduler", "needs Dask, which is not installed", "install bumpbench[cluster]"
            ) from None
        # Dask logs lost connections with tracebacks; everything that matters arrives as an
        # exception.
        for name in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        self._address = address
        try:
            asyncio.run(asyncio.wait_for(_greet(address), _CONNECT_S + 1.0))
        except Exception as error:  # whatever listens there may answer anything, or nothing
            known = isinstance(error, (OSError, ValueError)) and str(error)
            raise InputError(
                f"--scheduler {address}",
                f"no Dask scheduler answers: {known or 'something else listens there'}",
                "start one with: dask scheduler",
            ) from None
        connect: Any = distributed.Client  # typed in part only
        self._client = connect(address, timeout=_CONNECT_S, set_as_default=False)
        try:
            self._client.wait_for_workers(1, timeout=_CONNECT_S)
        except TimeoutError:
            self._client.close(timeout=0.5)
            raise InputError(
                address, "the scheduler has no workers", f"start some with: dask worker {address}"
            ) from None
        self._same_version()
        self._executor = self._client.get_executor(pure=False)
        self._threads = 1
        self._asked_s = self._seen_s = -inf
        self.check()

    def _same_version(self) -> None:
        """Raise InputError if a worker has another version, whose rows would not be comparable."""
        from dbc import InputError

        own = version("bumpbench")
        # A function of the standard library: a worker without Bumpbench could not find ours.
        found = self._client.run(version, "bumpbench", on_error="return")
        for worker, other in found.items():
            if other != own:
                self._client.close(timeout=0.5)
                what = f"worker {worker} has no bumpbench"
                if isinstance(other, str):
                    what = f"worker {worker} has bumpbench {other}, here is {own}"
                raise InputError(self._address, what, "install one version everywhere")

    @property
    def ahead(self) -> int:
        """Number of items that may be in flight; it follows the number of workers."""
        if monotonic() - self._asked_s > _LOOK_AFTER_S:
            self.check()
        return _AHEAD * max(1, self._threads)

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """Hand over one item."""
        future: Future[Result] = self._executor.submit(function, item)
        return future

    def check(self) -> None:
        """Raise InputError if the scheduler has gone, or all workers have for a minute."""
        from dbc import InputError

        self._asked_s = monotonic()
        try:
            workers = self._client.scheduler_info()["workers"].values()
        except (OSError, TimeoutError, RuntimeError):
            raise InputError(
                self._address, "the scheduler has gone", "start it, and run this again"
            ) from None
        self._threads = sum(int(worker["nthreads"]) for worker in workers)
        if self._threads:
            self._seen_s = self._asked_s
        elif self._asked_s - self._seen_s > _NO_WORKER_S:
            raise InputError(
                self._address, "all its workers have gone", "start some, and run this again"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the cluster; what is in flight is cancelled."""
        with suppress(OSError, TimeoutError):  # the scheduler may be what went wrong
            self._executor.shutdown(wait=False)
            self._client.close(timeout=0.5)


async def _greet(address: str) -> None:
    """Exchange only Dask's greeting: a client that fails in this gives up slowly."""
    from distributed.comm.core import connect

    greet: Any = connect
    comm = await greet(address, timeout=_CONNECT_S)
    await comm.close()
