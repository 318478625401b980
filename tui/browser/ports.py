"""Finds a port for a server of this machine."""

from __future__ import annotations

import socket


def free_port(host: str, usual: int) -> int:
    """Return a port that nothing listens on, `usual` if it is free.

    Raises OSError if there is none: `host` is not an address of this machine.
    """
    for port in (usual, 0):
        try:
            family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, kind) as taken:
                # As a server itself does: a port that was just released counts as free.
                taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                taken.bind(place)
                return int(taken.getsockname()[1])
        except OSError as error:
            last = error
    raise last
