"""Records of MDF 4: of one kind and of several, with payloads in them, apart and in between."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError
from daq.formats.losses import Ledger, LogLoss
from daq.formats.mf4_log import merged, read_mf4
from dbc import FrameBatch

from .loggers import Mdf
from .shown import shown

HEAD = struct.pack("<QhhBBBBdd", 0, 0, 0, 0, 0, 0, 0, 0, 0)
KIND = "CAN_DataFrame"


def _mdf() -> Mdf:
    mdf = Mdf(unfinished=False)
    mdf.block("HD", [0] * 6, HEAD)
    return mdf


PLACES = {"ID": (8, 0, 29), "DataLength": (12, 0, 8)}


def _group(
    mdf: Mdf,
    number: int = 0,
    *,
    kind: str = KIND,
    count: int = 0,
    data: int = 0,
    inner: bool = False,
) -> int:
    """Return a kind with records of 21 bytes: ns, ID, length, payload or its place."""
    role = 1 if data else 0
    fields = [mdf.channel(f"{kind}.{name}", place) for name, place in PLACES.items()]
    fields.append(mdf.channel(f"{kind}.DataBytes", (13, 0, 64), 10, role=role, data=data))
    time = mdf.channel("t", (0, 0, 64), 0, role=2, sync=1, conversion=mdf.linear(0.0, 1e-9))
    if inner:
        whole = mdf.channel(kind, (8, 0, 104), 10, inner=mdf.chained(fields))
        channels = mdf.chained([time, whole])
    else:
        channels = mdf.chained([time, mdf.channel(kind, (8, 0, 104), 10), *fields])
    at = mdf.group(number, channels, 21)
    struct.pack_into("<Q", mdf.raw, at + 24 + 48 + 8, count)
    return at


def _record(t_ns: int, can_id: int, length: int, payload: bytes | int = 0) -> bytes:
    head = struct.pack("<QLB", t_ns, can_id, length)
    return head + (
        payload.ljust(8, b"\xee") if isinstance(payload, bytes) else struct.pack("<Q", payload)
    )


def _read(mdf: Mdf, cut: int = 0) -> tuple[list[str], LogLoss]:
    ledger = Ledger()
    raw = bytes(mdf.raw[: len(mdf.raw) - cut])
    batches = list(read_mf4(io.BytesIO(raw), "a.mf4", ledger))
    return shown(FrameBatch.concatenate(batches)), ledger.loss


def _data_group(mdf: Mdf, kinds: int, records: bytes, id_bytes: int = 0) -> int:
    data = mdf.block("DT", [], records)
    return mdf.block("DG", [0, kinds, data, 0], bytes([id_bytes]) + bytes(7))


def _sorted(records: bytes, *, stored: bytes | None = None, **group: Any) -> Mdf:
    mdf = _mdf()
    data = 0 if stored is None else mdf.block("SD", [], stored)
    mdf.link(64, 0, _data_group(mdf, _group(mdf, data=data, **group), records))
    return mdf


THREE = b"".join(_record(n, 0x100 + n, n, bytes([1, 2, 3])) for n in (1, 2, 3))
SHOWN = ["1 0 101 1 01 -", "2 0 102 2 0102 -", "3 0 103 3 010203 -"]


@pytest.mark.parametrize(
    ("count", "more", "frames", "lost"),
    [
        (0, b"", 3, 0),
        (3, b"", 3, 0),
        (2, b"", 2, 0),
        (1, b"", 1, 0),
        (9, b"", 3, 0),
        (0, bytes(20), 3, 20),
        (3, b"\1" * 20, 3, 0),
        (9, b"\1", 3, 1),
    ],
)
def test_as_many_records_as_the_file_states_or_as_there_are(
    count: int, more: bytes, frames: int, lost: int
) -> None:
    found, loss = _read(_sorted(THREE + more, count=count))
    assert found == SHOWN[:frames]
    assert loss.bytes_cut == lost


def test_fields_within_the_channel_of_the_frame() -> None:
    assert _read(_sorted(THREE, inner=True))[0] == SHOWN


def _lengths(mdf: Mdf) -> list[int]:
    return [len(batch) for batch in read_mf4(io.BytesIO(mdf.raw), "a.mf4", Ledger()) if len(batch)]


def test_thousands_of_records_without_a_bit_are_room_that_was_reserved() -> None:
    assert _lengths(_sorted(bytes(21 * 4095))) == [4095]
    assert _lengths(_sorted(bytes(21 * 4096))) == []
    assert _lengths(_sorted(bytes(21 * 4095) + _record(1, 0, 0))) == [4096]


def test_many_records_come_in_blocks_and_end_with_room_that_was_reserved() -> None:
    many = _record(7, 0x123, 8, b"12345678") * 20_000
    assert sum(_lengths(_sorted(many))) == 20_000
    assert sum(_lengths(_sorted(many, count=19_000))) == 19_000
    mdf = _sorted(many + bytes(21 * 50_000) + many)
    assert 20_000 <= sum(_lengths(mdf)) <= 20_000 + 21_000


STORED = b"".join(struct.pack("<L", len(p)) + p for p in (b"\1", b"", b"\2\3", bytes(range(64))))
"""Payloads at 0, 5, 9 and 15."""


def test_payloads_in_data_of_their_own() -> None:
    places = [(0, 1), (5, 0), (9, 2), (15, 64)]
    records = [_record(n, 0x100 + n, size, at) for n, (at, size) in enumerate(places)]
    frames, loss = _read(_sorted(b"".join(records[:3]), stored=STORED))
    assert frames == ["0 0 100 1 01 -", "1 0 101 0 - -", "2 0 102 2 0203 -"]
    assert not loss.any


@pytest.mark.parametrize(
    ("place", "stored", "found"),
    [
        (0, STORED[:5], True),
        (0, STORED[:4], False),  # its bytes are cut off
        (9, STORED[:15], True),
        (9, STORED[:14], False),
        (5, STORED[:9], True),
        (5, STORED[:8], False),  # its length is cut off
        (-1, STORED, False),
        ((1 << 40), STORED, False),
        (1 << 62, STORED, False),
        (0, b"", False),
        (0, b"\0\0\0", False),
        (0, bytes(4), True),
    ],
)
def test_a_payload_that_is_not_there_is_no_frame(place: int, stored: bytes, found: bool) -> None:
    record = struct.pack("<QLBq", 1, 0x123, 0, place)
    frames, loss = _read(_sorted(record, stored=stored))
    assert frames == (["1 0 123 0 - -"] if found else [])
    assert loss.garbled == (0 if found else 1)


def test_payloads_out_of_order_and_some_of_them_missing() -> None:
    records = [_record(n, 0x100 + n, 1, at) for n, at in enumerate((9, 0, 500, 9))]
    frames, loss = _read(_sorted(b"".join(records), stored=STORED))
    assert frames == ["0 0 100 1 02 -", "1 0 101 1 01 -", "3 0 103 1 02 -"]
    assert loss.garbled == 1


def test_a_window_of_payloads_moves_along_with_the_records() -> None:
    n = 40_000  # in blocks of 16384, with payloads of many pieces of data
    stored = b"".join(struct.pack("<LL56x", 60, k) for k in range(n))
    records = b"".join(_record(k, 0x123, 4, 64 * k) for k in range(n))
    mdf = _sorted(records, stored=stored)
    batches = list(read_mf4(io.BytesIO(mdf.raw), "a.mf4", Ledger()))
    frames = FrameBatch.concatenate(batches)
    assert (len(batches) > 1, len(frames)) == (True, n)
    assert frames.data[:, :4].copy().view("<u4")[:, 0].tolist() == list(range(n))


def test_a_record_that_states_fewer_bytes_than_its_payload_has_and_the_other_way_round() -> None:
    records = _record(1, 0x123, 1, 9) + _record(2, 0x124, 4, 9)
    frames, _ = _read(_sorted(records, stored=STORED))
    assert frames == ["1 0 123 1 02 -", "2 0 124 4 02030000 -"]


def _mixed(records: Sequence[bytes], id_bytes: int, second: int = 2) -> Mdf:
    """Return a file of data frames 1, remote frames of another number and payloads 7."""
    mdf = _mdf()
    stored = mdf.group(7, 0, 0, flags=1)
    kinds = [_group(mdf, 1, data=stored), _group(mdf, second, kind="CAN_ErrorFrame"), stored]
    data = mdf.block("DT", [], b"".join(records))
    mdf.link(64, 0, mdf.block("DG", [0, mdf.chained(kinds), data, 0], bytes([id_bytes])))
    return mdf


def _stored(payload: bytes, id_bytes: int = 1) -> bytes:
    return (7).to_bytes(id_bytes, "little") + struct.pack("<L", len(payload)) + payload


@pytest.mark.parametrize(
    ("id_bytes", "number"), [(1, 255), (2, 0x0201), (4, 0x04030201), (8, 0x0807060504030201)]
)
def test_kinds_that_follow_each_other_have_numbers_in_front(id_bytes: int, number: int) -> None:
    one, other = (1).to_bytes(id_bytes, "little"), number.to_bytes(id_bytes, "little")
    records = [
        one + _record(5, 0x101, 2, 0),
        _stored(b"\1\2", id_bytes),
        other + _record(4, 0x102, 1, b"\3"),
        one + _record(6, 0x103, 1, 6),
        _stored(b"\4", id_bytes),
        other + _record(7, 0x104, 0, b""),
    ]
    frames, loss = _read(_mixed(records, id_bytes, number))
    assert frames == ["5 0 101 2 0102 -", "4 0 102 1 03 e", "6 0 103 1 04 -", "7 0 104 0 - e"]
    assert not loss.any


ONE, TWO = b"\1" + _record(5, 0x101, 1, 0), b"\2" + _record(6, 0x102, 0, b"")
MIXED: dict[str, tuple[list[bytes], list[str], int, int]] = {
    "a payload before its record": ([_stored(b"\1"), ONE, TWO], ["101", "102"], 0, 0),
    "no payload": ([ONE, TWO], ["102"], 1, 0),
    "no payload, and one elsewhere": ([_stored(b""), _stored(b"\1"), ONE], ["101"], 0, 0),
    "a payload at another place": (
        [_stored(b""), b"\1" + _record(5, 0x101, 0, 1), TWO],
        ["102"],
        1,
        0,
    ),
    "nothing behind": ([TWO, bytes(30)], ["102"], 0, 0),
    "an unknown number": ([TWO, b"\3" * 30, TWO], ["102"], 0, 52),
    "a record cut off": ([TWO, TWO[:-1]], ["102"], 0, 21),
    "a number cut off": ([TWO, b"\2"], ["102"], 0, 1),
    "an empty payload at the end": ([ONE, TWO, _stored(b"")], ["101", "102"], 0, 0),
    "a length cut off": ([TWO, b"\7\1\0\0"], ["102"], 0, 4),
    "a payload cut off": ([TWO, b"\7\2\0\0\0\1"], ["102"], 0, 6),
    "a payload of 64 kB": ([TWO, _stored(bytes(65_532)), TWO], ["102", "102"], 0, 0),
    "a longer payload": ([TWO, _stored(bytes(65_533)), TWO], ["102"], 0, 65_560),
}


@pytest.mark.parametrize("name", MIXED)
def test_records_of_several_kinds(name: str) -> None:
    records, ids, garbled, lost = MIXED[name]
    frames, loss = _read(_mixed(records, 1))
    assert [frame.split()[2] for frame in frames] == ids
    assert (loss.garbled, loss.bytes_cut) == (garbled, lost)


@pytest.mark.parametrize("tail", [b"\3" * 30, _stored(bytes(65_533))])
def test_records_end_where_one_is_no_kind(tail: bytes) -> None:
    _, loss = _read(_mixed([TWO, tail], 1))
    assert "of no known kind" in loss.text


def test_records_of_several_kinds_without_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="not numbered"):
        _read(_mixed([ONE], 0))


def test_streams_of_several_groups_of_data_are_merged_by_time() -> None:
    mdf = _mdf()
    times = [(1, 4, 9), (2, 3, 10), (5, 6)]
    groups = [
        _data_group(mdf, _group(mdf), b"".join(_record(t, 0x100 * k + t, 0, b"") for t in row))
        for k, row in enumerate(times, 1)
    ]
    mdf.link(64, 0, mdf.chained(groups))
    frames, loss = _read(mdf)
    assert [frame.split()[2] for frame in frames] == (
        ["101", "202", "203", "104", "305", "306", "109", "20A"]
    )
    assert not loss.any


def _batches(*blocks: Sequence[int]) -> Iterator[FrameBatch]:
    for times in blocks:
        n = len(times)
        yield FrameBatch(
            np.array(times, np.int64),
            np.zeros(n, np.uint32),
            np.zeros(n, np.uint16),
            np.zeros(n, np.uint8),
            np.zeros(n, np.uint8),
            np.zeros((n, 8), np.uint8),
        )


def test_blocks_of_streams_are_handed_out_up_to_the_earliest_end() -> None:
    streams = [
        _batches([1, 4], [], [9, 12], [13]),
        _batches([2, 3, 10], [11]),
        _batches(),
        _batches([], [5, 6]),
    ]
    found = [batch.t_ns.tolist() for batch in merged(streams)]
    assert found == [[1, 2, 3, 4], [5, 6], [9, 10], [11], [12], [13]]
    assert not list(merged([_batches(), _batches([])]))
