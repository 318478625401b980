"""The `bumpbench` command line and the operator's terminal."""

import os

# The matrices here are small: a second BLAS thread gains nothing and, on a busy machine, spins.
# Takes effect only before NumPy is imported; a value that the user has set stays.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
