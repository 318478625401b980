"""Bus logs of any kind that python-can reads (BLF, ASC, TRC, candump, CSV, ...), in blocks."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import can

from dbc.frames import FrameBatch

from ..columns import frame_columns
from ..errors import InputError

BLOCK_FRAMES = 8192


def read_log(path: Path) -> Iterator[FrameBatch]:
    """Read a log block by block; memory does not grow with its length.

    Parameters
    ----------
    path : Path
        Its suffix tells the format.

    Yields
    ------
    FrameBatch
        At most `BLOCK_FRAMES` frames, time stamps as in the log; bus 0.

    Raises
    ------
    InputError
        If the file cannot be opened, is of no known format, or breaks off in a way that its reader
        cannot bridge.
    """
    where = str(path)
    formats = ", ".join(sorted(suffix for suffix in can.io.MESSAGE_READERS if suffix != ".mf4"))
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "no such file"
        raise InputError(where, what, f"name a log: {formats}")
    if path.suffix.lower() not in can.io.MESSAGE_READERS:
        raise InputError(where, f"{path.suffix or 'no suffix'} is no log format", f"use {formats}")
    try:
        reader = can.LogReader(path)
    except Exception as error:  # each reader raises what it likes
        raise InputError(where, f"cannot be read: {_reason(error)}", "check its format") from error
    with reader:
        messages = iter(reader)
        while True:
            try:
                block = list(islice(messages, BLOCK_FRAMES))
            except Exception as error:
                advice = "the log is damaged from there on, or is of another format"
                raise InputError(where, f"cannot be read: {_reason(error)}", advice) from error
            if not block:
                return
            stamps_ns = [round(message.timestamp * 1e9) for message in block]
            yield frame_columns(block, stamps_ns, 0)[0]


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
