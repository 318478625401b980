"""A pure function over many seeds, by the executors of `tui.workers.executors`."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from ...output import Stage
from ...workers.executors import as_finished, crew_of

Result = TypeVar("Result")


def over_seeds(
    function: Callable[[int], Result],
    seeds: range,
    workers: int,
    stage: Stage,
    scheduler: str | None = None,
) -> list[Result]:
    """Return ``function(seed)`` of every seed, in their order.

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
    scheduler : str, optional
        Address of a Dask scheduler, whose workers do it instead.

    Raises
    ------
    InputError
        If a worker dies, most likely for want of memory; as `crew_of`.
    """
    from dbc.errors import InputError  # with NumPy behind it: not for --help

    results: dict[int, Result] = {}
    with crew_of(workers, scheduler) as crew:
        try:
            for seed, future in as_finished(crew, function, seeds):
                results[seed] = future.result()  # what fails, fails at once
                stage(len(results) / len(seeds), f"{len(results)} of {len(seeds)}")
        except BrokenProcessPool:
            raise InputError(
                "study", "a worker process died", "try fewer --workers or a lower --rate-hz"
            ) from None
    return [results[seed] for seed in seeds]
