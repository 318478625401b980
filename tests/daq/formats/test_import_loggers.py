"""Logs of loggers and other tools, opened by what stands in them: frame for frame."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import pytest

from daq.formats.log import Log, read_log
from dbc import FrameBatch

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
    path = tmp_path / "a.mf4"
    write_with_python_can(path, FRAMES)
    raw = path.read_bytes().replace(b"MDF     ", b"UnFinMF ", 1)
    path = path.rename(tmp_path / "a.dat")
    path.write_bytes(gzip.compress(raw, 1) if packed else raw)
    log, found = read_all(path)
    assert found == FRAMES
    assert not log.loss.any, log.loss.text
    assert log.share == 1.0


@pytest.mark.parametrize("name", [".mf4", ".blf", ".asc"])
def test_a_frame_whose_identifier_cannot_be_is_left_out_and_named(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / f"a{name}"
    plain = replace(FRAMES[0], can_id=0x7FF, length=1, data=b"\x12")
    kept = [replace(plain, t_us=n * 1000) for n in range(20)]
    kept.append(replace(kept[-1], t_us=30_000, can_id=0x800, extended=True))
    write_with_python_can(path, [*kept, replace(plain, t_us=25_000, can_id=0x800)])
    log, frames = read_all(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False)] * 20 + [(0x800, True)]
    assert "1 records unreadable" in log.loss.text
    assert "800" in log.loss.text.split("; ")[1]
    if name != ".asc":
        assert "first 0x800 with 11 bits at 2025-10-09T08:53:20.025000" in log.loss.text


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


def test_mf4_that_counts_buses_from_0(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    one = [replace(f, bus=1) for f in FRAMES[:20]]
    write_with_python_can(path, one)
    assert {f.bus for f in read_all(path)[1]} == {0}
    write_with_python_can(path, [replace(FRAMES[0], bus=0), *one])
    assert {f.bus for f in read_all(path)[1]} == {0, 1}


def test_an_mf4_without_the_kind_of_identifiers_has_29_bits_where_11_do_not_do(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.mf4"
    plain = replace(FRAMES[0], length=1, data=b"\x12")
    write_with_python_can(path, [replace(plain, can_id=n, t_us=n) for n in (0x7FF, 0x800)])
    path.write_bytes(path.read_bytes().replace(b"CAN_DataFrame.IDE", b"CAN_DataFrame.IDQ"))
    log, frames = read_all(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False), (0x800, True)]
    assert not log.loss.any
