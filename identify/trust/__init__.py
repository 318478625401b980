"""Trust: may a result be used?  One gate a file, each from the fit to findings."""
