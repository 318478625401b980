"""What things cost, beside a peer or a limit: `make bench`."""

import tui as tui  # says, before NumPy is loaded, that BLAS shall use one thread
