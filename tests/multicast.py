"""Multicast groups for tests: those of one process do not reach another's."""

import os


def own_group(second: int) -> str:
    """Return a multicast group of this process.

    `second`: its second number, another one for each file of tests.
    """
    return f"239.{second}.{os.getpid() >> 8 & 255}.{os.getpid() & 255}"
