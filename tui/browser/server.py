"""Serves `bumpbench tui` to browsers of this machine, with a page that needs no network."""

from __future__ import annotations

import asyncio
import shlex
import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

from aiohttp import web
from textual_serve.server import Server

from dbc import InputError

from .guard import Guard, listen

HOST = "127.0.0.1"
"""Other hosts get no page: a page gives the same control as the terminal at the bench."""
_PORT = 8000
_PAGES = Path(__file__).with_name("templates")


def serve(arguments: Sequence[str]) -> None:
    """Serve a command of `bumpbench` until Ctrl-C: each tab is a separate terminal.

    Raises InputError if no port is free.
    """
    try:
        listening = listen(HOST, _PORT)
    except OSError as error:
        reason = f"no port of {HOST} is free"
        raise InputError("--web", reason, "end other servers, and try again") from error
    guard = Guard(HOST, listening)

    async def run() -> None:
        ended = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, ended.set)
        async with guard.serving(await terminal_pages(arguments, listening)):
            sys.stderr.write(
                f"open {guard.link} in a browser of this machine; who has the link has the "
                "terminal; Ctrl-C ends this server, the recorder goes on\n"
            )
            await ended.wait()

    asyncio.run(run())


async def terminal_pages(arguments: Sequence[str], listening: socket.socket) -> web.Application:
    """Return the pages of a command of `bumpbench`, as they are served at a socket."""
    command = shlex.join([sys.executable, "-m", "tui", *arguments])
    # On a network that drops packets to the internet, the library's own page would stay blank,
    # because it fetches a font there.
    port = listening.getsockname()[1]
    server = _Quiet(command, HOST, port, title="Bumpbench", templates_path=_PAGES)
    return await server._make_app()


class _Quiet(Server):
    async def on_startup(self, app: object) -> None:
        """Write nothing of its own."""
