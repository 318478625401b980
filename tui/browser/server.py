"""Serving `bumpbench tui` to browsers of this machine, with a page that needs no network."""

from __future__ import annotations

import logging
import shlex
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

from textual_serve.server import Server

from dbc import InputError

HOST = "127.0.0.1"
"""Other hosts get no page: a page gives the same control as the terminal at the bench."""
_PORT = 8000
_PAGES = Path(__file__).with_name("templates")


def serve(arguments: Sequence[str]) -> None:
    """Serve a command of `bumpbench` until Ctrl-C: each tab is a terminal of its own.

    Raises InputError if no port is free.
    """
    # A network that swallows what is sent to the world would keep the library's own page blank: it
    # fetches a font there.
    command = shlex.join([sys.executable, "-m", "tui", *arguments])
    _Quiet(command, HOST, _free_port(), title="Bumpbench", templates_path=_PAGES).serve()


class _Quiet(Server):
    """Says where to look, and nothing else."""

    def initialize_logging(self) -> None:
        """Say nothing of every page that is asked for."""
        logging.getLogger().setLevel(logging.WARNING)

    async def on_startup(self, app: object) -> None:
        """Say where the terminal is."""
        sys.stderr.write(
            f"open {self.public_url} in a browser of this machine; Ctrl-C ends this server, "
            "the recorder goes on\n"
        )


def _free_port() -> int:
    for port in (_PORT, 0):
        with socket.socket() as place:
            # As the server itself does: a port that has just been left is free.
            place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                place.bind((HOST, port))
            except OSError:
                continue
            return int(place.getsockname()[1])
    raise InputError("--web", f"no port of {HOST} is free", "end other servers, and try again")
