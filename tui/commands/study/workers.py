"""A pure function over many seeds in worker processes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread
from typing import TypeVar

from ...output import Stage

Result = TypeVar("Result")


def over_seeds(
    function: Callable[[int], Result], seeds: range, workers: int, stage: Stage
) -> list[Result]:
    """Return ``function(seed)`` of every seed, in their order.

    Ctrl-C reaches only this process, which then ends its workers: they say nothing and leave
    nothing behind.

    Parameters
    ----------
    function : callable of int
        Picklable: a module's function, or a `functools.partial` of one.
    seeds : range
        What to call it with.
    workers : int
        Number of processes.
    stage : Stage
        Is told how far it is.

    Raises
    ------
    InputError
        If a worker dies, most likely for want of memory.
    """
    from dbc.errors import InputError  # with NumPy behind it: not for --help

    context = get_context("spawn")
    with ProcessPoolExecutor(workers, context, _end_with_parent) as executor:
        try:
            # Workers start at the first calls, and inherit which signals are blocked.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                futures = [executor.submit(function, seed) for seed in seeds]
            finally:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            for done, future in enumerate(as_completed(futures), start=1):
                future.result()  # what fails, fails at once
                stage(done / len(futures), f"{done} of {len(futures)}")
            return [future.result() for future in futures]
        except BrokenProcessPool:
            raise InputError(
                "study", "a worker process died", "try fewer --workers or a lower --rate-hz"
            ) from None
        except BaseException:
            # Otherwise the executor would first finish what it has begun.
            for worker in active_children():
                worker.terminate()
            raise


def _end_with_parent() -> None:
    """Let a worker end when its parent was killed; it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None  # a worker has one

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()
