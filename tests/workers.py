"""What the processes of pytest-xdist do once for all of them, or not at all."""

from __future__ import annotations

import fcntl
import os
import sys
from pathlib import Path
from threading import RLock
from typing import Any

import pytest
from _pytest.assertion import rewrite
from _pytest.runner import runtestprotocol

_TESTS = Path(__file__).parent
_COMPILED = _TESTS.parent / "identify" / "nonlinear"


@pytest.hookimpl
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile this worker's share of the tests: in a fresh tree each would compile all of them."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None or sys.dont_write_bytecode:
        return
    number = int(worker["workerid"].removeprefix("gw"))
    for path in sorted(_TESTS.rglob("test_*.py"))[number :: worker["workercount"]]:
        _rewrite(path, session.config)


def _rewrite(path: Path, config: pytest.Config) -> None:
    """Store the code of a test file where pytest looks for it, unless it is there."""
    folder = rewrite.get_cache_dir(path)
    stored = folder / f"{path.stem}{rewrite.PYC_TAIL}"
    if rewrite._read_pyc(path, stored) is None:
        folder.mkdir(parents=True, exist_ok=True)
        hashed, code = rewrite._rewrite_test(path, config)
        rewrite._write_pyc(config.stash[rewrite.assertstate_key], code, hashed, stored)


class _OneAtATime:
    """The lock on the folder of the compiled sources; a function compiles those that it calls."""

    def __init__(self) -> None:
        self._within, self._depth = RLock(), 0
        self._folder = os.open(_COMPILED, os.O_RDONLY)

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
    """Let compilations by Numba wait for each other: in a fresh tree each takes some 17 s of CPU.

    What one process has compiled the others read from the cache beside the sources.
    """
    numba = sys.modules.get("numba.core.dispatcher")
    if numba is None or numba.Dispatcher.compile.__module__ == __name__:
        return
    alone, compile_ = _OneAtATime(), numba.Dispatcher.compile

    def compiled(dispatcher: Any, signature: Any) -> Any:
        with alone:
            return compile_(dispatcher, signature)

    numba.Dispatcher.compile = compiled


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Report a test of a worker once, in place of three times, two of which appear nowhere.

    Left to pytest where there are no workers, or durations are asked for.
    """
    if not hasattr(item.config, "workerinput") or item.config.option.durations is not None:
        return None
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        if report.when == "call" or not report.passed or report.sections:
            item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
