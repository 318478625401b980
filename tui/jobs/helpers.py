"""Starts processes that share the work of one identification or report."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from threading import Thread

from .pool import Pool
from .start import end_with_parent, ignoring_interrupts, preloaded

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

    with Pool(_HELPERS, preloaded(modules), _made_ready) as pool:

        def start() -> None:
            with ignoring_interrupts(), suppress(InputError):  # a use raises it again
                for _ in range(_HELPERS):
                    pool.submit(int)

        starting = Thread(target=start)  # it waits for the libraries
        starting.start()
        try:
            yield pool
        except BrokenProcessPool:
            what, advice = "a helper process died", "close other programs: it needs memory"
            raise InputError("helpers", what, advice) from None
        except BaseException:  # such as Ctrl-C: what was begun need not be finished
            starting.join()
            for helper in active_children():
                helper.terminate()
            raise
        finally:
            starting.join()
            pool.shutdown(cancel_futures=True)


def _made_ready() -> None:
    """Make a helper ready: what is loaded stays, and is searched for garbage no more."""
    end_with_parent()
    gc.freeze()
