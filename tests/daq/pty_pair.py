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
    for fd in masters:
        os.set_blocking(fd, False)
    wake_r, wake_w = os.pipe()

    def carry() -> None:
        other = dict(zip(masters, reversed(masters), strict=True))
        waiting = dict.fromkeys(masters, b"")  # read from one end, not yet taken by the other
        while True:
            readers = [fd for fd in masters if not waiting[fd]]
            writers = [other[fd] for fd in masters if waiting[fd]]
            readable, writable, _ = select.select([*readers, wake_r], writers, [])
            if wake_r in readable:  # also when the other end is read no more
                return
            for fd in readable:
                waiting[fd] = os.read(fd, 4096)
            for fd in masters:
                if other[fd] in writable:
                    waiting[fd] = waiting[fd][os.write(other[fd], waiting[fd]) :]

    cable = threading.Thread(target=carry, daemon=True)
    cable.start()
    try:
        yield os.ttyname(slaves[0]), os.ttyname(slaves[1])
    finally:
        os.write(wake_w, b"x")
        cable.join()
        for fd in (*masters, *slaves, wake_r, wake_w):
            os.close(fd)
