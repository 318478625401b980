"""Reads bus logging in MF4 (ASAM MDF 4), finished or unfinished, in order of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from heapq import heapify, heappop, heappush
from itertools import count
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import counted

from .assemble import count_impossible_ids, good_frames, interleaved
from .losses import Ledger
from .mdf4_blocks import BlockFile
from .mdf4_layout import DataGroup, data_groups, start_ns
from .mdf4_records import RecordBlock, mixed_records, sorted_records

LACKS = ""
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
_LATEST_S = 4e9
"""Longest time since the start of a file, s: more than a century does not fit into the stamps."""


def read_mf4(file: BinaryIO, where: str, ledger: Ledger) -> Iterator[FrameBatch]:
    """Read the CAN frames of an MF4 file block by block.

    Records may be in any order; missing counts and lengths are found from the file itself.  Buses
    count from 1 in MF4, and from 0 in `FrameBatch`; a file whose first block has a bus 0 counts
    from 0.

    `file`: an open file.  `where`: its name, for messages.  `ledger`: collects the losses.  Raises
    InputError if it is not an MF4, cannot be read, or holds no CAN bus logging.
    """
    blocks = BlockFile(file, where, ledger)
    first_ns = start_ns(blocks)
    streams = [_frames_of(blocks, group, first_ns, ledger) for group in data_groups(blocks)]
    if not streams:
        advice = "import decoded channels with --channels"
        raise InputError(where, "holds no CAN bus logging", advice)
    lowest: int | None = None
    for batch in streams[0] if len(streams) == 1 else merged(streams):
        if lowest is None and len(batch):
            lowest = int(batch.bus.min())
        yield replace(batch, bus=np.maximum(batch.bus, 1) - 1) if lowest else batch


def _frames_of(
    file: BlockFile, data: DataGroup, start_ns: int, ledger: Ledger
) -> Iterator[FrameBatch]:
    """Yield the frames of a data group; frames of several kinds in the order of their records."""
    if not data.id_bytes:
        for block in sorted_records(file, data, ledger):
            yield _frames(block, start_ns, ledger)[0]
        return
    for mixed in mixed_records(file, data, ledger):
        batches, orders = [], []
        for block in mixed:
            frames, good = _frames(block, start_ns, ledger)
            batches.append(frames)
            orders.append(block.order[good])
        yield interleaved(batches, orders)


def _frames(
    block: RecordBlock, start_ns: int, ledger: Ledger
) -> tuple[FrameBatch, NDArray[np.bool_]]:
    """Return the frames in records, and a mask of the records that are frames."""
    records, group = block.records, block.group
    n = len(records)
    fields = {name: field.whole(records) for name, field in group.fields.items()}
    nothing = np.zeros(n, np.int64)
    raw_id = fields.get("ID", nothing)
    flags = np.full(n, _KINDS[group.kind], np.uint16)
    for field, bit in _BITS.items():
        if field in fields:
            flags |= (fields[field] != 0) * np.uint16(bit)
    can_id = raw_id & 0x1FFF_FFFF
    if "IDE" not in fields:
        extended = (raw_id >> 31 & 1 != 0) | (can_id >= 1 << 11)
        flags |= extended * np.uint16(FrameFlag.EXTENDED)
    fd = flags & FrameFlag.FD != 0
    remote = flags & FrameFlag.REMOTE != 0
    code = fields.get("DLC", nothing).clip(0, 15)
    size = fields.get("DataLength", np.where(fd, FD_LENGTHS[code], np.minimum(code, 8)))
    length = np.where(remote, np.minimum(fields.get("DLC", size), 8), size)
    t_ns, timed = _stamps(block, start_ns)
    good = block.found & timed & (length >= 0) & (length <= np.where(fd, 64, 8))
    if bad := n - int(good.sum()):
        many = f"records of {group.kind} are not frames"
        ledger.garbled(bad, counted(bad, f"record of {group.kind} is not a frame", many))
    long = flags & (FrameFlag.EXTENDED | FrameFlag.ERROR) != 0
    good &= count_impossible_ids(can_id, long, t_ns, good, ledger)
    shown = np.where(remote, 0, length)
    bus = fields.get("BusChannel", nothing).clip(0, 255)
    data = _payload(block, shown)
    return good_frames(good, t_ns, can_id, flags, bus, length, data), good


def _stamps(block: RecordBlock, start_ns: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return time stamps in ns since 1970 UTC, and a mask of possible ones."""
    time = block.group.time
    raw = time.raw(block.records)
    with np.errstate(invalid="ignore", over="ignore"):
        since_ns = raw * (time.factor * 1e9) + time.offset * 1e9
    good = np.isfinite(since_ns) & (np.abs(since_ns) < _LATEST_S * 1e9)
    return start_ns + np.rint(np.where(good, since_ns, 0.0)).astype(np.int64), good


def _payload(block: RecordBlock, length: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the bytes of the frames, padded with zeros, (n, 8) or (n, 64)."""
    width = 8 if length.max(initial=0) <= 8 else 64
    data = np.zeros((len(length), width), np.uint8)
    place = block.group.payload
    if block.payload is not None:
        data[:] = block.payload[:, :width]
    elif place is not None:
        given = block.records[:, place.byte : place.byte + min(place.width, width)]
        data[:, : given.shape[1]] = given
    data[np.arange(width) >= length[:, None]] = 0
    return data


def merged(streams: list[Iterator[FrameBatch]]) -> Iterator[FrameBatch]:
    """Merge streams that are each in order of time; one block of each is held at a time.

    Frames are returned up to the earliest end of the held blocks, because after it another stream
    may still have earlier frames.
    """
    order = count()  # breaks ties, because batches cannot be compared
    held = [(int(b.t_ns[-1]), next(order), b, s) for s in streams for b in _next(s)]
    heapify(held)
    while held:
        end_ns, _, batch, stream = heappop(held)
        ready, rest = [batch], []
        for other_end_ns, number, other, source in held:
            cut = int(np.searchsorted(other.t_ns, end_ns, side="right"))
            ready.append(other.select(slice(cut)))
            rest.append((other_end_ns, number, other.select(slice(cut, None)), source))
        held = rest  # each keeps its end, so it is still a heap
        for following in _next(stream):
            heappush(held, (int(following.t_ns[-1]), next(order), following, stream))
        block = FrameBatch.concatenate(ready)
        yield block.by_time()


def _next(stream: Iterator[FrameBatch]) -> list[FrameBatch]:
    """Return the next non-empty block in a list; an empty list at the end."""
    return next(([batch] for batch in stream if len(batch)), [])
