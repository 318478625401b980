"""The child of `guard`: reads one session file and sends it to stdout.

Run as ``python -I -m daq.session.sandbox FILE MAX_BYTES MAX_S PART``.
"""

from __future__ import annotations

import gc
import sys


def run(path: str, max_bytes: str, max_s: str, part: str) -> None:
    """Read part of a file within limits and send it.

    All objects live to the end, those of the libraries too: to search them for garbage would take
    a thirtieth of the time.
    """
    gc.disable()
    from ..tree import Part
    from .child import main

    main(sys.stdout.buffer, path, int(max_bytes), int(max_s), Part(part))
    gc.freeze()


if __name__ == "__main__":
    run(*sys.argv[1:])
