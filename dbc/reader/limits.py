"""Limits on the size of a CAN database, so that a hostile one cannot fill memory."""

MAX_BYTES = 5_000_000
MAX_SIGNAL_BITS = 64
MAX_PAYLOAD_BYTES = 64
MAX_MESSAGES = 20_000
MAX_SELECTIONS = 1024
"""Number of ranges of selector values of one signal."""
MAX_NESTING = 16
"""Number of selectors above one signal."""
MAX_ITEMS = 100_000
"""Number of items of one list, such as the names of a value table or the receivers of a signal.
Each item takes the regular expression about 0.5 kB of memory until the list ends.
"""
MAX_FAULTS = 1000
"""Number of definitions in one file that are not understood."""

PICK_DBC = "give a CAN database in DBC format"
