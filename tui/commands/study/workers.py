"""A pure function over many seeds in worker processes."""

from __future__ import annotations

import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import active_children, get_context
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
    """
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as executor:
        try:
            # Workers start at the first calls, and inherit which signals are blocked.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                futures = [executor.submit(function, seed) for seed in seeds]
            finally:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            for done, _ in enumerate(as_completed(futures), start=1):
                stage(done / len(futures), f"{done} of {len(futures)}")
            return [future.result() for future in futures]
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                worker.terminate()
            raise
