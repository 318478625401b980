"""Admits only requests that have the link of a served page, and only from pages of this server.

Any program and any user of this machine can reach a port of 127.0.0.1, and any page in a browser
can send requests to it.  The link has a random token in its path, which neither of them knows.  In
addition, the request must name this server as its host, and come from this server's own page: a
foreign name that is made to point at 127.0.0.1 reads nothing.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable

from aiohttp import hdrs, web

_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

_TOKEN_BYTES = 32
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of every answer: the address has the token, so a browser must neither keep nor pass it
on."""


class Guard:
    """The token of one server, and its checks."""

    def __init__(self, host: str, port: int) -> None:
        self._host = f"{host}:{port}"
        self._token = secrets.token_urlsafe(_TOKEN_BYTES)
        self.origin = f"http://{self._host}"
        """Scheme, host and port of the server."""
        self.prefix = f"/{self._token}"
        """Path below which everything is served."""
        self.link = f"{self.origin}{self.prefix}/"
        """The address to open."""

    def application(self, pages: web.Application, most_bytes: int = 1_048_576) -> web.Application:
        """Return an application that serves `pages` below the prefix, and nothing else.

        `most_bytes`: largest body of a request; that of `pages` itself counts for nothing.
        """

        @web.middleware
        async def check(request: web.Request, handler: _Handler) -> web.StreamResponse:
            if refusal := self.refusal(request):
                return web.Response(status=403, text=f"refused: {refusal}\n")
            return await handler(request)

        guarded = web.Application(middlewares=[check], client_max_size=most_bytes)
        guarded.on_response_prepare.append(_add_headers)
        guarded.add_subapp(self.prefix, pages)
        return guarded

    def refusal(self, request: web.Request) -> str:
        """Return why a request is refused; empty if it is not."""
        token = request.path.split("/")[1]
        origin = request.headers.get(hdrs.ORIGIN)
        socket = request.headers.get(hdrs.UPGRADE, "").lower() == "websocket"
        if request.headers.getall(hdrs.HOST, []) != [self._host]:
            return "this address leads elsewhere"
        # A browser names the origin of every socket, but not of a page that is opened.
        if origin != self.origin and (socket or origin is not None):
            return "this is for pages of this server only"
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return "open the link that was printed when this server was started"
        return ""


async def _add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(_HEADERS)
