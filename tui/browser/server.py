"""Serves `bumpbench tui` to browsers of this machine, with a page that needs no network."""

from __future__ import annotations

import logging
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from aiohttp import web
from textual_serve.server import Server

from dbc import InputError

from .guard import Guard
from .ports import free_port

HOST = "127.0.0.1"
"""Other hosts get no page: a page gives the same control as the terminal at the bench."""
_PORT = 8000
_PAGES = Path(__file__).with_name("templates")


def serve(arguments: Sequence[str]) -> None:
    """Serve a command of `bumpbench` until Ctrl-C: each tab is a separate terminal.

    Raises InputError if no port is free.
    """
    # On a network that drops packets to the internet, the library's own page would stay blank,
    # because it fetches a font there.
    command = shlex.join([sys.executable, "-m", "tui", *arguments])
    try:
        port = free_port(HOST, _PORT)
    except OSError as error:
        what = f"no port of {HOST} is free"
        raise InputError("--web", what, "end other servers, and try again") from error
    _Guarded(command, port, Guard(HOST, port)).serve()


class _Guarded(Server):
    """Serves requests with the link, and prints that link and nothing else."""

    def __init__(self, command: str, port: int, guard: Guard) -> None:
        super().__init__(command, HOST, port, title="Bumpbench", templates_path=_PAGES)
        self._guard = guard

    async def _make_app(self) -> web.Application:
        return self._guard.application(await super()._make_app())

    def initialize_logging(self) -> None:
        """Log no requests for pages."""
        logging.getLogger().setLevel(logging.WARNING)

    async def on_startup(self, app: object) -> None:
        """Print the link to the terminal."""
        sys.stderr.write(
            f"open {self._guard.link} in a browser of this machine; who has the link has the "
            "terminal; Ctrl-C ends this server, the recorder goes on\n"
        )
