"""Reads the DBC with cantools as well, in a separate process, and reports the differences."""
