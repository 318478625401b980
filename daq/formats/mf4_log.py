"""Bus logging in MF4 (ASAM MDF 4), read in bulk by asammdf and put in order of time."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from heapq import heapify, heappop, heappush
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from dbc.frames import FrameBatch, FrameFlag

from .assemble import good_frames
from .losses import Ledger

LACKS = ""
_HEADER_AT = 64
_MAGIC = (b"MDF     ", b"UnFinMF ")
_KINDS = {
    "CAN_DataFrame": np.uint16(0),
    "CAN_RemoteFrame": np.uint16(FrameFlag.REMOTE),
    "CAN_ErrorFrame": np.uint16(FrameFlag.ERROR),
}
_BITS = {
    "IDE": FrameFlag.EXTENDED,
    "EDL": FrameFlag.FD,
    "BRS": FrameFlag.BITRATE_SWITCH,
    "ESI": FrameFlag.ERROR_STATE,
    "Dir": FrameFlag.TRANSMITTED,
}
BLOCK_FRAMES = 65_536


def read_mf4(path: Path, ledger: Ledger) -> Iterator[FrameBatch]:
    """Read the CAN frames of an MF4 file block by block.

    `ledger` takes the losses.  Raises InputError if it is no MF4, cannot be read, or holds no CAN
    bus logging; or asammdf is missing.
    """
    where = str(path)
    with path.open("rb") as file:
        begin = file.read(_HEADER_AT + 4)
    if begin[:8] not in _MAGIC:
        advice = "check what it is; its suffix may be wrong"
        raise InputError(where, "is no MF4: it does not begin with MDF", advice)
    if begin[_HEADER_AT:] != b"##HD":
        raise InputError(where, "is no MF4: it has no header block", "get the whole file")
    try:
        from asammdf import MDF
    except ImportError as error:
        advice = "install it: pip install 'bumpbench[mf4]'"
        raise InputError(where, "MF4 needs asammdf, which is not installed", advice) from error
    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)  # it logs what it also raises
    hook, failure = sys.unraisablehook, ""
    try:
        with path.open("rb") as stream, MDF(stream) as mdf:
            groups: list[Any] = list(mdf.groups)
            streams = [
                _blocks(mdf, number, name, ledger)
                for number, group in enumerate(groups)
                for name in _KINDS
                if group.channel_group.cycles_nr and any(c.name == name for c in group.channels)
            ]
            if not streams:
                advice = "channels that were decoded already cannot be imported as frames"
                raise InputError(where, "holds no CAN bus logging", advice)
            yield from merged(streams)
    except InputError:
        raise
    except Exception as error:  # asammdf raises what it stumbles over
        failure = str(error) or type(error).__name__
        # Its half-made object fails once more when it is let go, with a traceback on stderr.
        sys.unraisablehook = lambda _: None
    if failure:
        gc.collect()
        sys.unraisablehook = hook
        what = f"cannot be read: {failure}"
        raise InputError(where, what, "the file is damaged or cut off")


def _blocks(mdf: Any, group: int, name: str, ledger: Ledger) -> Iterator[FrameBatch]:
    start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
    for signal in mdf.iter_get(name, group):
        for first in range(0, len(signal.timestamps), BLOCK_FRAMES):
            rows = slice(first, first + BLOCK_FRAMES)
            yield _frames(signal.samples[rows], signal.timestamps[rows], name, start_ns, ledger)


def _frames(
    samples: NDArray[Any], time_s: NDArray[np.float64], name: str, start_ns: int, ledger: Ledger
) -> FrameBatch:
    n = len(time_s)
    fields = {field.removeprefix(f"{name}."): samples[field] for field in samples.dtype.names or ()}
    raw_id = fields["ID"].astype(np.int64) if "ID" in fields else np.zeros(n, np.int64)
    flags = np.full(n, _KINDS[name], np.uint16)
    for field, bit in _BITS.items():
        if field in fields:
            flags |= _mark(fields[field]) * np.uint16(bit)
    if "IDE" not in fields:
        flags |= (raw_id >> 31 & 1).astype(np.uint16) * np.uint16(FrameFlag.EXTENDED)
    can_id = raw_id & 0x1FFF_FFFF
    fd = flags & FrameFlag.FD != 0
    remote = flags & FrameFlag.REMOTE != 0
    size = fields.get("DataLength", np.zeros(n, np.uint8)).astype(np.int64)
    asked = np.minimum(fields.get("DLC", size).astype(np.int64), 8)
    length = np.where(remote, asked, size)
    good = (length <= np.where(fd, 64, 8)) & (
        can_id < np.where(flags & (FrameFlag.EXTENDED | FrameFlag.ERROR) != 0, 1 << 29, 1 << 11)
    )
    width = 8 if length.max(initial=0) <= 8 else 64
    data = np.zeros((n, width), np.uint8)
    if "DataBytes" in fields:
        given = fields["DataBytes"].reshape(n, -1)[:, :width]
        data[:, : given.shape[1]] = given
    data[np.arange(width) >= np.where(remote, 0, length)[:, None]] = 0
    bus = fields.get("BusChannel", np.zeros(n, np.uint8))
    t_ns = start_ns + np.rint(time_s * 1e9).astype(np.int64)
    if bad := n - int(good.sum()):
        ledger.garbled(bad, f"{bad} records of {name} are no frames")
    return good_frames(good, t_ns, can_id, flags, bus, length, data)


def _mark(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return a bit that may be written as a number or as a word (Rx, Tx)."""
    return np.asarray(np.char.lower(values) == b"tx" if values.dtype.kind == "S" else values != 0)


def merged(streams: list[Iterator[FrameBatch]]) -> Iterator[FrameBatch]:
    """Merge streams that are each in order of time; one block of each is held at a time.

    What is handed out reaches up to the earliest end of the blocks that are held: beyond it,
    another stream may still have earlier frames.
    """
    order = count()  # ties are broken by it: batches cannot be compared
    held = [(int(b.t_ns[-1]), next(order), b, s) for s in streams for b in _next(s)]
    heapify(held)
    while held:
        end_ns, _, batch, stream = heappop(held)
        ready, rest = [batch], []
        for other_end_ns, number, other, source in held:
            cut = int(np.searchsorted(other.t_ns, end_ns, side="right"))
            ready.append(other.select(slice(cut)))
            rest.append((other_end_ns, number, other.select(slice(cut, None)), source))
        held = rest  # each keeps its end, so it is a heap as before
        for following in _next(stream):
            heappush(held, (int(following.t_ns[-1]), next(order), following, stream))
        block = FrameBatch.concatenate(ready)
        yield block.select(np.argsort(block.t_ns, kind="stable"))


def _next(stream: Iterator[FrameBatch]) -> list[FrameBatch]:
    """Return the next block that holds anything, in a list; an empty one at the end."""
    return next(([batch] for batch in stream if len(batch)), [])
