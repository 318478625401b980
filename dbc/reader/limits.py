"""Limits on the size of a CAN database, so that a hostile one cannot fill memory."""

MAX_BYTES = 5_000_000
MAX_SIGNAL_BITS = 64
MAX_PAYLOAD_BYTES = 64
MAX_MESSAGES = 20_000
MAX_SELECTIONS = 1024
"""Ranges of selector values of one signal."""
MAX_NESTING = 16
"""Selectors above one signal."""
MAX_ITEMS = 100_000
"""Items of one list, as the names of a value table or the nodes that receive a signal.

Each costs the matcher some 0.5 kB until the list ends.
"""
MAX_FAULTS = 1000
"""Definitions that are not understood, in one file."""

PICK_DBC = "give a CAN database in DBC format"
