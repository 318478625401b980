"""Applies a pure function to items with the executors of `tui.jobs.executors`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from ..output import Stage
from .executors import as_finished, workers_of

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_items(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    stage: Stage,
    subject: str,
    scheduler: str | None = None,
) -> list[Result]:
    """Return ``function(item)`` of every item, in their order.

    `function`: picklable: a module's function, or a `functools.partial` of one.  `items`: its
    arguments; one call for each.  `stage`: called with the share done, 0..1.  `subject`: name of
    the work in the error if a worker dies.  `scheduler`: address of a Dask scheduler, whose workers
    then do the work.  Raises InputError if a worker dies, most likely for lack of memory, and those
    of `workers_of`.
    """
    from dbc import InputError  # this loads NumPy, which --help does not need

    results: dict[Item, Result] = {}
    with workers_of(workers, scheduler) as crew:
        try:
            for item, future in as_finished(crew, function, items):
                results[item] = future.result()  # an error ends the work at once
                stage(len(results) / len(items), f"{len(results)} of {len(items)}")
        except BrokenProcessPool:
            raise InputError(
                subject, "a worker process died", "close other programs; it needs memory"
            ) from None
    return [results[item] for item in items]
