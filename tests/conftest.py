"""Settings for all tests, made before NumPy is imported."""

import atexit
import gc
import os
import shutil
import signal
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in `tui`: small matrices
# A shell starts what runs in the background with SIGINT ignored, and processes of tests inherit it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if "RUNTIME_DIRECTORY" not in os.environ:  # no sockets of tests among those of the user
    os.environ["RUNTIME_DIRECTORY"] = tempfile.mkdtemp(prefix="bumpbench-")
    atexit.register(shutil.rmtree, os.environ["RUNTIME_DIRECTORY"], ignore_errors=True)

pytest_plugins = ["tests.workers"]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Load 500 test files and their libraries without a search for garbage, then or later.

    Python searched them again and again, for a tenth of the CPU of all tests.  Later it searches
    for garbage after 10,000 objects in place of 700, as the commands do: screens are so many small
    objects that the searches were a quarter of the CPU of their tests.
    """
    # Of the processes that tests start, not of pytest's own, which have begun by now.
    path = [str(Path(__file__).parent / "base_install"), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, path))
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10_000)
        gc.enable()
