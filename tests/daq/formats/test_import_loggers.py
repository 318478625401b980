"""Logs of loggers and other tools, opened by what stands in them: frame for frame."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import pytest

from daq.formats.log import Log, read_log
from dbc import FrameBatch

from .loggers import write_logger_mf4
from .mixed import Frame, frames_in, mixed
from .test_import_round_trips import write_with_python_can

FRAMES = mixed(800)


def read_all(path: Path) -> tuple[Log, list[Frame]]:
    log = read_log(path)
    return log, frames_in(FrameBatch.concatenate(list(log)))


@pytest.mark.parametrize("packed", [False, True])
def test_every_frame_of_an_unfinished_mf4_is_kept_whatever_the_file_is_called(
    tmp_path: Path, packed: bool
) -> None:
    path = tmp_path / "a.dat"
    write_logger_mf4(path, FRAMES)
    if packed:
        path.write_bytes(gzip.compress(path.read_bytes(), 1))
    log, found = read_all(path)
    assert found == FRAMES
    assert not log.loss.any, log.loss.text
    assert log.share == 1.0


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".csv"])
def test_old_formats_are_opened_by_content_and_packed(tmp_path: Path, suffix: str) -> None:
    plain = [f for f in FRAMES[:200] if not (f.fd or f.remote or f.error)]
    written = tmp_path / f"a{suffix}"
    write_with_python_can(written, plain)
    truth = read_all(written)[1]
    packed = tmp_path / "b.gz"
    packed.write_bytes(gzip.compress(written.read_bytes(), 1))
    log, found = read_all(packed)
    assert found == truth
    assert len(found) == len(plain)
    assert not log.loss.any


def test_mf4_that_counts_buses_from_0(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    one = [replace(f, bus=1) for f in FRAMES[:20]]
    write_with_python_can(path, one)
    assert {f.bus for f in read_all(path)[1]} == {0}
    write_with_python_can(path, [replace(FRAMES[0], bus=0), *one])
    assert {f.bus for f in read_all(path)[1]} == {0, 1}


@pytest.mark.parametrize("name", [".mf4", ".blf", ".asc"])
def test_a_frame_whose_identifier_cannot_be_is_left_out_and_named(
    tmp_path: Path, name: str
) -> None:
    write = write_logger_mf4 if name == ".mf4" else write_with_python_can
    path = tmp_path / f"a{name}"
    plain = replace(FRAMES[0], can_id=0x7FF, length=1, data=b"\x12")
    kept = [replace(plain, t_us=n * 1000) for n in range(20)]
    kept.append(replace(kept[-1], t_us=30_000, can_id=0x800, extended=True))
    write(path, [*kept, replace(plain, t_us=25_000, can_id=0x800)])
    log, frames = read_all(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False)] * 20 + [(0x800, True)]
    assert "1 records unreadable" in log.loss.text
    assert "800" in log.loss.text.split("; ")[1]
    if name != ".asc":
        assert "first 0x800 with 11 bits at 2025-10-09T08:53:20.025000" in log.loss.text


def test_an_mf4_without_the_kind_of_identifiers_has_29_bits_where_11_do_not_do(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.mf4"
    plain = replace(FRAMES[0], length=1, data=b"\x12")
    write_logger_mf4(path, [replace(plain, can_id=n, t_us=n) for n in (0x7FF, 0x800)])
    path.write_bytes(path.read_bytes().replace(b"CAN_DataFrame.IDE", b"CAN_DataFrame.IDQ"))
    log, frames = read_all(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False), (0x800, True)]
    assert not log.loss.any


CLASSIC = [f for f in mixed(400, seed=3) if not (f.fd or f.remote or f.error)]


@pytest.mark.parametrize("suffix", [".asc", ".log", ".csv", ".trc"])
def test_a_last_line_without_an_end_is_read_if_it_is_whole(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "a.txt"
    frames = [replace(f, length=4, data=f.data[:4].ljust(4, b"\x12"), can_id=5) for f in CLASSIC]
    written = tmp_path / f"a{suffix}"
    write_with_python_can(written, frames)
    written.rename(path)
    lines = path.read_bytes().split(b"\n")
    lines = lines[: next(i for i in reversed(range(len(lines))) if b"12" in lines[i]) + 1]
    whole = b"\n".join(lines).rstrip(b" ,\r")
    path.write_bytes(whole)
    log, found = read_all(path)
    assert not log.loss.any
    path.write_bytes(whole + b"\n")
    assert read_all(path)[1] == found
    # With one character less it is another frame, or none: it is not read.
    path.write_bytes(whole[:-1] if whole[-1:] not in b"TR" else whole[:-3])
    log, cut = read_all(path)
    assert cut == found[:-1]
    assert "has no end" in log.loss.text


def test_frames_of_fd_in_an_asc_that_does_not_mark_them(tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    long, short = "01 " * 12, "01 " * 4
    path.write_text(
        "date Thu Oct 09 08:53:20.000 2025\nbase hex  timestamps absolute\n"
        f"   0.1 CANFD   1 Rx  100  0 0 9 12 {long} 0 0 11 0\n"
        f"   0.2 CANFD   1 Rx  100  1 0 4  4 {short} 0 0 11 0\n"
        f"   0.3 CANFD   1 Rx  100  0 0 4  4 {short} 0 0 11 0\n"
        f"   0.4 1  123x            Rx   d 40 {'07 ' * 64}\n"
    )
    log, found = read_all(path)
    assert [(f.fd, f.brs, f.length) for f in found] == [
        (True, False, 12),
        (True, True, 4),
        (False, False, 4),
        (True, False, 64),
    ]
    assert not log.loss.any


@pytest.mark.parametrize("tail", ["", "  Length = 240000 BitCount = 124 ID = 256"])
@pytest.mark.parametrize("base", ["hex", "dec"])
@pytest.mark.parametrize(
    ("code", "n_bytes", "fd", "length"),
    [
        ("8", 8, False, 8),
        ("9", 8, False, 8),  # a classic frame may state more than its 8 bytes
        ("9", 12, True, 12),
        ("10", 16, True, 16),
        ("14", 48, True, 48),
        ("15", 64, True, 64),
        ("9", 11, False, 8),  # more bytes than 8, and not those of the DLC
    ],
)
def test_frames_of_fd_in_the_short_form_by_a_dlc_in_decimal(
    tmp_path: Path, tail: str, base: str, code: str, n_bytes: int, fd: bool, length: int
) -> None:
    path = tmp_path / "a.asc"
    data = " ".join(["11"] * n_bytes)
    path.write_text(
        f"date Fri Feb 14 08:51:20 am 2020\nbase {base}  timestamps absolute\n"
        f"  348.174650 1 123  Rx d {code} {data}{tail}\n"
        "  348.174700 1 123  Rx d 2 11 11\n"
    )
    log, found = read_all(path)
    assert not log.loss.any
    assert [(f.fd, f.length, f.data) for f in found] == [
        (fd, length, bytes([0x11 if base == "hex" else 11] * length)),
        (False, 2, bytes([0x11 if base == "hex" else 11] * 2)),
    ]


def test_a_remote_frame_in_the_long_form_whatever_its_other_bits_are(tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    path.write_text(
        "date Sam Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\n"
        "  30.300981 CANFD   3 Tx   50005x  0 1 5 0 140000 73 200050 7a60 46500250 0\n"
        "  30.400000 CANFD   3 Tx   50005x  0 1 5 0 140000 73 200040 7a60 46500250 0\n"
        "  30.500000 CANFD   3 Tx   50005x  0 1 5 0 140000 73 201050 7a60 46500250 0\n"
    )
    found = read_all(path)[1]
    assert [(f.remote, f.fd, f.esi, f.length) for f in found] == [
        (True, False, False, 5),
        (False, True, True, 0),
        (False, True, True, 0),
    ]
