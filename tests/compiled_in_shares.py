"""Compiles the tests once, a share in each of the processes that run them.

In a fresh tree every process would rewrite the asserts of 500 files, for some 10 s of CPU each.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from _pytest.assertion import rewrite

_TESTS = Path(__file__).parent


@pytest.hookimpl
def pytest_sessionstart(session: pytest.Session) -> None:
    """Rewrite the share of this worker of pytest-xdist; without workers nothing is done twice."""
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
