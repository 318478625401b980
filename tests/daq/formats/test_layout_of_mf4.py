"""Frames in the layouts of MDF 4, and which layouts are refused: by ASAM's description."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from typing import Any

import pytest

from daq.errors import InputError
from daq.formats.losses import Ledger, LogLoss
from daq.formats.mf4_log import read_mf4
from dbc import FrameBatch

from .loggers import Mdf
from .shown import shown

KIND = "CAN_DataFrame"
FIELDS = {"ID": (8, 0, 29), "IDE": (11, 7, 1), "DLC": (12, 0, 4), "BusChannel": (13, 0, 8)}
RECORD = struct.pack("<QLBB8s", 1500, 0x123, 8, 1, bytes(range(1, 9)))
SEEN = "1500 0 123 8 0102030405060708 -"
HEAD = struct.pack("<QhhBBBBdd", 0, 0, 0, 0, 0, 0, 0, 0, 0)


def _channels(
    mdf: Mdf,
    *,
    time: dict[str, Any] | None = None,
    kind: str = KIND,
    data: tuple[int, int, int] | None = (14, 0, 64),
    **more: dict[str, Any],
) -> int:
    """Return the first channel of a group; `more`: what is other about the fields."""
    about = {"place": (0, 0, 64), "role": 2, "sync": 1, **(time or {})}
    about.setdefault("conversion", mdf.linear(0.0, 1e-9))
    found = [mdf.channel("t", **about)]
    for name in {**FIELDS, **more}:
        place = {"place": FIELDS.get(name)}
        found.append(mdf.channel(f"{kind}.{name}", **{**place, **more.get(name, {})}))
    if data:
        found.append(mdf.channel(f"{kind}.DataBytes", data, 10))
    found.append(mdf.channel(kind, (8, 0, 112), 10))
    return mdf.chained(found)


def _group(
    mdf: Mdf,
    channels: int,
    *,
    number: int = 0,
    count: int = 0,
    flags: int = 0,
    size: tuple[int, int] = (22, 0),
) -> int:
    body = struct.pack("<QQHH4xLL", number, count, flags, 0, *size)
    return mdf.block("CG", [0, channels, 0, 0, 0, 0], body)


def _file(
    records: bytes = RECORD,
    *,
    make: Callable[[Mdf], int] = _channels,
    head: bytes = HEAD,
    id_bytes: int = 0,
    **group: Any,
) -> bytes:
    mdf = Mdf(unfinished=False)
    mdf.block("HD", [0] * 6, head)
    kinds = _group(mdf, make(mdf), **group)
    data = mdf.block("DT", [], records)
    mdf.link(64, 0, mdf.block("DG", [0, kinds, data, 0], bytes([id_bytes]) + bytes(7)))
    return bytes(mdf.raw)


def _read(raw: bytes) -> tuple[list[str], LogLoss]:
    ledger = Ledger()
    batches = list(read_mf4(io.BytesIO(raw), "a.mf4", ledger))
    return shown(FrameBatch.concatenate(batches)), ledger.loss


def _with(**more: Any) -> Callable[[Mdf], int]:
    def make(mdf: Mdf) -> int:
        return _channels(mdf, **{k: v(mdf) if callable(v) else v for k, v in more.items()})

    return make


def _conversion(method: int, *values: float) -> Callable[[Mdf], dict[str, Any]]:
    def make(mdf: Mdf) -> dict[str, Any]:
        body = struct.pack("<BBHHH2d", method, 0, 0, 0, len(values), 0.0, 0.0)
        body += struct.pack(f"<{len(values)}d", *values)
        return {"place": (12, 0, 8), "conversion": mdf.block("CC", [0, 0, 0, 0], body)}

    return make


def _dlc(value: int) -> bytes:
    return struct.pack("<QLBB8s", 1500, 0x123, value, 1, bytes(range(1, 9)))


CONVERSIONS = {
    "none": ({"place": (12, 0, 8)}, 3, 3),
    "linear": (_conversion(1, 1.0, 2.0), 3, 7),
    "linear with one number": (_conversion(1, 1.0), 3, 3),
    "linear with a third": (_conversion(1, 1.0, 2.0, 9.0), 3, 7),
    "a formula": (_conversion(3, 1.0, 2.0), 3, 3),
    "a table between": (_conversion(4, 0.0, 1.0, 3.0, 5.0), 3, 5),
    "a table": (_conversion(5, 3.0, 5.0, 0.0, 1.0), 3, 5),
    "a table, odd": (_conversion(5, 0.0, 1.0, 3.0), 3, 1),
    "a table of one number": (_conversion(5, 1.0), 3, 3),
    "ranges": (_conversion(6, 0.0, 9.0, 1.0), 3, 3),
    "not finite": (_conversion(1, float("nan"), 2.0), 3, 3),
    "as large as can be": (_conversion(1, 1e15, -1e15), 1, 0),
    "too large": (_conversion(1, 2e15, -2e15), 3, 3),
}


@pytest.mark.parametrize("name", CONVERSIONS)
def test_a_conversion_of_the_length_of_a_frame(name: str) -> None:
    conversion, raw, length = CONVERSIONS[name]
    frames, loss = _read(_file(_dlc(raw), make=_with(DLC=conversion)))
    assert [frame.split()[3] for frame in frames] == [str(length)]
    assert not loss.any


def test_a_conversion_that_states_more_numbers_than_it_has() -> None:
    def make(mdf: Mdf) -> dict[str, Any]:
        body = struct.pack("<BBHHH2d2d", 1, 0, 0, 0, 9, 0.0, 0.0, 1.0, 2.0)
        return {"place": (12, 0, 8), "conversion": mdf.block("CC", [0, 0, 0, 0], body)}

    assert [f.split()[3] for f in _read(_file(_dlc(3), make=_with(DLC=make)))[0]] == ["7"]


@pytest.mark.parametrize(
    ("head", "first_ns"),
    [
        (struct.pack("<QhhB", 10**18, 60, 60, 0), 10**18),
        (struct.pack("<QhhB", 10**18, 60, 60, 1), 10**18),
        (struct.pack("<QhhB", 10**18, 60, 60, 2), 10**18),
        (struct.pack("<QhhB", 10**18, 60, 60, 3), 10**18 - 7_200 * 10**9),
        (struct.pack("<QhhB", 10**18, -90, 30, 3), 10**18 + 3_600 * 10**9),
        (struct.pack("<QhhB", 1 << 62, 0, 0, 0), 1 << 62),
        (struct.pack("<QhhB", (1 << 62) + 1, 0, 0, 0), 1 << 62),
    ],
)
def test_times_count_from_the_start_in_the_header_in_utc(head: bytes, first_ns: int) -> None:
    assert _read(_file(head=head))[0] == [SEEN.replace("1500", str(first_ns + 1500), 1)]


@pytest.mark.parametrize(
    ("name", "place", "raw", "expected"),
    [
        ("BusChannel", (12, 0, 16), 1, "0 123 0 - -"),
        ("BusChannel", (12, 0, 16), 2, "1 123 0 - -"),
        ("BusChannel", (12, 0, 16), 256, "254 123 0 - -"),
        ("BusChannel", (12, 0, 16), 300, "254 123 0 - -"),
        ("DataLength", (12, 0, 8), 8, "0 123 8 0102030405060708 -"),
        ("DataLength", (12, 0, 8), 9, ""),
        ("DataLength", (12, 0, 8), 0, "0 123 0 - -"),
        ("DLC", (12, 0, 8), 9, "0 123 8 0102030405060708 -"),
        ("DLC", (12, 0, 8), 255, "0 123 8 0102030405060708 -"),
    ],
)
def test_buses_and_lengths(name: str, place: tuple[int, int, int], raw: int, expected: str) -> None:
    def make(mdf: Mdf) -> int:
        fields: dict[str, Any] = {"ID": {}, "DLC": {"place": (12, 0, 0)}, name: {"place": place}}
        if name == "DataLength":
            fields["BusChannel"] = {"place": (0, 0, 0)}
        return _channels(mdf, **{"BusChannel": {"place": (13, 4, 1)}, **fields})

    record = struct.pack("<QLH8s", 1500, 0x123, raw, bytes(range(1, 9)))
    frames, loss = _read(_file(record, make=make))
    assert frames == ([f"1500 {expected}"] if expected else [])
    assert loss.garbled == (0 if expected else 1)


@pytest.mark.parametrize(
    ("code", "length", "more", "expected"),
    [
        (8, 8, {}, "8 -"),
        (9, 8, {"EDL": 1}, "12 f"),
        (15, 8, {"EDL": 1}, "64 f"),
        (3, 64, {"EDL": 1, "DataLength": 1}, "64 f"),
        (3, 65, {"EDL": 1, "DataLength": 1}, ""),
        (3, 8, {"DataLength": 1}, "8 -"),
        (3, 9, {"DataLength": 1}, ""),
        (3, 8, {"EDL": 1, "BRS": 1}, "3 fb"),
        (3, 8, {"EDL": 1, "ESI": 1}, "3 fs"),
        (3, 8, {"Dir": 1}, "3 t"),
        (3, 8, {"IDE": 1}, "3 x"),
        (3, 8, {"kind": "CAN_RemoteFrame"}, "3 r"),
        (9, 5, {"kind": "CAN_RemoteFrame", "DataLength": 1}, "8 r"),
        (3, 8, {"kind": "CAN_ErrorFrame"}, "3 e"),
    ],
)
def test_the_fields_of_a_frame(code: int, length: int, more: dict[str, Any], expected: str) -> None:
    kind = more.get("kind", KIND)
    group = Mdf(unfinished=False)
    group.block("HD", [0] * 6, HEAD)
    found = [
        group.channel("t", (0, 0, 64), role=2, sync=1, conversion=group.linear(0.0, 1e-9)),
        group.channel(f"{kind}.ID", (8, 0, 29)),
        group.channel(f"{kind}.DLC", (12, 0, 8)),
        group.channel(f"{kind}.DataBytes", (14, 0, 512), 10),
        group.channel(kind, (8, 0, 112), 10),
    ]
    if "DataLength" in more:
        found.append(group.channel(f"{kind}.DataLength", (13, 0, 8)))
    for name in ("EDL", "BRS", "ESI", "Dir", "IDE"):
        if name in more:
            found.append(group.channel(f"{kind}.{name}", (8, 8, 1)))
    record = struct.pack("<QLBB", 1500, 0x123, code, length) + bytes(64)
    kinds = _group(group, group.chained(found), size=(len(record), 0))
    data = group.block("DT", [], record)
    group.link(64, 0, group.block("DG", [0, kinds, data, 0], bytes(8)))
    frames, loss = _read(bytes(group.raw))
    assert [f"{f.split()[3]} {f.split()[5]}" for f in frames] == ([expected] if expected else [])
    assert loss.garbled == (0 if expected else 1)


STAMPS = {
    "ns": ({"place": (0, 0, 64)}, 1500, "1500"),
    "signed": ({"place": (0, 0, 64), "kind": 2}, 1500, "1500"),
    "seconds": ({"place": (0, 0, 64), "conversion": 0}, 2, "2000000000"),
    "a century": ({"place": (0, 0, 64), "conversion": 0}, 3_999_999_999, "3999999999000000000"),
    "more than a century": ({"place": (0, 0, 64), "conversion": 0}, 4_000_000_000, ""),
}


@pytest.mark.parametrize("name", STAMPS)
def test_the_time_of_a_record(name: str) -> None:
    time, raw, stamp = STAMPS[name]
    record = struct.pack("<Q", raw) + RECORD[8:]
    frames, loss = _read(_file(record, make=_with(time=time)))
    assert [frame.split()[0] for frame in frames] == ([stamp] if stamp else [])
    assert loss.garbled == (0 if stamp else 1)


def test_times_before_the_start_and_with_an_offset() -> None:
    raw = _file(
        struct.pack("<q", -1000) + RECORD[8:],
        make=lambda mdf: _channels(mdf, time={"kind": 2, "conversion": mdf.linear(2.0, 1e-9)}),
        head=struct.pack("<QhhB", 10**10, 0, 0, 0),
    )
    assert [frame.split()[0] for frame in _read(raw)[0]] == ["11999999000"]


def test_a_time_that_is_no_number_is_no_frame() -> None:
    record = struct.pack("<d", float("nan")) + RECORD[8:]
    time = {"place": (0, 0, 64), "kind": 4, "conversion": 0}
    frames, loss = _read(_file(record, make=_with(time=time)))
    assert (frames, loss.garbled) == ([], 1)


NO_FRAMES: dict[str, Callable[[Mdf], int]] = {
    "no time": _with(time={"role": 0}),
    "a master that is no time": _with(time={"sync": 2}),
    "another kind": _with(kind="LIN_Frame"),
}


@pytest.mark.parametrize("name", NO_FRAMES)
def test_a_group_without_frames_or_time_holds_no_bus_logging(name: str) -> None:
    with pytest.raises(InputError, match="no CAN bus logging"):
        _read(_file(make=NO_FRAMES[name]))


FITS: dict[str, tuple[dict[str, Any], bool]] = {
    "the last byte": ({"make": _with(Dir={"place": (21, 0, 8)})}, True),
    "behind the last byte": ({"make": _with(Dir={"place": (21, 1, 8)})}, False),
    "63 bits from bit 1": ({"make": _with(Dir={"place": (14, 1, 63)})}, True),
    "64 bits from bit 1": ({"make": _with(Dir={"place": (13, 1, 64)})}, False),
    "a text": ({"make": _with(Dir={"place": (21, 0, 8), "kind": 6})}, False),
    "a number of kind 5": ({"make": _with(Dir={"place": (14, 0, 64), "kind": 5})}, True),
    "a constant text": ({"make": _with(Dir={"place": (0, 0, 8), "kind": 6, "role": 6})}, True),
    "a number of another role": (
        {"make": _with(Dir={"place": (90, 0, 8), "role": 3})},
        True,
    ),
    "a payload to the end": ({"make": _with(data=(14, 0, 64))}, True),
    "a payload beyond the end": ({"make": _with(data=(15, 0, 64))}, False),
    "a time beyond the end": ({"make": _with(time={"place": (15, 0, 64)})}, False),
    "validity in the size": ({"size": (20, 2)}, True),
    "a record of no bytes": ({"size": (0, 0)}, False),
    "a record of 64 kB": ({"size": (65_535, 1)}, True),
    "a larger record": ({"size": (65_535, 2)}, False),
    "numbers of 3 bytes": ({"id_bytes": 3}, False),
    "a short header": ({"head": HEAD[:12]}, False),
    "a header of 13 bytes": ({"head": HEAD[:13]}, True),
}


@pytest.mark.parametrize("name", FITS)
def test_a_layout_that_cannot_be_is_refused(name: str) -> None:
    other, good = FITS[name]
    records = RECORD.ljust(65_536, b"\0") if "64 kB" in name else RECORD
    if good:
        frames, loss = _read(_file(records, **other))
        assert [frame.split()[2:5] for frame in frames] == [SEEN.split()[2:5]]
        assert not loss.any
        return
    with pytest.raises(InputError, match="cannot be read"):
        _read(_file(records, **other))


def _short(kind: str, links: int, body: int) -> bytes:
    """Return a file with one block of a kind that has so many links and bytes."""
    mdf = Mdf(unfinished=False)
    mdf.block("HD", [0] * 6, HEAD)
    sizes = {"DG": (4, 8), "CG": (6, 32), "CN": (8, 72)}
    sizes[kind] = (links, body)
    place = {name: mdf.block(name, [0] * n, bytes(size)) for name, (n, size) in sizes.items()}
    mdf.link(64, 0, place["DG"])
    if sizes["DG"][0] > 1:
        mdf.link(place["DG"], 1, place["CG"])
    if sizes["CG"][0] > 1:
        mdf.link(place["CG"], 1, place["CN"])
    struct.pack_into("<L", mdf.raw, place["CG"] + 24 + 8 * sizes["CG"][0] + sizes["CG"][1] - 8, 9)
    return bytes(mdf.raw)


@pytest.mark.parametrize(
    ("kind", "links", "body", "good"),
    [
        ("DG", 3, 1, True),
        ("DG", 2, 8, False),
        ("DG", 4, 0, False),
        ("CG", 2, 32, True),
        ("CG", 1, 32, False),
        ("CG", 6, 31, False),
        ("CN", 8, 16, True),
        ("CN", 7, 72, False),
        ("CN", 8, 15, False),
    ],
)
def test_a_block_that_is_too_short_is_refused(kind: str, links: int, body: int, good: bool) -> None:
    with pytest.raises(InputError, match="no CAN bus logging" if good else "too short"):
        _read(_short(kind, links, body))
