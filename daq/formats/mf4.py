"""Reads CAN bus logging in MF4 (ASAM MDF 4) with asammdf, in order of time."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError, printable
from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import counted

from ..optional import optional
from .assemble import count_impossible_ids, good_frames
from .source import Ledger, Unpacked
from .text import possible_times

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
_BLOCK_FRAMES = 1 << 18
_DAMAGED = "the file is damaged or cut off"
_MAX_UNPACKED_BYTES = 4 << 30


@dataclass(frozen=True, slots=True)
class _Group:
    """The frames of one kind in a group of records."""

    number: int
    kind: str
    fields: dict[str, int]
    """Number of the channel of each field."""
    time_s: NDArray[np.float64]


def read_mf4(
    file: BinaryIO, unpacked: Unpacked, where: str, ledger: Ledger
) -> Iterator[FrameBatch]:
    """Read the CAN frames of an MF4 file block by block.

    Buses count from 1 in MF4, and from 0 in `FrameBatch`; a file whose first block has a bus 0
    counts from 0.  `unpacked`: the file as it is to be read.  `where`: its name, for messages.
    Raises InputError if it cannot be read, or holds no CAN bus logging.
    """
    content: BinaryIO = file
    unfinished = file.read(8) == b"UnFinMF "  # the library writes what its logger did not
    file.seek(0)
    if unpacked.packed or unfinished:
        content = BytesIO(unpacked.read(_MAX_UNPACKED_BYTES))
    with open_mdf(content, where) as mdf:
        yield from _blocks(mdf, where, ledger)


@contextmanager
def open_mdf(file: Path | BinaryIO, where: str) -> Iterator[Any]:
    """Open an MDF file with asammdf, to be used in a `with` statement.

    Raises InputError for whatever the library raises on a damaged file.
    """
    asammdf = optional("asammdf", "mf4")
    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)
    try:
        with redirect_stdout(StringIO()):
            mdf = asammdf.MDF(file)
        with mdf:
            yield mdf
        return
    except (InputError, GeneratorExit):
        raise
    except Exception as error:
        lines = str(error).splitlines() or [type(error).__name__]
        what = f"cannot be read: {printable(lines[0], 200)}"
    # The library's incomplete object fails again when it is deleted, with a traceback on stderr.
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    gc.collect()
    sys.unraisablehook = hook
    raise InputError(where, what, _DAMAGED)


def _blocks(mdf: Any, where: str, ledger: Ledger) -> Iterator[FrameBatch]:
    groups = list(_bus_logging(mdf, where, ledger))
    if not groups:
        advice = "import decoded channels with --channels"
        raise InputError(where, "holds no CAN bus logging", advice)
    start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
    rising = [np.maximum.accumulate(group.time_s) for group in groups]
    ends = np.append(np.sort(np.concatenate(rising))[_BLOCK_FRAMES::_BLOCK_FRAMES], np.inf)
    begins, lowest = [0] * len(groups), 1
    for number, end_s in enumerate(ends.tolist()):
        batches, order = [], []
        for i, group in enumerate(groups):
            end = int(np.searchsorted(rising[i], end_s, side="right"))
            if end > begins[i]:
                frames, good = _frames(mdf, group, slice(begins[i], end), start_ns, ledger)
                batches.append(frames)
                order.append(rising[i][begins[i] : end][good])
                begins[i] = end
        block = FrameBatch.concatenate(batches)
        if len(batches) > 1:
            block = block.select(np.argsort(np.concatenate(order), kind="stable"))
        if number == 0 and len(block):
            lowest = int(block.bus.min())
        yield replace(block, bus=np.maximum(block.bus, 1) - 1) if lowest else block


def _bus_logging(mdf: Any, where: str, ledger: Ledger) -> Iterator[_Group]:
    for number, group in enumerate(mdf.groups):
        names = [str(channel.name) for channel in group.channels]
        for kind in _KINDS:
            fields = {
                name.rpartition(".")[2]: index
                for index, name in enumerate(names)
                if name.startswith(f"{kind}.")
            }
            stated = int(group.channel_group.cycles_nr)
            if "ID" not in fields or not stated:
                continue
            time_s = np.asarray(mdf.get_master(number), np.float64)
            if len(time_s) < stated:
                missing = stated - len(time_s)
                ledger.garbled(missing, f"{counted(missing, 'record')} of {kind} missing")
            if kind == "CAN_DataFrame" and "DataBytes" not in fields:
                what = f"its {kind} has no DataBytes"
                raise InputError(where, what, "write the payload with the logger")
            yield _Group(number, kind, fields, time_s)


def _frames(
    mdf: Any, group: _Group, rows: slice, start_ns: int, ledger: Ledger
) -> tuple[FrameBatch, NDArray[np.bool_]]:
    """Return the frames in records, and a mask of the records that are frames."""
    n = rows.stop - rows.start
    fields = {
        name: _values(mdf, group, index, rows)
        for name, index in group.fields.items()
        if name in {"ID", "DLC", "DataLength", "BusChannel", *_BITS}
    }
    nothing = np.zeros(n, np.int64)
    raw_id = fields["ID"]
    flags = np.full(n, _KINDS[group.kind], np.uint16)
    for field, bit in _BITS.items():
        if field in fields:
            flags |= (fields[field] != 0) * np.uint16(bit)
    can_id = raw_id & 0x1FFF_FFFF
    if "IDE" not in fields:
        extended = (raw_id >> 31 & 1 != 0) | (can_id >= 1 << 11)
        flags |= extended * np.uint16(FrameFlag.EXTENDED)
    payload = np.zeros((n, 0), np.uint8)
    if "DataBytes" in group.fields and not _KINDS[group.kind] & FrameFlag.REMOTE:
        payload = _payload(mdf, group, rows)
    fd = flags & FrameFlag.FD != 0
    remote = flags & FrameFlag.REMOTE != 0
    if "DLC" in fields:
        code = fields["DLC"].clip(0, 15)
        size = np.where(fd, FD_LENGTHS[code], np.minimum(code, 8)).astype(np.int64)
    else:
        size = np.full(n, payload.shape[1])
    size = fields.get("DataLength", size)
    length = np.where(remote, np.minimum(fields.get("DLC", size), 8), size)
    since_ns = group.time_s[rows] * 1e9
    timed = np.isfinite(since_ns) & (np.abs(since_ns) < 1e18)
    t_ns = start_ns + np.rint(np.where(timed, since_ns, 0.0)).astype(np.int64)
    good = timed & possible_times(t_ns) & (length >= 0) & (length <= np.where(fd, 64, 8))
    if bad := n - int(good.sum()):
        many = f"records of {group.kind} are not frames"
        ledger.garbled(bad, counted(bad, f"record of {group.kind} is not a frame", many))
    long = flags & (FrameFlag.EXTENDED | FrameFlag.ERROR) != 0
    good &= count_impossible_ids(can_id, long, t_ns, good, ledger)
    width = 8 if length.max(initial=0) <= 8 else 64
    data = np.zeros((n, width), np.uint8)
    data[:, : payload.shape[1]] = payload[:, :width]
    data[np.arange(width) >= np.where(remote, 0, length)[:, None]] = 0
    bus = fields.get("BusChannel", nothing).clip(0, 255)
    return good_frames(good, t_ns, can_id, flags, bus, length, data), good


def _values(mdf: Any, group: _Group, index: int, rows: slice) -> NDArray[np.int64]:
    """Return a field as whole numbers; one that is converted to words (Rx, Tx) as it is stored."""
    for raw in (False, True):
        values = np.asarray(_samples(mdf, group, index, rows, raw))
        if values.dtype.kind in "iufb" and values.ndim == 1:
            break
    return values.astype(np.int64)


def _payload(mdf: Any, group: _Group, rows: slice) -> NDArray[np.uint8]:
    """Return the payloads, padded with zeros, shape (n, longest)."""
    stored = np.asarray(_samples(mdf, group, group.fields["DataBytes"], rows, True))
    if stored.dtype == np.uint8 and stored.ndim == 2:
        return stored
    n = rows.stop - rows.start
    return np.frombuffer(stored.tobytes(), np.uint8).reshape(n, -1)


def _samples(mdf: Any, group: _Group, index: int, rows: slice, raw: bool) -> Any:
    return mdf.get(
        group=group.number,
        index=index,
        raw=raw,
        samples_only=True,
        ignore_invalidation_bits=True,
        record_offset=rows.start,
        record_count=rows.stop - rows.start,
    )[0]
