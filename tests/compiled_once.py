"""Compiles each Numba function in one of the processes that run tests; the others wait for it.

In a fresh tree three workers would compile the integrator of a real car at the same time, each for
some 17 s of CPU; what the first one has compiled the others read from the cache beside the sources.
"""

from __future__ import annotations

import fcntl
import os
import sys
from pathlib import Path
from threading import RLock
from typing import Any

import pytest

_SOURCES = Path(__file__).parents[1] / "identify" / "nonlinear"


class _OneAtATime:
    """The lock on the folder of the compiled sources; a function compiles those that it calls."""

    def __init__(self) -> None:
        self._within, self._depth = RLock(), 0
        self._folder = os.open(_SOURCES, os.O_RDONLY)

    def __enter__(self) -> None:
        self._within.acquire()
        if self._depth == 0:
            fcntl.flock(self._folder, fcntl.LOCK_EX)
        self._depth += 1

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        if self._depth == 0:
            fcntl.flock(self._folder, fcntl.LOCK_UN)
        self._within.release()


@pytest.hookimpl
def pytest_collection_finish() -> None:
    """Let compilations wait for each other, if the tests have loaded Numba."""
    numba = sys.modules.get("numba.core.dispatcher")
    if numba is None or numba.Dispatcher.compile.__module__ == __name__:
        return
    alone, compile_ = _OneAtATime(), numba.Dispatcher.compile

    def compiled(dispatcher: Any, signature: Any) -> Any:
        with alone:
            return compile_(dispatcher, signature)

    numba.Dispatcher.compile = compiled
