"""The display's address and link, and a display beside a recorder or a terminal."""

from __future__ import annotations

import ipaddress
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

from daq import InputError

from ..terminal.words import DisplayLink

HERE, LAN = "here", "lan"
"""Words for the address that only this machine reaches, and for its address in the network."""


@dataclass(frozen=True, slots=True)
class Served:
    """A display that is being served."""

    link: str
    """Address of the page, with its token."""
    host: str
    """Address on which the display listens."""
    secret: str
    """Number that gives control; empty for a display without control."""

    def lines(self, colours: bool) -> Iterator[str]:
        """Yield what a terminal shows: link, warning, number, and a code for a phone's camera.

        `colours`: False where the terminal would show escape sequences as text; then there is no
        code.
        """
        yield f"display: open {self.link}"
        if not is_loopback(self.host):
            yield (
                "warning: anyone with this link sees the bench, and nothing is encrypted: use a "
                "network that you trust"
            )
        if self.secret:
            yield (
                f"control: type {self.secret[:3]} {self.secret[3:]} on the page; anyone who knows "
                "it can start, reject and pause runs"
            )
        # Black on white whatever the terminal's colours are: cameras want dark on light.
        yield from (f"\x1b[38;5;16;48;5;231m{line}\x1b[0m" for line in self.code if colours)

    @property
    def code(self) -> tuple[str, ...]:
        """The link as a QR code, two rows of it in a line; empty for this machine's browsers."""
        import segno

        if is_loopback(self.host):
            return ()
        rows = [tuple(row) for row in segno.make_qr(self.link, error="l").matrix_iter(border=2)]
        if len(rows) % 2:
            rows.append((0,) * len(rows[0]))
        return tuple(
            "".join(" ▀▄█"[(up & 1) + 2 * (low & 1)] for up, low in zip(upper, lower, strict=True))
            for upper, lower in zip(rows[::2], rows[1::2], strict=True)
        )


def listen_on(host: str) -> tuple[str, socket.socket]:
    """Return an address and a socket that listens there, on the usual port if that is free.

    `host`: an address or a name of this machine, or `HERE` or `LAN`.  Raises InputError if there is
    no such address, or if it is every address.
    """
    from ..browser.server import listen  # aiohttp, which is an extra

    address = "127.0.0.1" if host == HERE else _address_in_network() if host == LAN else host
    parsed = _parsed(address)
    if parsed is not None and parsed.is_unspecified:
        advice = "name one address of this machine, or lan"
        raise InputError("display", f"{host} is every address", advice)
    try:
        return address, listen(address, 8010)
    except OSError as error:
        reason = f"cannot listen on {address}: {error.strerror or error}"
        raise InputError("display", reason, "name an address of this machine, or lan") from error


def is_loopback(host: str) -> bool:
    """Return True for an address that no other machine can reach."""
    address = _parsed(host)
    return host == "localhost" if address is None else address.is_loopback


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
            # An address of no machine (RFC 5737): nothing is sent, only the route is asked.
            probe.connect(("192.0.2.1", 9))
        except OSError as error:
            reason = "no network is connected"
            raise InputError("display", reason, "name the address of this machine") from error
        return str(probe.getsockname()[0])


# A display beside another program -----------------------------------------------------------------

_END_S = 2.0
"""Time that a display may take to end, s; it takes 0.1."""


@contextmanager
def display_beside_recorder(folder: Path, host: str | None, control: bool) -> Iterator[None]:
    """Serve the display of a recorder; it writes link and code to the recorder's stderr.

    Nothing waits for it.  `host`: as of `tui.display.link.listen_on`; None for no display.  Raises
    InputError if it cannot listen there.
    """
    if not _is_wanted(host, control):
        yield
        return
    with _display(folder, str(host), "display", control, subprocess.DEVNULL, None):
        yield


@contextmanager
def display_beside_terminal(
    folder: Path, host: str | None, operator: str, control: bool
) -> Iterator[DisplayLink | None]:
    """Serve the display of a folder's recorder; yield how to open it, None if none is wanted.

    Parameters and errors are those of `display_beside_recorder`.
    """
    if not _is_wanted(host, control):
        yield None
        return
    with (
        TemporaryFile("w+") as errors,  # not a pipe, which somebody would have to read
        _display(folder, str(host), operator, control, subprocess.PIPE, errors) as process,
    ):
        assert process.stdout is not None
        if not (line := process.stdout.readline()):
            errors.seek(0)
            lines = errors.read().strip().splitlines() or ["it did not start"]
            raise InputError("display", lines[-1], "start it alone: bumpbench display")
        served = Served(**json.loads(line))
        yield DisplayLink(tuple(served.lines(colours=False)), served.code)


def _is_wanted(host: str | None, control: bool) -> bool:
    """Return True if a display is wanted; raise InputError if it cannot be served."""
    if host is None:
        if control:
            raise InputError("--control", "needs a display", "add --display lan")
        return False
    try:
        listen_on(host)[1].close()
    except ImportError as error:
        reason = "aiohttp is not installed"
        raise InputError("--display", reason, "install bumpbench[web]") from error
    return True


@contextmanager
def _display(
    folder: Path, host: str, operator: str, control: bool, stdout: int, stderr: IO[str] | None
) -> Iterator[subprocess.Popen[str]]:
    """Run a display until the block ends: its stdin closes, also if this process is killed."""
    words = ["display", str(folder.resolve()), "--display", host, "--operator", operator, "--json"]
    command = [sys.executable, "-m", "tui", *words, *(["--control"] if control else [])]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=stdout, stderr=stderr, text=True) as process:
        try:
            yield process
        finally:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
