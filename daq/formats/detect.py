"""Detects the format of a log from its content; its name decides between equal candidates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dbc.errors import InputError, printable

from . import asc, blf, can_csv, candump, mf4, trc
from .source import Ledger, Unpacked
from .text import Parse, without_zeros

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
MF4 = LogFormat("MF4", mf4.LACKS, ".mf4")
JOURNAL = LogFormat("MCAP journal", "", ".mcap")
TEXTS = (
    LogFormat("candump", candump.LACKS, ".log", lambda: candump.parse_candump, False, False),
    LogFormat("ASC", asc.LACKS, ".asc", asc.AscParser),
    LogFormat("CSV of python-can", can_csv.LACKS, ".csv", lambda: can_csv.parse_csv, True, False),
    LogFormat("TRC", trc.LACKS, ".trc", trc.TrcParser),
)
NAMES = "BLF, ASC, TRC, candump -L, CSV of python-can, MF4, journal; packed with gzip or not"
"""Names of the formats, for messages."""
_MAGIC = {b"LOGG": BLF, b"MDF     ": MF4, b"UnFinMF ": MF4, b"\x89MCAP0\r\n": JOURNAL}


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
    for magic, form in _MAGIC.items():
        if head.startswith(magic):
            return form
    return _text(head, path)


def _text(head: bytes, path: Path) -> LogFormat:
    """Return the format whose parser reads most of the first lines."""
    where = str(path)
    text, _, _ = without_zeros(head)
    whole, newline, tail = text.rpartition(b"\n")
    block = whole + newline if newline else tail
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    best, most = None, 0.0
    for form in TEXTS:
        assert form.parser is not None
        parsed = form.parser()(block)
        score = len(parsed.frames) + 0.5 * parsed.header
        if len(parsed.bad) > score:
            continue
        score += 0.25 * (score > 0 and suffixes[-1:] == [form.suffix])
        if score > most:
            best, most = form, score
    if best is None:
        first = next((line for line in block.splitlines() if line.strip()), b"")
        shown = printable(first.strip().decode("ascii", "backslashreplace"), 40)
        raise InputError(where, f"begins with no line of a known log: {shown!r}", f"use {NAMES}")
    return best
