"""Starts processes that share the work of one identification or report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from threading import Thread

from .executors import processes

_HELPERS = 2
"""Number of helpers: one works while the parent works, both while the parent waits."""


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
