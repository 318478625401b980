"""Reads CAN bus logging in MF4 (ASAM MDF 4) with asammdf, in order of time."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import InputError, counted, printable

from .reader import LATEST_NS, LONGEST_NS, LogLoss, optional, possible_frames

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
"""Number of frames that are read together."""


@dataclass(frozen=True, slots=True)
class _Group:
    """The frames of one kind in a group of records."""

    number: int
    kind: str
    fields: dict[str, int]
    """Number of the channel of each field."""
    time_s: NDArray[np.float64]
    """Time of each record since the start of the file, s."""


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
    raise InputError(where, what, "the file is damaged or cut off")


def read_mf4(file: BinaryIO, where: str, loss: LogLoss) -> Iterator[FrameBatch]:
    """Read the CAN frames of an MF4 file block by block, those of all groups in order of time.

    Buses count from 1 in MF4, and from 0 in `FrameBatch`; a file whose first block has a bus 0
    counts from 0.  `where`: its name, for messages.  Raises InputError if it cannot be read, or
    holds no CAN bus logging.
    """
    is_unfinished = file.read(8) == b"UnFinMF "
    file.seek(0)
    # The library writes to an unfinished file: it gets a copy.
    with open_mdf(BytesIO(file.read()) if is_unfinished else file, where) as mdf:
        groups = list(_bus_logging(mdf, where, loss))
        if not groups:
            advice = "import decoded channels with --channels"
            raise InputError(where, "holds no CAN bus logging", advice)
        start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
        # A time that goes back does not move the end of a block back.
        rising_s = [np.maximum.accumulate(group.time_s) for group in groups]
        # Times at which blocks end: all groups together have `_BLOCK_FRAMES` records between two.
        ends_s = np.append(np.sort(np.concatenate(rising_s))[_BLOCK_FRAMES::_BLOCK_FRAMES], np.inf)
        begins = [0] * len(groups)  # first record of each group that was not yet read
        lowest_bus: int | None = None
        for end_s in ends_s.tolist():
            batches = []
            for i, group in enumerate(groups):
                end = int(np.searchsorted(rising_s[i], end_s, side="right"))
                if end > begins[i]:
                    batches.append(_frames(mdf, group, slice(begins[i], end), start_ns, loss))
                    begins[i] = end
            block = FrameBatch.concatenate(batches)
            block = possible_frames(block.by_time() if len(batches) > 1 else block, loss)
            if lowest_bus is None and len(block):
                lowest_bus = int(block.bus.min())
            yield block if lowest_bus == 0 else replace(block, bus=np.maximum(block.bus, 1) - 1)


def _bus_logging(mdf: Any, where: str, loss: LogLoss) -> Iterator[_Group]:
    """Yield the groups of CAN frames; a channel is named by kind and field: `CAN_DataFrame.ID`."""
    for number, group in enumerate(mdf.groups):
        names = [str(channel.name) for channel in group.channels]
        for kind in _KINDS:
            fields = {
                name.rpartition(".")[2]: index
                for index, name in enumerate(names)
                if name.startswith(f"{kind}.")
            }
            stated_records = int(group.channel_group.cycles_nr)
            if "ID" not in fields or not stated_records:
                continue
            with redirect_stdout(StringIO()):
                time_s = np.asarray(mdf.get_master(number), np.float64)
            if missing := max(stated_records - len(time_s), 0):
                loss.add(f"{counted(missing, 'record')} of {kind} missing", garbled=missing)
            if kind == "CAN_DataFrame" and "DataBytes" not in fields:
                what = f"its {kind} has no DataBytes"
                raise InputError(where, what, "write the payload with the logger")
            yield _Group(number, kind, fields, time_s)


def _frames(mdf: Any, group: _Group, rows: slice, start_ns: int, loss: LogLoss) -> FrameBatch:
    """Return the frames in records; records that cannot be frames are left out and counted."""
    n = rows.stop - rows.start
    fields: dict[str, NDArray[np.int64]] = {}
    for name in {"ID", "DLC", "DataLength", "BusChannel", *_BITS} & group.fields.keys():
        values = _samples(mdf, group, name, rows, raw=False)
        if values.dtype.kind not in "iufb" or values.ndim != 1:  # words, such as Rx and Tx
            values = _samples(mdf, group, name, rows, raw=True)
        fields[name] = values.astype(np.int64)
    can_id = fields["ID"] & 0x1FFF_FFFF
    flags = _flags(group.kind, fields)
    is_fd, is_remote = flags & FrameFlag.FD != 0, flags & FrameFlag.REMOTE != 0
    payload = np.zeros((n, 0), np.uint8)
    if "DataBytes" in group.fields and not _KINDS[group.kind] & FrameFlag.REMOTE:
        payload = _samples(mdf, group, "DataBytes", rows, raw=True)
        if payload.dtype != np.uint8 or payload.ndim != 2:
            payload = np.frombuffer(payload.tobytes(), np.uint8).reshape(n, -1)
    size = np.full(n, payload.shape[1])
    if "DLC" in fields:
        dlc = fields["DLC"].clip(0, 15)
        size = np.where(is_fd, FD_LENGTHS[dlc], np.minimum(dlc, 8)).astype(np.int64)
    size = fields.get("DataLength", size)
    # The length of a remote frame is the one that it requests; it has no data.
    length = np.where(is_remote, np.minimum(fields.get("DLC", size), 8), size)
    since_start_ns = group.time_s[rows] * 1e9
    is_timed = np.isfinite(since_start_ns) & (np.abs(since_start_ns) < LONGEST_NS)
    t_ns = start_ns + np.rint(np.where(is_timed, since_start_ns, 0.0)).astype(np.int64)
    is_frame = is_timed & (t_ns < LATEST_NS) & (length >= 0) & (length <= np.where(is_fd, 64, 8))
    if garbled := n - int(is_frame.sum()):
        many = f"records of {group.kind} are not frames"
        one = f"record of {group.kind} is not a frame"
        loss.add(counted(garbled, one, many), garbled=garbled)
    width = 8 if length.max(initial=0) <= 8 else 64
    data = np.zeros((n, width), np.uint8)
    data[:, : payload.shape[1]] = payload[:, :width]
    data[np.arange(width) >= np.where(is_remote, 0, length)[:, None]] = 0
    bus = fields.get("BusChannel", np.zeros(n, np.int64)).clip(0, 255)
    lengths, buses = length.clip(0, 64).astype(np.uint8), bus.astype(np.uint8)
    return FrameBatch(t_ns, can_id.astype(np.uint32), flags, buses, lengths, data).select(is_frame)


def _samples(mdf: Any, group: _Group, name: str, rows: slice, *, raw: bool) -> NDArray[Any]:
    """Return a field of records; `raw`: as it is stored."""
    selection = {"group": group.number, "index": group.fields[name], "raw": raw}
    selection |= {"record_offset": rows.start, "record_count": rows.stop - rows.start}
    with redirect_stdout(StringIO()):  # it prints what it does not understand
        columns = mdf.get(**selection, samples_only=True, ignore_invalidation_bits=True)
    return np.asarray(columns[0])


def _flags(kind: str, fields: Mapping[str, NDArray[np.int64]]) -> NDArray[np.uint16]:
    """Return the flags; without a field IDE, bit 31 or the size of an identifier shows 29 bits."""
    identifier = fields["ID"]
    flags = np.full(len(identifier), _KINDS[kind], np.uint16)
    is_set = {bit: fields[field] != 0 for field, bit in _BITS.items() if field in fields}
    if "IDE" not in fields:
        is_long = identifier & 0x1FFF_FFFF >= 1 << 11
        is_set[FrameFlag.EXTENDED] = (identifier >> 31 & 1 != 0) | is_long
    for bit, rows in is_set.items():
        flags[rows] |= np.uint16(bit)
    return flags
