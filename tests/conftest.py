"""Settings for all tests, made before NumPy is imported."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in `tui`: small matrices
