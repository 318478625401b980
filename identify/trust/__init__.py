"""Judges whether a result may be used: one gate in each file, each from the fit to findings."""
