"""What a person touches: the `bumpbench` command line."""

import os

# The matrices here are small: a second BLAS thread gains nothing and, on a busy machine, spins.
# Must be said before NumPy is imported; who sets it otherwise is obeyed.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
