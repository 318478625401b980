"""Serves pages to those who have the link, and `bumpbench tui` to browsers of this machine.

Any program and any user of this machine can reach a port of 127.0.0.1, and any page in a browser
can send requests to it.  The link has a random token in its path, which neither of them knows.  In
addition, a request must name this server as its host, and come from this server's own page: a
foreign name that is made to point at 127.0.0.1 reads nothing.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import shlex
import signal
import socket
import sys
from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from aiohttp import hdrs, web

from dbc import InputError

_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of every answer: the address has the token, so a browser must neither keep nor pass it
on."""

_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def listen(host: str, usual_port: int) -> socket.socket:
    """Return a socket that listens on a port of an address, on the usual one if that is free.

    Raises OSError if `host` is not an address of this machine.
    """
    for port in (usual_port, 0):  # 0: any free one
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            return socket.create_server(address, family=family, backlog=socket.SOMAXCONN)
        except OSError as error:
            last_error = error
    raise last_error


class Guard:
    """The token of one server, and its checks.

    `host`: address on which `listening` listens.
    """

    def __init__(self, host: str, listening: socket.socket) -> None:
        self._listening = listening
        port = listening.getsockname()[1]
        self._host = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self._token = secrets.token_urlsafe(32)
        self.origin = f"http://{self._host}"
        """Scheme, host and port of the server."""
        self.prefix = f"/{self._token}"
        """Path below which everything is served."""
        self.link = f"{self.origin}{self.prefix}/"
        """The address to open."""

    @asynccontextmanager
    async def serving(
        self, pages: web.Application, most_bytes: int = 1_048_576
    ) -> AsyncGenerator[None]:
        """Serve `pages` below the prefix, and nothing else, until the block ends.

        `most_bytes`: largest body of a request, whatever limit `pages` itself has.
        """
        guarded = web.Application(middlewares=[self._check], client_max_size=most_bytes)
        guarded.on_response_prepare.append(_add_headers)
        guarded.add_subapp(self.prefix, pages)
        # This process may have no reader, and every malformed request would be a line of the log.
        silent = logging.Logger("requests without the token", logging.CRITICAL + 1)
        runner = web.AppRunner(
            guarded, access_log=None, logger=silent, keepalive_timeout=75.0, shutdown_timeout=0.5
        )
        await runner.setup()
        try:
            await web.SockSite(runner, self._listening).start()
            yield
        finally:
            await runner.cleanup()

    @web.middleware
    async def _check(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        """Answer a request that has token, host and origin of this server; refuse others."""
        token = request.path.removeprefix("/").partition("/")[0]
        origin = request.headers.get(hdrs.ORIGIN)
        is_socket = request.headers.get(hdrs.UPGRADE, "").lower() == "websocket"
        if request.headers.getall(hdrs.HOST, []) != [self._host]:
            refusal = "this address leads elsewhere"
        # A browser names the origin of every socket, but not of a page that is opened.
        elif origin != self.origin and (is_socket or origin is not None):
            refusal = "this is for pages of this server only"
        elif not secrets.compare_digest(token.encode(errors="replace"), self._token.encode()):
            refusal = "open the link that was printed when this server was started"
        else:
            return await handler(request)
        refused = web.Response(status=403, text=f"refused: {refusal}\n")
        refused.force_close()
        return refused


async def _add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)


# The terminal in a browser ------------------------------------------------------------------------

HOST = "127.0.0.1"
"""Other hosts get no page: a page gives the same control as the terminal at the bench."""


def serve(arguments: Sequence[str]) -> None:
    """Serve a command of `bumpbench` until Ctrl-C: each tab is a separate terminal.

    Raises InputError if no port is free.
    """
    try:
        listening = listen(HOST, 8000)
    except OSError as error:
        raise InputError("--web", f"no port of {HOST} is free", "end other servers") from error
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
    from textual_serve.server import Server

    class QuietServer(Server):
        async def on_startup(self, app: object) -> None:
            """Write nothing of its own."""

    command = shlex.join([sys.executable, "-m", "tui", *arguments])
    # On a network that drops packets to the internet, the library's own page would stay blank,
    # because it fetches a font there.
    templates = Path(__file__).with_name("templates")
    port = listening.getsockname()[1]
    server = QuietServer(command, HOST, port, title="Bumpbench", templates_path=templates)
    return await server._make_app()
