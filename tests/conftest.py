"""Settings for all tests, made before NumPy is imported."""

import atexit
import gc
import os
import shutil
import tempfile

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in `tui`: small matrices
if "RUNTIME_DIRECTORY" not in os.environ:  # no sockets of tests among those of the user
    os.environ["RUNTIME_DIRECTORY"] = tempfile.mkdtemp(prefix="bumpbench-")
    atexit.register(shutil.rmtree, os.environ["RUNTIME_DIRECTORY"], ignore_errors=True)

# Python searches all that it holds for garbage once it has grown by a quarter; a test process holds
# 500 files of tests with their libraries, and searched them for a tenth of its CPU.
gc.set_threshold(10_000, 20, 20)

pytest_plugins = ["tests.compiled_once", "tests.without_children"]
