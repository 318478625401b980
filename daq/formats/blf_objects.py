"""Finds the objects in a BLF container by their chain, and converts them to frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import counted

from .assemble import count_impossible_ids, flags_of, good_frames, interleaved, records_at
from .source import Ledger
from .text import LATEST_NS, LONGEST_NS, Index, Mask

MAX_OBJECT_BYTES = 1 << 24
HEADER = np.dtype(
    {
        "names": ["header", "version", "size", "kind", "flags", "stamp"],
        "formats": ["<u2", "<u2", "<u4", "<u4", "<u4", "<u8"],
        "offsets": [4, 6, 8, 12, 16, 24],
        "itemsize": 32,
    }
)
_GAP = 8
"""Limit of the padding after an object, bytes: it is shorter."""
_TEN_US = 1


def _layout(size: int, **fields: tuple[str, int]) -> np.dtype[np.void]:
    return np.dtype(
        {
            "names": list(fields),
            "formats": [form for form, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": size,
        }
    )


_CLASSIC = _layout(16, bus=("<u2", 0), flags=("u1", 2), dlc=("u1", 3), can_id=("<u4", 4))
_ERROR_EXT = _layout(32, bus=("<u2", 0), dlc=("u1", 10), can_id=("<u4", 16))
_ERROR = _layout(4, bus=("<u2", 0))
_FD = _layout(
    84,
    bus=("<u2", 0),
    flags=("u1", 2),
    dlc=("u1", 3),
    can_id=("<u4", 4),
    fd=("u1", 13),
    valid=("u1", 14),
)
_FD_64 = _layout(
    40,
    bus=("u1", 0),
    dlc=("u1", 1),
    valid=("u1", 2),
    can_id=("<u4", 4),
    flags=("<u4", 12),
    direction=("u1", 34),
    extra=("u1", 35),
)
_LOST_EVENTS = 126
_LOST = _layout(16, count=("<u4", 12))
_FD_ERROR_64 = _layout(4, bus=("u1", 0))


def find_objects(data: bytes, ledger: Ledger) -> tuple[Index, int]:
    """Return the positions of the complete objects in `data`, and the number of bytes processed.

    Each object states its end, where the next one begins, so the mark of an object within a payload
    is not taken as an object.  Data to which no chain leads are counted as lost.
    """
    text = np.frombuffer(data, np.uint8)
    at = np.flatnonzero(text[: max(len(data) - 31, 0)] == ord("L"))
    for place, letter in enumerate(b"LOBJ"):
        at = at[text[at + place] == letter]
    head = records_at(text, at, HEADER)
    size = head["size"].astype(np.int64)
    end = at + size
    possible = (size >= 32) & (size <= MAX_OBJECT_BYTES)
    follows = np.searchsorted(at, end)
    gap = at[np.minimum(follows[:-1], len(at) - 1)] - end[:-1]
    simple = len(at) > 0 and at[0] < _GAP and possible.all()
    if simple and np.array_equal(follows[:-1], np.arange(1, len(at))) and np.all(gap < _GAP):
        chain, lost = np.arange(len(at)), 0
    else:
        chain, lost = _walk(at, end, possible, follows, len(data))
    whole = chain[end[chain] <= len(data)]
    if len(whole) < len(chain):
        used = int(at[chain[-1]])
    elif len(whole):
        used = int(end[whole[-1]])
    else:
        used = 0
    if len(whole) == len(chain) and len(data) - used >= MAX_OBJECT_BYTES:
        lost += len(data) - used - 32
        used = len(data) - 32
    if lost:
        many = "bytes between objects are not objects"
        note = counted(lost, "byte between objects is no object", many)
        ledger.cut(lost, note)
    return at[whole], used


def _walk(at: Index, end: Index, possible: Mask, follows: Index, size: int) -> tuple[Index, int]:
    """Follow the chain object by object; return its members and the number of bytes skipped."""
    chain, lost, expected, i = [], 0, 0, 0
    while i < len(at):
        if not possible[i]:
            i += 1
            continue
        if at[i] - expected >= _GAP:
            lost += int(at[i]) - expected
        chain.append(i)
        if end[i] > size:
            break
        expected, i = int(end[i]), int(follows[i])
    return np.array(chain, np.intp), lost


def frames_of(data: bytes, at: Index, start_ns: int, ledger: Ledger) -> FrameBatch:
    """Return the frames among the objects at `at`, in their order; other objects are ignored."""
    text = np.frombuffer(data, np.uint8)
    head = records_at(text, at, HEADER)
    body = at + np.where(head["version"] == 2, 40, 32)
    room = at + head["size"] - body
    unit = np.where(head["flags"] == _TEN_US, 10_000, 1)
    sane = head["stamp"] < (LONGEST_NS if start_ns else LATEST_NS) // unit
    t_ns = start_ns + np.where(sane, head["stamp"], 0).astype(np.int64) * unit
    places: list[Index] = []
    batches: list[FrameBatch] = []
    for kinds, layout, fill in (
        ((1, 86), _CLASSIC, _classic),
        ((73,), _ERROR_EXT, _error_ext),
        ((2,), _ERROR, _error),
        ((100,), _FD, _fd),
        ((101,), _FD_64, _fd_64),
        ((104,), _FD_ERROR_64, _error),
    ):
        rows = np.flatnonzero(np.isin(head["kind"], kinds))
        if not len(rows):
            continue
        good = (room[rows] >= layout.itemsize) & sane[rows] & (head["version"][rows] <= 2)
        torn = len(rows) - int(good.sum())
        rows = rows[good]
        record = records_at(text, body[rows], layout)
        can_id, flags, length, size, offset = fill(
            record, head["size"][rows].astype(np.intp), body[rows] - at[rows]
        )
        extended = (flags & FrameFlag.EXTENDED) != 0
        long = extended | ((flags & FrameFlag.ERROR) != 0)
        fits = count_impossible_ids(can_id, long, t_ns[rows], np.ones(len(rows), bool), ledger)
        bus = np.maximum(record["bus"].astype(np.int64), 1) - 1
        payload = _payload(text, body[rows] + offset, size, length)
        bus = np.minimum(bus, 255)
        batches.append(good_frames(fits, t_ns[rows], can_id, flags, bus, length, payload))
        places.append(rows[fits])
        if torn:
            of = f"of type {kinds[0]}"
            many = f"objects {of} are not frames"
            ledger.garbled(torn, counted(torn, f"object {of} is not a frame", many))
    lost = np.flatnonzero((head["kind"] == _LOST_EVENTS) & (room >= _LOST.itemsize))
    for row in lost.tolist():
        count = int(records_at(text, body[row : row + 1], _LOST)["count"][0])
        when = np.datetime64(int(t_ns[row]), "ns")
        ledger.dropped(count, f"the log states {counted(count, 'lost event')} at {when}Z")
    return interleaved(batches, places)


_Fields = tuple[NDArray[np.int64], NDArray[np.uint16], Index, Index, int]
"""Identifier, flags, stated length, number of bytes that follow and where they begin."""


def _identifier(record: NDArray[np.void]) -> tuple[NDArray[np.int64], Mask]:
    """Return identifiers, and a mask of the extended ones."""
    raw = record["can_id"].astype(np.int64)
    return raw & 0x1FFF_FFFF, raw >> 31 != 0


def _classic(record: NDArray[np.void], *_: Index) -> _Fields:
    can_id, extended = _identifier(record)
    remote, sent = record["flags"] & 0x80 != 0, record["flags"] & 0x01 != 0
    flags = flags_of(len(record), extended=extended, remote=remote, sent=sent)
    length = np.minimum(record["dlc"], 8).astype(np.intp)
    return can_id, flags, length, np.where(remote, 0, length), 8


def _error_ext(record: NDArray[np.void], *_: Index) -> _Fields:
    can_id, extended = _identifier(record)
    length = np.minimum(record["dlc"], 8).astype(np.intp)
    return can_id, flags_of(len(record), extended=extended, error=True), length, length, 24


def _error(record: NDArray[np.void], *_: Index) -> _Fields:
    nothing = np.zeros(len(record), np.int64)
    return nothing, flags_of(len(record), error=True), nothing, nothing, 0


def _fd(record: NDArray[np.void], *_: Index) -> _Fields:
    can_id, extended = _identifier(record)
    fd = record["fd"] & 1 != 0
    remote = ~fd & (record["flags"] & 0x80 != 0)
    flags = flags_of(
        len(record),
        extended=extended,
        remote=remote,
        fd=fd,
        bitrate_switch=fd & (record["fd"] & 2 != 0),
        error_state=fd & (record["fd"] & 4 != 0),
        sent=record["flags"] & 0x01 != 0,
    )
    length = _length(record["dlc"], fd)
    return can_id, flags, length, np.where(remote, 0, np.minimum(length, record["valid"])), 20


def _fd_64(record: NDArray[np.void], whole: Index, header: Index) -> _Fields:
    can_id, extended = _identifier(record)
    bits = record["flags"]
    fd = bits & 0x1000 != 0
    remote = ~fd & (bits & 0x10 != 0)
    flags = flags_of(
        len(record),
        extended=extended,
        remote=remote,
        fd=fd,
        bitrate_switch=fd & (bits & 0x2000 != 0),
        error_state=fd & (bits & 0x4000 != 0),
        sent=record["direction"] != 0,
    )
    length = _length(record["dlc"], fd)
    # More bytes may be stated as valid than exist: the missing ones are zero.  Data that may follow
    # the payload begin at `extra`, counted from the start of the object.
    extra = record["extra"].astype(np.intp)
    there = np.where(extra > 0, np.minimum(extra, whole), whole) - header - _FD_64.itemsize
    size = np.minimum(np.minimum(length, record["valid"]), there)
    return can_id, flags, length, np.where(remote, 0, size), 40


def _length(dlc: NDArray[np.uint8], fd: Mask) -> Index:
    return np.where(fd, FD_LENGTHS[np.minimum(dlc, 15)], np.minimum(dlc, 8)).astype(np.intp)


def _payload(text: NDArray[np.uint8], at: Index, size: Index, length: Index) -> NDArray[np.uint8]:
    width = 8 if length.max(initial=0) <= 8 else 64
    index = np.minimum(at[:, None] + np.arange(width), len(text) - 1)
    return np.where(np.arange(width) < size[:, None], text[index], 0).astype(np.uint8)
