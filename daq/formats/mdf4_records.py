"""Reads records of an MDF 4 file block by block: sorted by kind, or in the order of logging."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .assemble import numbers_at
from .losses import Ledger
from .mdf4_blocks import BlockFile
from .mdf4_layout import DataGroup, FrameGroup

Records = NDArray[np.uint8]
BLOCK_RECORDS = 16_384
"""Number of records that are returned together: a block of payloads of 64 bytes has 1 MB."""
MAX_WINDOW_BYTES = 8 << 20
"""Number of bytes of payloads of any length that are held for the records of one block."""
_MAX_PAYLOAD_BYTES = 1 << 16
_KEPT = 65_536
"""Number of payloads that are kept for later records, and of records that wait for their
payload."""
_EMPTY_RECORDS = 4096
"""Number of consecutive all-zero records that are not records, because loggers reserve room."""
_LENGTH = struct.Struct("<L")


@dataclass(frozen=True, slots=True)
class RecordBlock:
    """Records of one kind."""

    group: FrameGroup
    """Layout of the records."""
    records: Records
    """The records, shape (n, bytes)."""
    order: NDArray[np.int64]
    """Position of each record among all records of the block, shape (n,)."""
    payload: Records | None
    """Payloads that are stored elsewhere, padded with zeros, shape (n, 64); None if there are
    none."""
    found: NDArray[np.bool_]
    """True where the payload was found, shape (n,)."""


def sorted_records(file: BlockFile, data: DataGroup, ledger: Ledger) -> Iterator[RecordBlock]:
    """Yield the records of a data group that has one kind."""
    group = data.frames[0]
    size, left = group.record_bytes, group.count or -1
    window = None
    if group.payload and group.payload.elsewhere:
        window = _Window(file.pieces(group.payload.elsewhere))
    held = b""
    for piece in file.pieces(data.data):
        held += piece
        count = len(held) // size
        count = count if left < 0 else min(count, left)
        if count < BLOCK_RECORDS and count != left:
            continue
        yield from _sorted_block(held[: count * size], group, window)
        if count >= _EMPTY_RECORDS and not any(held[: count * size]):
            return
        held, left = held[count * size :], left - count if left > 0 else left
        if left == 0:
            return
    count = len(held) // size
    yield from _sorted_block(held[: count * size], group, window)
    if len(held) % size:
        ledger.cut(len(held) % size, "its last record is incomplete")


def _sorted_block(raw: bytes, group: FrameGroup, window: _Window | None) -> Iterator[RecordBlock]:
    records = np.frombuffer(raw, np.uint8).reshape(-1, group.record_bytes)
    if not len(records) or (len(records) >= _EMPTY_RECORDS and not records.any()):
        return
    found, payload = np.ones(len(records), bool), None
    if window is not None:
        payload, found = window.payloads(_places(records, group))
    yield RecordBlock(group, records, np.arange(len(records)), payload, found)


def mixed_records(file: BlockFile, data: DataGroup, ledger: Ledger) -> Iterator[list[RecordBlock]]:
    """Yield the records of a data group as they were logged, kinds mixed, block by block."""
    store = {number: _Store() for number in data.variable.values()}
    waiting: dict[int, tuple[Records, NDArray[np.int64]]] = {}
    held, serial = b"", 0
    for piece in file.pieces(data.data):
        held += piece
        starts, used, good = _walk(held, data)
        yield _mixed_block(held, starts, serial, data, store, waiting, last=False)
        serial += len(starts)
        held = held[used:]
        if not good:
            if any(held):  # empty records were reserved
                ledger.cut(len(held), "a record has a number of no known kind")
            held = b""
            break
    if any(held):
        ledger.cut(len(held), "its last record is incomplete")
    yield _mixed_block(b"", [], serial, data, store, waiting, last=True)


def _walk(held: bytes, data: DataGroup) -> tuple[list[int], int, bool]:
    """Return the starts and the end of complete records, and False if an unknown one follows."""
    starts: list[int] = []
    at, end, width = 0, len(held), data.id_bytes
    if width == 1:
        sizes: dict[int, int] | list[int] = [data.sizes.get(i, 0) for i in range(256)]
    else:
        sizes = data.sizes
    append, unpack = starts.append, _LENGTH.unpack_from
    while at + width < end:
        number = held[at] if width == 1 else int.from_bytes(held[at : at + width], "little")
        size = sizes[number] if width == 1 else data.sizes.get(number, 0)
        if size < 0:
            if at + width + 4 > end:
                break
            size = 4 + unpack(held, at + width)[0]
            if size > _MAX_PAYLOAD_BYTES:
                return starts, at, False
        elif not size:
            return starts, at, False
        if at + width + size > end:
            break
        append(at)
        at += width + size
    return starts, at, True


def _mixed_block(
    held: bytes,
    starts: list[int],
    serial: int,
    data: DataGroup,
    store: dict[int, _Store],
    waiting: dict[int, tuple[Records, NDArray[np.int64]]],
    last: bool,
) -> list[RecordBlock]:
    text = np.frombuffer(held, np.uint8)
    at = np.array(starts, np.int64)
    numbers = np.zeros(len(at), np.int64)
    for place in range(data.id_bytes):
        numbers |= text[at + place].astype(np.int64) << 8 * place
    for number, kept in store.items():
        kept.append(text, at[numbers == number] + data.id_bytes)
    blocks = []
    for group in data.frames:
        positions = np.flatnonzero(numbers == group.record_id)
        rows = at[positions] + data.id_bytes
        records = text[rows[:, None] + np.arange(group.record_bytes)]
        order = positions + serial
        source = data.variable.get(group.payload.elsewhere) if group.payload else None
        if source is None:
            if len(positions):
                blocks.append(
                    RecordBlock(group, records, order, None, np.ones(len(positions), bool))
                )
            continue
        if group.record_id in waiting:
            before = waiting.pop(group.record_id)
            records = np.concatenate([before[0], records])
            order = np.concatenate([before[1], order])
        # A payload may follow its record: the record waits for it.
        places = _places(records, group)
        ready = len(places) if last else int(np.searchsorted(places, store[source].end))
        if len(places) - ready > _KEPT:
            ready = len(places)
        if ready < len(places):
            waiting[group.record_id] = (records[ready:], order[ready:])
        if ready:
            payload, found = store[source].payloads(places[:ready])
            blocks.append(RecordBlock(group, records[:ready], order[:ready], payload, found))
    return blocks


def _places(records: Records, group: FrameGroup) -> NDArray[np.int64]:
    """Return the position of each record's payload in the data that hold the payloads."""
    assert group.payload is not None
    first, width = group.payload.byte, min(group.payload.width, 8)
    wide = np.zeros((len(records), 8), np.uint8)
    wide[:, :width] = records[:, first : first + width]
    return wide.view("<i8")[:, 0]


class _Store:
    """Payloads of any length that are stored among the records, by position."""

    def __init__(self) -> None:
        self.end = 0
        """Position after the last payload."""
        self._places = np.zeros(0, np.int64)
        self._bytes = np.zeros((0, 64), np.uint8)

    def append(self, text: NDArray[np.uint8], at: NDArray[np.int64]) -> None:
        """Add the payloads at positions in a block; drop those of two blocks ago."""
        sizes = numbers_at(text, at, "<u4")
        ends = self.end + np.cumsum(sizes + 4)
        fresh = _gathered(text, at + 4, sizes)
        self._places = np.concatenate([self._places[-_KEPT:], ends - sizes - 4])
        self._bytes = np.concatenate([self._bytes[-_KEPT:], fresh])
        self.end = int(ends[-1]) if len(ends) else self.end

    def payloads(self, places: NDArray[np.int64]) -> tuple[Records, NDArray[np.bool_]]:
        """Return the payloads at these positions, (n, 64), and a mask of those that were found."""
        if not len(self._places):
            return np.zeros((len(places), 64), np.uint8), np.zeros(len(places), bool)
        at = np.searchsorted(self._places, places).clip(max=len(self._places) - 1)
        found = self._places[at] == places
        return self._bytes[at], found


class _Window:
    """Payloads of any length in separate data blocks, read together with the records."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._held = b""
        self._first = 0

    def payloads(self, places: NDArray[np.int64]) -> tuple[Records, NDArray[np.bool_]]:
        """Return the payloads at these positions, (n, 64), and a mask of those that were found."""
        good = (places >= self._first) & (places < self._first + (1 << 40))
        if not good.any():
            return np.zeros((len(places), 64), np.uint8), good
        lowest = int(places[good].min())
        end = min(int(places[good].max()) + 4 + 64, lowest + MAX_WINDOW_BYTES)
        while self._first + len(self._held) < end:
            piece = next(self._pieces, b"")
            if not piece:
                break
            self._held += piece
            drop = min(lowest - self._first, len(self._held))
            self._held, self._first = self._held[drop:], self._first + drop
        text = np.frombuffer(self._held, np.uint8)
        at = places - self._first
        good &= (at >= 0) & (at + 4 <= len(text))
        at = np.where(good, at, 0)
        if len(text) < 4:
            return np.zeros((len(places), 64), np.uint8), np.zeros(len(places), bool)
        sizes = np.where(good, numbers_at(text, at, "<u4"), 0)
        good &= at + 4 + sizes <= len(text)
        return _gathered(text, at + 4, np.where(good, sizes, 0)), good


def _gathered(text: NDArray[np.uint8], at: NDArray[np.int64], sizes: NDArray[np.int64]) -> Records:
    """Return up to 64 bytes from each position, padded with zeros."""
    if not len(at):
        return np.zeros((0, 64), np.uint8)
    width = int(min(sizes.max(), 64))
    index = (at[:, None] + np.arange(width)).clip(max=len(text) - 1)
    data = np.zeros((len(at), 64), np.uint8)
    data[:, :width] = np.where(np.arange(width) < sizes[:, None], text[index], 0)
    return data
