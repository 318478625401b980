"""Applies a function to many items, in processes of this machine or on a Dask cluster.

Processes share loaded libraries, ignore Ctrl-C and end with their parent.
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing import active_children, get_all_start_methods, get_context, parent_process
from multiprocessing.connection import wait as wait_for
from threading import Thread
from typing import Any, TypeVar

from daq.formats.reader import optional
from dbc import InputError

from ..output import Stage

Item = TypeVar("Item")
Result = TypeVar("Result")


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
    only as there is room.  `workers`: number of processes.  `scheduler`: address of a Dask
    scheduler, whose workers do the work instead.  Raises InputError if Dask is not installed, no
    scheduler answers, or it has no workers.
    """
    remaining = iter(items)
    cut_off: list[Item] = []  # by the death of a worker process
    with _workers(workers, scheduler) as (executor, n_workers):
        running: dict[Future[Result], Item] = {}
        while not cut_off:
            # Twice as many as there are workers, so that none waits for its next item.
            for item in islice(remaining, 2 * n_workers - len(running)):
                try:
                    running[executor.submit(function, item)] = item
                except BrokenProcessPool:
                    cut_off.append(item)
                    break
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                item = running.pop(future)
                if not future.cancelled() and isinstance(future.exception(), BrokenProcessPool):
                    cut_off.append(item)
                else:
                    yield item, future
        cut_off += running.values()
    for item in cut_off:
        with processes(1) as single:
            future = single.submit(function, item)
            wait([future])
            yield item, future
    if cut_off:  # the processes of before have all ended: others do the rest
        yield from as_finished(function, remaining, workers)


def map_items(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int, stage: Stage
) -> list[Result]:
    """Return ``function(item)`` of every item, in their order, and report progress to `stage`.

    The first error ends the work.  Raises InputError if a worker process dies.  Other arguments and
    errors: as of `as_finished`.
    """
    results: dict[Item, Result] = {}
    for item, future in as_finished(function, items, workers):
        try:
            results[item] = future.result()
        except BrokenProcessPool:
            advice = "close other programs; it needs memory"
            raise InputError("processes", "one died", advice) from None
        stage(len(results) / len(items), f"{len(results)} of {len(items)}")
    return [results[item] for item in items]


@contextmanager
def processes(workers: int, modules: Sequence[str] = ("identify",)) -> Iterator[Executor]:
    """Yield processes of this machine that share loaded modules; after an error they end at once.

    Ctrl-C reaches only the parent, which then ends them; they end, too, when it is killed.  Raises
    InputError if no process can be started, or one dies.
    """
    # Windows has no fork server.
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
    context: Any = get_context(method)
    pool = ProcessPoolExecutor(workers, context, _end_with_parent)
    try:
        if method == "forkserver":
            from multiprocessing.forkserver import ensure_running

            context.set_forkserver_preload(list(modules))
            ensure_running()  # it loads the modules, for a second, while the caller goes on
        yield pool
    except BaseException as error:
        for process in active_children():
            process.terminate()
        if not isinstance(error, OSError | BrokenProcessPool):
            raise
        is_dead = isinstance(error, BrokenProcessPool)
        reason = "one died" if is_dead else f"no process can be started ({error})"
        raise InputError("processes", reason, "end other programs: they need memory") from error
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Leave Ctrl-C to the parent, and end with it: a worker would wait for work for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None  # a worker has a parent

    def watch() -> None:
        wait_for([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def _workers(workers: int, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """Yield processes, or the workers of a Dask cluster, as an executor, and their number."""
    if scheduler is None:
        with processes(workers) as pool:
            yield pool, workers
        return
    connect = optional("distributed", "cluster").Client
    for name in ("distributed", "tornado", "asyncio"):  # what matters arrives as an exception
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = connect(scheduler, timeout=4.0, set_as_default=False)
    except (OSError, ValueError) as error:
        reason, advice = f"no Dask scheduler answers: {error}", "start one with: dask scheduler"
        raise InputError(f"--scheduler {scheduler}", reason, advice) from None
    try:
        with suppress(TimeoutError):  # they may have been started just now
            client.wait_for_workers(1, timeout=4.0)
        n_threads = sum(client.nthreads().values())
        if not n_threads:
            advice = f"start some with: dask worker {scheduler}"
            raise InputError(scheduler, "the scheduler has no workers", advice)
        yield client.get_executor(pure=False), n_threads
    except (OSError, RuntimeError):
        raise InputError(scheduler, "the scheduler has gone", "run this again") from None
    finally:
        client.close(timeout=0.5)
