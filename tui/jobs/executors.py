"""Applies a function to many items, in processes of this machine or on a Dask cluster.

Processes share loaded libraries, ignore Ctrl-C and end with their parent.
"""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from importlib.metadata import version
from itertools import islice
from multiprocessing import active_children, get_all_start_methods, get_context, parent_process
from multiprocessing.connection import wait as wait_for
from multiprocessing.context import BaseContext
from multiprocessing.util import get_temp_dir
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from ..output import Stage

Item = TypeVar("Item")
Result = TypeVar("Result")

_CONNECT_S = 4.0
_LONGEST_FOLDER = 70
"""Longest path of a folder, bytes, in which multiprocessing can have its sockets: it adds 32 bytes,
and macOS takes 103, Linux 107."""
_HELPERS = 2
"""Number of helpers: one works while the parent works, both while the parent waits."""
_LOOK_AFTER_S = 60.0
"""Time without a result after which the cluster is asked whether it still has workers, s."""


def as_finished(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    scheduler: str | None = None,
) -> Generator[tuple[Item, Future[Result]], None, None]:
    """Yield each item with its finished future, in the order in which they finish.

    A worker process that dies takes all items in flight with it: these are done again one at a
    time, and only an item whose process dies while it is alone fails, with `BrokenProcessPool`.

    `function`: picklable: a function of a module, or a `functools.partial` of one.  `items`: taken
    only as there is room.  `scheduler`: address of a Dask scheduler, whose workers then do the
    work.  Raises InputError if Dask is not installed, no scheduler answers, or it has no workers.
    """
    source = iter(items)
    lost: list[Item] = []
    crew = _workers(workers) if scheduler is None else _cluster(scheduler)
    with crew as (executor, ahead, check):
        running: dict[Future[Result], Item] = {}
        while not lost:
            for item in islice(source, ahead - len(running)):
                try:
                    running[executor.submit(function, item)] = item
                except BrokenProcessPool:
                    lost.append(item)
                    break
            if not running:
                break
            done, _ = wait(running, _LOOK_AFTER_S, FIRST_COMPLETED)
            if not done:
                check()
            for future in done:
                if not future.cancelled() and _process_died(future):
                    lost.append(running.pop(future))
                else:
                    yield running.pop(future), future
        lost += running.values()
    for item in lost:
        with processes(1) as executor:
            future = executor.submit(function, item)
            wait([future])
            yield item, future
    if lost:
        yield from as_finished(function, source, workers)


def map_items(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    stage: Stage,
    subject: str,
    scheduler: str | None = None,
) -> list[Result]:
    """Return ``function(item)`` of every item, in their order, and report progress to `stage`.

    The first error ends the work.  `subject`: name of the work in the error if a worker dies, which
    is raised as InputError.  Other arguments and errors: as of `as_finished`.
    """
    from dbc import InputError  # this loads NumPy, which --help does not need

    results: dict[Item, Result] = {}
    for item, future in as_finished(function, items, workers, scheduler):
        try:
            results[item] = future.result()
        except BrokenProcessPool:
            raise InputError(
                subject, "a worker process died", "close other programs; it needs memory"
            ) from None
        stage(len(results) / len(items), f"{len(results)} of {len(items)}")
    return [results[item] for item in items]


def _process_died(future: Future[Any]) -> bool:
    return isinstance(future.exception(), BrokenProcessPool)


@contextmanager
def processes(workers: int, modules: Sequence[str] = ("identify",)) -> Iterator[Executor]:
    """Yield processes of this machine that share loaded modules; after an error they end at once.

    Ctrl-C reaches only the parent, which then ends them; they end, too, when it is killed.  Raises
    InputError if no process can be started.
    """
    from dbc import InputError

    pool = ProcessPoolExecutor(workers, _preloaded(modules), _prepare_process)
    try:
        yield pool
    except BaseException as error:
        for process in active_children():
            process.terminate()
        if isinstance(error, OSError):
            what = f"no process can be started ({error})"
            raise InputError("processes", what, "end other programs, and try again") from error
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _prepare_process() -> None:
    """Leave Ctrl-C to the parent, end with it, and search what is loaded for garbage no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent()
    gc.freeze()


def _preloaded(modules: Sequence[str]) -> BaseContext:
    """Return a context that starts processes with these modules, which are loaded once for all."""
    if "forkserver" not in get_all_start_methods():  # Windows: each process loads its own
        return get_context("spawn")
    _place_sockets()
    context = get_context("forkserver")
    context.set_forkserver_preload(list(modules))
    return context


def _place_sockets() -> None:
    """Place the sockets of processes in /tmp if that of temporary files has too long a path."""
    if len(os.fsencode(tempfile.gettempdir())) <= _LONGEST_FOLDER:
        return
    before, tempfile.tempdir = tempfile.tempdir, "/tmp"
    try:
        with suppress(OSError):  # the start of a process reports it
            get_temp_dir()  # made once, and kept for this process
    finally:
        tempfile.tempdir = before


def _end_with_parent() -> None:
    """Make a worker end when its parent is killed; otherwise it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None  # a worker has a parent

    def watch() -> None:
        wait_for([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def helpers(modules: Sequence[str]) -> Iterator[Executor]:
    """Yield processes that share the work of one identification or report.

    Their libraries take a second to load: start them when the parent has begun a fit, which keeps
    one processor busy.

    Raises InputError if no process can be started, or one dies.
    """
    from dbc import InputError

    with processes(_HELPERS, modules) as pool:

        def start() -> None:
            with suppress(OSError):  # a use raises it again
                for _ in range(_HELPERS):
                    pool.submit(int)

        starting = Thread(target=start)  # it waits for the libraries
        starting.start()
        try:
            yield pool
        except BrokenProcessPool:
            what, advice = "a helper process died", "close other programs: it needs memory"
            raise InputError("helpers", what, advice) from None
        finally:
            starting.join()


_Crew = tuple[Executor, int, Callable[[], None]]
"""An executor, the number of items that may be in flight, and a check that it still works."""


@contextmanager
def _workers(workers: int) -> Iterator[_Crew]:
    with processes(workers) as pool:
        yield pool, 2 * workers, lambda: None


@contextmanager
def _cluster(address: str) -> Iterator[_Crew]:
    """Yield the workers of a Dask scheduler, which gives the items of a lost worker to another."""
    import logging

    from dbc import InputError

    try:
        import distributed
    except ImportError:
        raise InputError(
            "--scheduler", "needs Dask, which is not installed", "install bumpbench[cluster]"
        ) from None
    for name in ("distributed", "tornado", "asyncio"):  # what matters arrives as an exception
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        asyncio.run(_greet(address))
    except Exception as error:  # whatever listens there may answer anything, or nothing
        known = isinstance(error, (OSError, ValueError)) and str(error)
        raise InputError(
            f"--scheduler {address}",
            f"no Dask scheduler answers: {known or 'something else listens there'}",
            "start one with: dask scheduler",
        ) from None
    connect: Any = distributed.Client  # typed in part only
    client = connect(address, timeout=_CONNECT_S, set_as_default=False)

    def check() -> None:
        if not client.scheduler_info()["workers"]:
            raise InputError(
                address, "the scheduler has no workers", f"start some with: dask worker {address}"
            )

    try:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_S)
        except TimeoutError:
            check()
        # A function of the standard library: a worker without Bumpbench could not find ours.
        for worker, other in client.run(version, "bumpbench", on_error="return").items():
            if other != version("bumpbench"):
                what = f"worker {worker} has no bumpbench"
                if isinstance(other, str):
                    what = f"worker {worker} has bumpbench {other}, here is {version('bumpbench')}"
                raise InputError(address, what, "install one version everywhere")
        threads = sum(int(one["nthreads"]) for one in client.scheduler_info()["workers"].values())
        yield client.get_executor(pure=False), 2 * threads, check
    except (OSError, TimeoutError, RuntimeError):
        raise InputError(
            address, "the scheduler has gone", "start it, and run this again"
        ) from None
    finally:
        client.close(timeout=0.5)


async def _greet(address: str) -> None:
    """Exchange Dask's greeting: a client that fails in it gives up slowly and may block another."""
    from distributed.comm.core import connect

    greet: Any = connect
    comm = await asyncio.wait_for(greet(address, timeout=_CONNECT_S), _CONNECT_S + 1.0)
    await comm.close()
