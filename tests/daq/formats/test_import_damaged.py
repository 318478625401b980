"""Damaged, foreign and hostile logs: what is whole is read, what is missing is counted."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from daq.errors import InputError
from daq.formats.log import read_log
from dbc import FrameBatch

from .mixed import START_S, Frame, frames_in, mixed
from .test_import_round_trips import write_journal, write_with_python_can

TEXTS = (".asc", ".log", ".csv", ".trc")
PLAIN = [f for f in mixed(12_000) if not (f.fd or f.remote or f.error)]


def _container(data: bytes, claimed: int | None = None, packed: bytes | None = None) -> bytes:
    packed = zlib.compress(data) if packed is None else packed
    size = 32 + len(packed)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10)
    about = struct.pack("<H6xL4x", 2, len(data) if claimed is None else claimed)
    return head + about + packed + bytes(size % 4)


def _object(size: int = 48, can_id: int = 0x123, stamp_ns: int = 0) -> bytes:
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, size, 1, 2, 0, 0, stamp_ns)
    return head + struct.pack("<HBBL8s", 1, 0, 8, can_id, b"12345678")


def _blf(path: Path, *containers: bytes) -> Path:
    header = struct.pack("<4sL8BQQLL8H8H", b"LOGG", 144, *[0] * 28)
    path.write_bytes(header.ljust(144, b"\0") + b"".join(containers))
    return path


def _read(path: Path) -> tuple[list[Frame], str]:
    log = read_log(path)
    return frames_in(FrameBatch.concatenate(list(log))), log.loss.text


@pytest.mark.parametrize("suffix", TEXTS)
def test_a_text_log_cut_off_gives_every_whole_line(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write_with_python_can(path, PLAIN)
    frames = _read(path)[0]
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) * 2 // 3])
    found, lost = _read(path)
    assert 0.6 * len(frames) < len(found) < 0.7 * len(frames)
    assert found == frames[: len(found)]
    assert "cut off" in lost
    assert "has no end" in lost


@pytest.mark.parametrize("suffix", TEXTS)
def test_a_line_that_is_no_frame_is_counted_and_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write_with_python_can(path, PLAIN[:100])
    frames = _read(path)[0]
    lines = path.read_bytes().split(b"\n")
    row = next(i for i in range(40, 60) if len(lines[i]) > 20)
    whole = lines[row]
    # Cut within the payload: the rest of the line is gone, but the line has an end.
    lines[row] = whole.rstrip()[: -5 if suffix == ".log" else -2]
    path.write_bytes(b"\n".join(lines))
    found, lost = _read(path)
    assert len(found) == len(frames) - 1
    assert [f for f in frames if f not in found]
    assert f"1 records unreadable; line {row + 1} " in lost


def test_a_blf_cut_off_gives_every_whole_object(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    write_with_python_can(path, PLAIN)
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    found, lost = _read(path)
    assert 0.4 * len(PLAIN) < len(found) < 0.6 * len(PLAIN)
    assert found == PLAIN[: len(found)]
    assert "bytes that its header states" in lost


def test_a_damaged_container_takes_nothing_else_with_it(tmp_path: Path) -> None:
    # Objects 2 and 5 lie across the ends of containers; the middle one is lost, and what was
    # begun before it must not go on after it.
    data = b"".join(_object(can_id=n, stamp_ns=n * 1000) for n in range(7))
    pieces = [data[:120], data[120:270], data[270:]]
    broken = bytearray(zlib.compress(pieces[1]))
    broken[-1] ^= 1  # only the checksum knows
    path = _blf(
        tmp_path / "a.blf",
        _container(pieces[0]),
        _container(pieces[1], packed=bytes(broken)),
        _container(pieces[2]),
    )
    found, lost = _read(path)
    assert [frame.can_id for frame in found] == [0, 1, 6]
    assert "cannot be unpacked" in lost
    whole = _blf(tmp_path / "b.blf", *map(_container, pieces))
    assert [frame.can_id for frame in _read(whole)[0]] == list(range(7))


def test_a_cut_journal_gives_its_whole_blocks(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_journal(path, PLAIN[:1200])
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    found, lost = _read(path)
    assert found == PLAIN[: len(found)]
    assert len(found) % 300 == 0
    assert found
    assert "torn" in lost


HOSTILE = {
    "empty": (".blf", b"", "is empty"),
    "text as BLF": (".blf", b"hello\n" * 100, "no line of a known log"),
    "half a header": (".blf", b"LOGG" + bytes(20), "cut off within its header"),
    "text as MF4": (".mf4", b"hello\n" * 100, "no line of a known log"),
    "MF4 of nothing": (".mf4", b"MDF     4.10    " + bytes(100), "cannot be read"),
    "text as journal": (".mcap", b"hello\n" * 100, "no line of a known log"),
    "no log": (".xyz", b"hello", "no line of a known log"),
    **{f"noise {s}": (s, bytes(range(256)) * 4000, "no line of a known log") for s in TEXTS},
    **{
        f"prose {s}": (s, b"It was a dark night.\n" * 9000, "no line of a known log") for s in TEXTS
    },
    **{f"one line {s}": (s, b"a" * 1_000_000, "no line of a known log") for s in TEXTS},
}


@pytest.mark.parametrize("case", HOSTILE)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    suffix, content, why = HOSTILE[case]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=why) as caught:
        list(read_log(path))
    assert "\n" not in str(caught.value)


def test_claims_of_a_blf_are_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    good, more = (
        _container(b"".join(_object(stamp_ns=first + n) for n in range(3))) for first in (1, 10)
    )
    claims = {
        "container of 1 GB": _container(_object(stamp_ns=9), claimed=1 << 30),
        "object of 1 GB": _container(_object(1 << 30) + _object(stamp_ns=9)),
        "object of no bytes": _container(_object(0) * 100 + _object(stamp_ns=9)),
        "bomb": _container(bytes(1000), packed=zlib.compress(bytes(1 << 24))),
    }
    for name, container in claims.items():
        found, lost = _read(_blf(path, good, container, more))
        assert len(found) in (6, 7), name
        assert lost, name
    with pytest.raises(InputError, match="has no object"):
        list(read_log(_blf(path, *[_container(bytes(1 << 23))] * 4)))


def test_events_that_a_blf_states_as_lost_are_counted(tmp_path: Path) -> None:
    lost = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 48, 126, 2, 0, 0, 1_500_000_000)
    lost += struct.pack("<LQL", 0, 1_000_000_000, 17)
    path = _blf(tmp_path / "a.blf", _container(_object() + lost + _object(stamp_ns=1)))
    found, text = _read(path)
    assert len(found) == 2
    assert text == (
        "17 frames lost by its recorder; the log states 17 lost events at "
        "1970-01-01T00:00:01.500000000Z"
    )


def test_an_object_of_another_kind_is_no_loss(tmp_path: Path) -> None:
    other = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 40, 5, 2, 0, 0, 0) + bytes(8)
    path = _blf(tmp_path / "a.blf", _container(_object() + other + _object(stamp_ns=1)))
    found, lost = _read(path)
    assert len(found) == 2
    assert not lost


def test_asc_times_are_absolute_in_whatever_way_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    body = " {} 1  100             Rx   d 1 01\n" * 3
    for date in ("Thu Oct 09 08:53:20.500 am 2025", "Don Okt 09 08:53:20.500 2025"):
        heads = {
            "absolute": ("0.250000", "0.500000", "1.000000"),
            "relative": ("0.250000", "0.250000", "0.500000"),
        }
        for kind, stamps in heads.items():
            text = f"date {date}\nbase hex  timestamps {kind}\n" + body.format(*stamps)
            path.write_text(text, "utf-8")
            times = [frame.t_us for frame in _read(path)[0]]
            assert [t - times[0] for t in times] == [0, 250_000, 750_000], (date, kind)
            # The date is local time: zones differ by whole quarters of an hour.
            first_us = (times[0] + START_S * 10**6) % 900_000_000
            assert first_us == (8 * 60 + 20) * 10**6 + 750_000, (date, kind)


def test_asc_in_decimal_with_names_and_classic_frames_in_the_long_form(tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    path.write_text(
        "date Thu Oct 09 08:53:20.000 2025\nbase dec  timestamps absolute\n"
        "// a comment\n"
        "   0.100000 1  1000            Rx   d 2 10 255  Length = 0 BitCount = 64\n"
        "   0.200000 CANFD   2 Tx      100  Engine  1 0 8  8 1 2 3 4 5 6 7 8  0 0 12288 0\n"
        "   0.300000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n"
        "   0.400000 2  ErrorFrame\n"
    )
    frames, lost = _read(path)
    assert not lost
    assert [(f.can_id, f.length, f.bus, f.error) for f in frames] == [
        (1000, 2, 0, False),
        (100, 8, 1, False),
        (0, 0, 1, True),
    ]
    assert frames[0].data == bytes([10, 255])
    assert frames[1].sent
    assert frames[1].data == bytes(range(1, 9))


def test_versions_of_trc(tmp_path: Path) -> None:
    path = tmp_path / "a.trc"
    payload = "01 02 03"
    rows = {
        "1.0": f"     1)      1500 0123 3 {payload}\n     2)  1600 12345678 2 RTR\n",
        "1.1": f"     1)    1500.0  Rx  0123  3  {payload}\n     2)  1600.0  Tx 12345678 2 RTR\n",
        "1.3": f" 1)  1500.000 2  Rx  0123 -  3  {payload}\n 2)  1600.000 2 Tx 12345678 - 2 RTR\n",
        "2.0": f" 1  1500.000 DT  0123 Rx 3  {payload}\n 2  1600.000 RR 12345678 Tx 2\n",
    }
    for version, text in rows.items():
        head = "" if version == "1.0" else f";$FILEVERSION={version}\n;$STARTTIME=45939.25\n"
        path.write_text(head + text)
        frames, lost = _read(path)
        assert not lost, version
        assert [(f.can_id, f.length, f.data, f.remote, f.extended) for f in frames] == [
            (0x123, 3, bytes([1, 2, 3]), False, False),
            (0x12345678, 2, b"", True, True),
        ], version
        assert frames[1].t_us - frames[0].t_us == 100_000
