"""A BLF object by object, and its containers: each limit on both sides, in bytes and numbers.

The structures are those of Vector's description of BLF, packed here by hand.
"""

from __future__ import annotations

import io
import struct
import zlib

import pytest

from daq.formats.blf import read_blf
from daq.formats.reader import LogLoss
from dbc import FrameBatch
from dbc.words import InputError

from .mixed import shown

BAD = "bad"
"""The object should be a frame and is none."""
_8 = bytes(range(1, 9))
_64 = bytes(range(1, 65))
_0 = bytes(64)
_CENTURY_NS = 4_102_444_800 * 10**9 - 1
"""36500 days."""


def _object(
    kind: int,
    body: bytes,
    *,
    stamp: int = 1500,
    unit: int = 2,
    version: int = 1,
    size: int | None = None,
    beyond: bytes = b"",
) -> bytes:
    """Return an object; `unit`: 2 for ns, 1 for 10 us; `beyond`: what stands behind its end."""
    size = (32 if version != 2 else 40) + len(body) if size is None else size
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, version, size, kind, unit, 0, 0, stamp)
    return head + (bytes(8) if version == 2 else b"") + body + beyond


def _classic(
    bus: int = 1, flags: int = 0, dlc: int = 8, can_id: int = 0x123, data: bytes = _8
) -> bytes:
    return struct.pack("<HBBL8s", bus, flags, dlc, can_id, data)


def _error_ext(bus: int = 1, dlc: int = 8, can_id: int = 0x123) -> bytes:
    return struct.pack("<HHLBBBxLLHH8s", bus, 0, 0, 0, 0, dlc, 0, can_id, 0, 0, _8)


def _fd(
    flags: int = 0, dlc: int = 8, can_id: int = 0x123, fd: int = 1, valid: int = 64, bus: int = 1
) -> bytes:
    return struct.pack("<HBBLLBBBxL64s", bus, flags, dlc, can_id, 0, 0, fd, valid, 0, _64)


def _fd_64(
    flags: int = 0x1000,
    dlc: int = 8,
    can_id: int = 0x123,
    valid: int = 64,
    sent: int = 0,
    extra: int = 0,
    data: bytes = _64,
    bus: int = 1,
) -> bytes:
    head = struct.pack("<BBBBLLL", bus, dlc, valid, 0, can_id, 0, flags)
    return head + struct.pack("<LLLLHBBL", 0, 0, 0, 0, 0, sent, extra, 0) + data


def _file(
    content: bytes,
    *,
    start: tuple[int, ...] = (0,) * 8,
    claimed: int = 0,
    header: int = 144,
) -> bytes:
    """Return a BLF; `start`: year, month, weekday, day, hour, minute, second, milliseconds."""
    fields = [*[0] * 8, claimed, *[0] * 3, *start, *[0] * 8]
    return struct.pack("<4sL8BQQLL8H8H", b"LOGG", header, *fields).ljust(header, b"\xff") + content


def _container(
    data: bytes, *, method: int = 2, claimed: int | None = None, packed: bytes | None = None
) -> bytes:
    packed = (data if method == 0 else zlib.compress(data, 1)) if packed is None else packed
    size = 32 + len(packed)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10)
    about = struct.pack("<H6xL4x", method, len(data) if claimed is None else claimed)
    return head + about + packed + bytes(size % 4)


def _read(raw: bytes) -> tuple[list[str], LogLoss]:
    ledger = LogLoss()
    batches = list(read_blf(io.BytesIO(raw), "a.blf", len(raw), ledger))
    return shown(FrameBatch.concatenate(batches)), ledger


CLASSIC = _object(1, _classic())
SEEN = "1500 0 123 8 0102030405060708 -"

OBJECTS = {
    "classic": (CLASSIC, SEEN),
    "10 us": (_object(1, _classic(), unit=1, stamp=3), "30000 0 123 8 0102030405060708 -"),
    "from 2100 on": (_object(1, _classic(), stamp=_CENTURY_NS + 1), BAD),
    "head of 40 bytes": (_object(1, _classic(), version=2), SEEN),
    "a byte short": (_object(1, _classic()[:-1]), BAD),
    "sent": (_object(1, _classic(flags=0x01)), f"{SEEN[:-1]}t"),
    "remote": (_object(1, _classic(flags=0x80)), "1500 0 123 8 0000000000000000 r"),
    "dlc 9": (_object(1, _classic(dlc=9)), SEEN),
    "bus 2": (_object(1, _classic(bus=2, dlc=0)), "1500 1 123 0 - -"),
    "bus 257": (_object(1, _classic(bus=257, dlc=0)), "1500 255 123 0 - -"),
    "11 bits": (_object(1, _classic(can_id=0x7FF, dlc=0)), "1500 0 7FF 0 - -"),
    "12 bits": (_object(1, _classic(can_id=0x800, dlc=0)), BAD),
    "error": (_object(2, struct.pack("<HHL", 3, 0, 0)), "1500 2 0 0 - e"),
    "error of 3 bytes": (_object(2, bytes(3)), BAD),
    "error with data": (_object(73, _error_ext(bus=2)), "1500 1 123 8 0102030405060708 e"),
    "error of 29 bits": (_object(73, _error_ext(dlc=0, can_id=0x80000004)), "1500 0 4 0 - xe"),
    "FD": (_object(100, _fd(bus=2)), "1500 1 123 8 0102030405060708 f"),
    "FD, 9 bytes short": (_object(100, _fd()[:-1]), BAD),
    "FD, dlc 9": (_object(100, _fd(dlc=9)), f"1500 0 123 12 {_64[:12].hex()} f"),
    "FD, dlc 15": (_object(100, _fd(dlc=15)), f"1500 0 123 64 {_64.hex()} f"),
    "FD, fast": (_object(100, _fd(dlc=0, fd=3)), "1500 0 123 0 - fb"),
    "FD, sent": (_object(100, _fd(dlc=0, flags=1)), "1500 0 123 0 - ft"),
    "classic in FD": (_object(100, _fd(dlc=9, fd=0)), SEEN),
    "FD 64": (_object(101, _fd_64(bus=2)), "1500 1 123 8 0102030405060708 f"),
    "FD 64, short": (_object(101, _fd_64(data=b"")[:-1]), BAD),
    "FD 64, 3 bytes": (
        _object(101, _fd_64(data=b"\1\2\3"), beyond=b"\xff" * 5),
        "1500 0 123 8 0102030000000000 f",
    ),
    "FD 64, extra": (_object(101, _fd_64(extra=75)), "1500 0 123 8 0102030000000000 f"),
    "FD 64, fast": (_object(101, _fd_64(flags=0x3000, dlc=0)), "1500 0 123 0 - fb"),
    "FD 64, sent": (_object(101, _fd_64(sent=1, dlc=0)), "1500 0 123 0 - ft"),
    "classic in FD 64": (_object(101, _fd_64(flags=0x6000, dlc=9)), SEEN),
    "FD error": (_object(104, b"\2\0\0\0"), "1500 1 0 0 - e"),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_by_itself(name: str) -> None:
    raw, expected = OBJECTS[name]
    frames, loss = _read(_file(_container(raw)))
    assert frames == ([] if expected == BAD else [expected])
    assert (loss.garbled, loss.bytes_cut) == (1 if expected == BAD else 0, 0)


def test_objects_of_all_kinds_keep_their_order_and_none_has_bytes_of_its_neighbour() -> None:
    kinds = [
        _object(101, _fd_64(dlc=15, data=_64[:40], can_id=1)),
        _object(1, _classic(can_id=2, dlc=1)),
        _object(1, _classic(can_id=0x800)),
        _object(100, _fd(can_id=3, dlc=1)),
        _object(2, bytes(8)),
        _object(101, _fd_64(dlc=1, can_id=4)),
        _object(1, _classic(can_id=5, dlc=0)),
    ]
    frames, loss = _read(_file(_container(b"".join(kinds))))
    assert frames == [
        f"1500 0 1 64 {_64[:40].hex()}{bytes(24).hex()} f",
        "1500 0 2 1 01 -",
        "1500 0 3 1 01 f",
        "1500 0 0 0 - e",
        "1500 0 4 1 01 f",
        "1500 0 5 0 - -",
    ]
    assert (loss.garbled, loss.bytes_cut) == (1, 0)
    assert "first 0x800 with 11 bits at 1970-01-01T00:00:00.000001500Z" in loss.text


@pytest.mark.parametrize(
    ("start", "first_ns"),
    [
        ((2025, 10, 4, 9, 8, 53, 20, 250), 1_760_000_000_250_000_000),
        ((1970, 1, 4, 1, 0, 0, 0, 1), 1_000_000),
        ((1969, 12, 3, 31, 23, 59, 59, 0), 0),
        ((2025, 13, 4, 9, 8, 53, 20, 250), 0),
        ((0, 0, 0, 0, 0, 0, 0, 7), 0),
    ],
)
def test_times_count_from_the_start_in_the_header_if_it_is_a_date(
    start: tuple[int, ...], first_ns: int
) -> None:
    frames, _ = _read(_file(_container(CLASSIC), start=start))
    assert frames[0].split()[0] == str(first_ns + 1500)


CHAINS = {
    "end to end": (CLASSIC * 2, 2, 0),
    "8 bytes between": (CLASSIC + bytes(8) + CLASSIC, 2, 8),
    "an object in a payload": (_object(1, _classic() + CLASSIC) + CLASSIC, 2, 0),
    "a byte less than whole": (CLASSIC + CLASSIC[:-1], 1, 47),
    "of no bytes": (_object(1, _classic(), size=0) * 9 + CLASSIC, 1, 9 * 48),
    "impossibly short": (_object(1, _classic(), size=31) + CLASSIC, 1, 48),
    "impossibly long": (_object(5, b"", size=(1 << 24) + 1) + CLASSIC, 1, 32),
    "after a gap": (CLASSIC + bytes(9) + CLASSIC + bytes(10) + CLASSIC + CLASSIC[:20], 3, 39),
}


@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_of_objects_and_the_bytes_that_are_none(name: str) -> None:
    content, frames, lost = CHAINS[name]
    found, loss = _read(_file(_container(content)))
    assert len(found) == frames
    assert (loss.garbled, loss.bytes_cut) == (0, lost)


CONTAINERS = {
    "packed": (_container(CLASSIC), 1, 0),
    "plain": (_container(CLASSIC, method=0), 1, 0),
    "another packing": (_container(CLASSIC, method=1, packed=bytes(10)), 0, 10),
    "16 MiB claimed": (_container(CLASSIC, claimed=1 << 24), 1, (1 << 24) - 48),
    "over 16 MiB claimed": (_container(b"", claimed=(1 << 24) + 1, packed=bytes(10)), 0, 10),
    "a bomb": (_container(bytes(99), packed=zlib.compress(bytes(1 << 20))), 0, 101),
    "a torn checksum": (_container(CLASSIC, packed=zlib.compress(CLASSIC)[:-1]), 1, 1),
    "no zlib": (_container(CLASSIC, packed=bytes(10)), 0, 48),
    "in two": (_container(CLASSIC[:20]) + _container(CLASSIC[20:]), 1, 0),
    "begun before a gap": (
        _container(CLASSIC + CLASSIC[:20]) + _container(b"", claimed=9, packed=bytes(9)),
        1,
        29,
    ),
    "cut within the head": (_container(CLASSIC)[:15], 0, 15),
    "cut within the data": (
        _container(CLASSIC, method=0) + _container(CLASSIC, method=0)[:-1],
        1,
        48,
    ),
}


@pytest.mark.parametrize("name", CONTAINERS)
def test_a_container_and_the_bytes_that_are_lost_with_it(name: str) -> None:
    content, frames, lost = CONTAINERS[name]
    found, loss = _read(_file(content))
    assert (len(found), loss.garbled, loss.bytes_cut) == (frames, 0, lost)
    begun = ("a bomb", "begun before a gap", "cut within the data")
    assert ("an object extends into lost data" in loss.text) is (name in begun)


def test_a_file_shorter_than_its_header_states_is_cut_off() -> None:
    raw = _file(_container(CLASSIC))
    for more, lost in ((0, 0), (1, 1), (1000, 1000)):
        stated = _file(_container(CLASSIC), claimed=len(raw) + more)
        assert _read(stated)[1].bytes_cut == lost


@pytest.mark.parametrize("header", [0, 71, 65_537])
def test_an_impossible_length_of_the_header_is_refused(header: int) -> None:
    with pytest.raises(InputError, match=f" {header} bytes"):
        _read(_file(_container(CLASSIC), header=header))


@pytest.mark.parametrize(
    ("raw", "what"),
    [(b"LOGG" + bytes(200), "its header has 0 bytes"), (_file(b"")[:71], "header")],
)
def test_what_is_no_blf_is_refused(raw: bytes, what: str) -> None:
    with pytest.raises(InputError, match=what):
        _read(raw)


def test_much_without_an_object_is_refused_and_behind_one_is_passed_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("daq.formats.blf.MAX_OBJECT_BYTES", 1 << 16)
    monkeypatch.setattr("daq.formats.blf.BLOCK_BYTES", 1 << 11)
    nothing = _container(bytes(1 << 15))
    assert _read(_file(nothing * 2))[1].bytes_cut == 1 << 16
    with pytest.raises(InputError, match="no object"):
        _read(_file(nothing * 2 + _container(bytes(1 << 11))))
    frames, loss = _read(_file(_container(CLASSIC) + nothing * 2 + _container(CLASSIC)))
    assert frames == [SEEN] * 2
    assert loss.bytes_cut == 1 << 16
