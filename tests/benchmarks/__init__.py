"""Measures costs against other libraries or limits: `make bench`."""

import tui as tui  # says, before NumPy is loaded, that BLAS shall use one thread
