"""Address on which a display listens, and lines that show its link in a terminal."""

from __future__ import annotations

import ipaddress
import socket
import sys
from collections.abc import Iterator

import segno

from daq import InputError

from ..browser.ports import free_port
from .served import Served

HERE, LAN = "here", "lan"
"""Words for the address that only this machine reaches, and for its address in the network."""
_LOOPBACK = "127.0.0.1"
_PORT = 8010
_SOMEWHERE = ("192.0.2.1", 9)
"""An address that belongs to no machine (RFC 5737): nothing is sent, only the route is
requested."""


def address_of(host: str) -> str:
    """Return the address to listen on.

    `host`: an address or a name of this machine, or `HERE` or `LAN`.  Raises InputError if there is
    none.
    """
    if host == HERE:
        return _LOOPBACK
    if host == LAN:
        return _address_in_network()
    if (address := _parsed(host)) is not None and address.is_unspecified:
        advice = "name one address of this machine, or lan"
        raise InputError("display", f"{host} is every address", advice)
    return host


def is_loopback(host: str) -> bool:
    """Return True for an address that no other machine can reach."""
    address = _parsed(host)
    return host == "localhost" if address is None else address.is_loopback


def port_of(host: str) -> int:
    """Return a port that nothing listens on, the usual one if possible.

    Raises InputError if the address is not one of this machine's.
    """
    try:
        return free_port(host, _PORT)
    except OSError as error:
        what = f"cannot listen on {host}: {error.strerror or error}"
        raise InputError("display", what, "name an address of this machine, or lan") from error


def host_in_link(host: str) -> str:
    """Return an address as a link contains it: that of IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def print_link(served: Served) -> None:
    """Write link, warning, number and code to stderr."""
    for line in link_lines(served, sys.stderr.isatty()):
        sys.stderr.write(f"{line}\n")


def link_lines(served: Served, colours: bool) -> Iterator[str]:
    """Yield what a terminal shows: link, warning, number, and a code for a phone's camera.

    `colours`: False where the terminal would show escape sequences as text; then there is no code.
    """
    secret = served.secret
    yield f"display: open {served.link}"
    if not is_loopback(served.host):
        yield (
            "warning: anyone with this link sees the bench, and nothing is encrypted: use a "
            "network that you trust"
        )
    if secret:
        yield (
            f"control: type {secret[:3]} {secret[3:]} on the page; anyone who knows it can start, "
            "reject and pause runs"
        )
    if colours and not is_loopback(served.host):
        for line in qr_lines(served.link):
            # Black on white whatever the terminal's colours are: cameras want dark on light.
            yield f"\x1b[38;5;16;48;5;231m{line}\x1b[0m"


def qr_lines(link: str) -> Iterator[str]:
    """Yield a link as a QR code, two rows of it in a line, dark where a character is drawn."""
    rows = [tuple(row) for row in segno.make_qr(link, error="l").matrix_iter(border=2)]
    if len(rows) % 2:
        rows.append((0,) * len(rows[0]))
    for upper, lower in zip(rows[::2], rows[1::2], strict=True):
        halves = zip(upper, lower, strict=True)
        yield "".join(" ▀▄█"[(up & 1) + 2 * (low & 1)] for up, low in halves)


def _parsed(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return an address; None for a name."""
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _address_in_network() -> str:
    """Return the address by which this machine reaches others."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_SOMEWHERE)
        except OSError as error:
            what = "no network is connected"
            raise InputError("display", what, "name the address of this machine") from error
        return str(probe.getsockname()[0])
