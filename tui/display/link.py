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

from daq import InputError
from daq.control.address import group_readable
from daq.formats.reader import optional


@dataclass(frozen=True, slots=True)
class Served:
    """A display that is being served."""

    link: str
    """Address of the page, with its token."""
    host: str
    """Address on which the display listens."""
    secret: str
    """Number that gives control; empty for a display without control."""

    @property
    def lines(self) -> tuple[str, ...]:
        """Link, warning and number, for a person."""
        lines = [f"display: open {self.link}"]
        if not _is_loopback(self.host):
            risk = "anyone with this link sees the bench, and nothing is encrypted"
            lines.append(f"warning: {risk}: use a network that you trust")
        if self.secret:
            number = f"{self.secret[:3]} {self.secret[3:]}"
            risk = "anyone who knows it can start, reject and pause runs"
            lines.append(f"control: type {number} on the page; {risk}")
        return tuple(lines)

    @property
    def code(self) -> tuple[str, ...]:
        """The link as a QR code, two rows of it in a line; empty for this machine's browsers."""
        import segno

        if _is_loopback(self.host):
            return ()
        # Least correction and a narrow border, so that it fits beside the words on a terminal.
        code = segno.make_qr(self.link, error="l")
        rows = [tuple(row) for row in code.matrix_iter(border=2)]  # 1: dark
        if len(rows) % 2:
            rows.append((0,) * len(rows[0]))
        return tuple(
            "".join(" ▀▄█"[(up & 1) + 2 * (low & 1)] for up, low in zip(upper, lower, strict=True))
            for upper, lower in zip(rows[::2], rows[1::2], strict=True)
        )

    def write(self) -> None:
        """Write the lines to stderr, and the code if that is a terminal."""
        for line in self.lines:
            sys.stderr.write(f"{line}\n")
        for line in self.code if sys.stderr.isatty() else ():
            # Black on white whatever the terminal's colours are: cameras want dark on light.
            sys.stderr.write(f"\x1b[38;5;16;48;5;231m{line}\x1b[0m\n")


def listen_on(host: str) -> tuple[str, socket.socket]:
    """Return an address and a socket that listens there, on port 8010 if that is free.

    `host`: an address or a name of this machine; `here` for the address that only this machine
    reaches, `lan` for its address in the network.  Raises InputError if there is no such address,
    or if it is every address.
    """
    optional("aiohttp", "web")
    from ..browser.server import listen

    advice = "name an address of this machine, or lan"
    address = "127.0.0.1" if host == "here" else _address_in_network() if host == "lan" else host
    if address in ("0.0.0.0", "::"):
        raise InputError("display", f"{host} is every address", advice)
    try:
        return address, listen(address, 8010)
    except (OSError, UnicodeError) as error:  # the latter for a name as 192.168..5
        why = getattr(error, "strerror", None) or "it is no address"
        reason = f"cannot listen on {address}: {why}"
        raise InputError("display", reason, advice) from error


def _is_loopback(host: str) -> bool:
    """Return True for an address that no other machine can reach."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _address_in_network() -> str:
    """Return the address by which this machine reaches others."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # An address of no machine (RFC 5737): nothing is sent, only the route is asked.
            probe.connect(("192.0.2.1", 9))
        except OSError as error:
            raise InputError("display", "no network is connected", "name an address") from error
        return str(probe.getsockname()[0])


@contextmanager
def display_beside(
    folder: Path, host: str | None, operator: str, control: bool
) -> Iterator[Served | None]:
    """Serve the display of a folder's recorder from a separate process, until the block ends.

    It ends also if this process is killed, since it watches its stdin.  `host`: as of `listen_on`;
    if it is None, no display is served and None is yielded.  Raises InputError if it cannot be
    served, or `control` is requested without a display.
    """
    if host is None:
        if control:
            raise InputError("--control", "needs a display", "add --display lan")
        yield None
        return
    listen_on(host)[1].close()
    with group_readable():
        folder.mkdir(parents=True, exist_ok=True)  # the terminal's recorder is started only later
    options = ["--display", host, "--operator", operator, *(["--control"] if control else [])]
    command = [sys.executable, "-m", "tui", "display", str(folder.resolve()), "--json", *options]
    pipe = subprocess.PIPE
    with (
        TemporaryFile("w+") as errors,  # not a pipe, which fills up if it is not read
        subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=errors, text=True) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            if not (document := process.stdout.readline()):
                errors.seek(0)
                lines = errors.read().strip().splitlines() or ["it did not start"]
                raise InputError("display", lines[-1], "start it alone: bumpbench display")
            yield Served(**json.loads(document))
        finally:
            process.stdin.close()
            try:
                process.wait(2.0)  # s; it takes 0.1
            except subprocess.TimeoutExpired:
                process.kill()
