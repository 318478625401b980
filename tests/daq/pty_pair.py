"""Two serial devices joined by a cable: what is written to one can be read from the other."""

from __future__ import annotations

import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def pty_pair() -> Iterator[tuple[str, str]]:
    """Yield the paths of two pseudo terminals in raw mode, joined by a thread."""
    masters, slaves = zip(os.openpty(), os.openpty(), strict=True)
    for fd in (*masters, *slaves):
        tty.setraw(fd)
    wake_r, wake_w = os.pipe()

    def carry() -> None:
        other = dict(zip(masters, reversed(masters), strict=True))
        while True:
            ready, _, _ = select.select([*masters, wake_r], [], [])
            if wake_r in ready:
                return
            for fd in ready:
                data = os.read(fd, 4096)
                while data:
                    data = data[os.write(other[fd], data) :]

    cable = threading.Thread(target=carry, daemon=True)
    cable.start()
    try:
        yield os.ttyname(slaves[0]), os.ttyname(slaves[1])
    finally:
        os.write(wake_w, b"x")
        cable.join()
        for fd in (*masters, *slaves, wake_r, wake_w):
            os.close(fd)
