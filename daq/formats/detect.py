"""Detects the format of a log from its content; its name decides between equal candidates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dbc.errors import InputError, printable

from . import (
    asc,
    blf,
    busmaster,
    can_csv,
    candump,
    candump_console,
    capture,
    crtd,
    gvret,
    mf4_log,
    ros2_mcap,
    trc,
)
from .losses import Ledger
from .text import Parse
from .unpacked import Unpacked

HEAD_BYTES = 1 << 16
"""Number of bytes that are examined: the head of a text log is shorter."""


@dataclass(frozen=True, slots=True)
class LogFormat:
    """A format of logs."""

    name: str
    """Name, for people."""
    lacks: str
    """Parts of a frame that it cannot hold; empty if it holds everything."""
    suffix: str
    """Usual suffix of its files."""
    parser: Callable[[], Parse] | None = None
    """Function that makes the parser of its lines; None for a format that is not text."""
    states_length: bool = True
    """True if a line states how many bytes follow, so that a cut line cannot look complete."""
    spaced: bool = True
    """True if a byte may lose its last digit unnoticed."""


BLF = LogFormat("BLF", blf.LACKS, ".blf")
MF4 = LogFormat("MF4", mf4_log.LACKS, ".mf4")
JOURNAL = LogFormat("MCAP journal", "", ".mcap")
ROS2 = LogFormat("MCAP of ROS 2", ros2_mcap.LACKS, ".mcap")
PCAP = LogFormat("capture (pcap, pcapng)", capture.LACKS, ".pcap")
TEXTS = (
    LogFormat("candump", candump.LACKS, ".log", lambda: candump.parse_candump, False, False),
    LogFormat("ASC", asc.LACKS, ".asc", asc.AscParser),
    LogFormat("CSV of python-can", can_csv.LACKS, ".csv", lambda: can_csv.parse_csv, True, False),
    LogFormat("TRC", trc.LACKS, ".trc", trc.TrcParser),
    LogFormat("CSV of SavvyCAN", gvret.LACKS, ".csv", lambda: gvret.parse_gvret),
    LogFormat("candump screen", candump_console.LACKS, ".txt", candump_console.ConsoleParser),
    LogFormat("BUSMASTER", busmaster.LACKS, ".log", busmaster.BusmasterParser),
    LogFormat("CRTD", crtd.LACKS, ".crtd", lambda: crtd.parse_crtd, False),
)
NAMES = (
    "BLF, ASC, TRC, candump, CSV of python-can or SavvyCAN, BUSMASTER, CRTD, MF4, pcap, MCAP; .gz"
)
"""Names of the formats, for messages."""


def detect(path: Path) -> LogFormat:
    """Return the format of a log.

    Raises InputError if the file is missing, empty or not a known log.
    """
    where = str(path)
    if not path.is_file():
        other = "is a directory" if path.is_dir() else "is not a regular file"
        what = other if path.exists() else "no such file"
        raise InputError(where, what, f"name a log: {NAMES}")
    try:
        with path.open("rb") as file:
            head = Unpacked(file, Ledger()).read(HEAD_BYTES)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError(where, what, "check rights and disk") from error
    if not head:
        raise InputError(where, "is empty", "check that it is the right log")
    return _binary(head) or _text(head, path)


def _binary(head: bytes) -> LogFormat | None:
    if head[:4] == b"LOGG":
        return BLF
    if head[:8] in (b"MDF     ", b"UnFinMF "):
        return MF4
    if head[: len(ros2_mcap.MAGIC)] == ros2_mcap.MAGIC:
        return ROS2 if ros2_mcap.profile_of(head) == "ros2" else JOURNAL
    if head[:4] in capture.PCAP_MAGIC or head[:4] == capture.PCAPNG_MAGIC:
        return PCAP
    return None


def _text(head: bytes, path: Path) -> LogFormat:
    """Return the format whose parser reads most of the first lines."""
    where = str(path)
    if b"\0" in head:
        raise InputError(where, "is not a log of a known format", f"use {NAMES}")
    whole, newline, tail = head.rpartition(b"\n")
    block = whole + newline if newline else tail
    if len(block) >= HEAD_BYTES and not newline:
        raise InputError(where, "is not a text log: its first line has no end", f"use {NAMES}")
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    best, most = None, 0.0
    for form in TEXTS:
        assert form.parser is not None
        parsed = form.parser()(block)
        found = len(parsed.frames) + 0.5 * parsed.header
        if len(parsed.bad) > found:
            continue
        found += 0.25 * (found > 0 and suffixes[-1:] == [form.suffix])
        if found > most:
            best, most = form, found
    if best is None:
        first = next((line for line in block.splitlines() if line.strip()), b"")
        if candump_console.UNTIMED.match(first):
            raise InputError(where, "has no time stamps", "record with candump -L")
        shown = printable(first.strip().decode("ascii", "backslashreplace"), 40)
        raise InputError(where, f"begins with no line of a known log: {shown!r}", f"use {NAMES}")
    return best
