"""Raw logs of every format and tool, frame for frame: what each can hold is kept."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import can
import pytest

from daq.bus.source import HopLosses
from daq.formats.log import Log, read_log
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from dbc import FrameBatch

from .mixed import START_S, Frame, batch_of, frames_in, message, mixed

FRAMES = mixed(2000)
FD_CODES = {length: code for code, length in enumerate([*range(9), 12, 16, 20, 24, 32, 48, 64])}


def write_with_python_can(path: Path, frames: Iterable[Frame]) -> None:
    with can.Logger(path) as log:
        for frame in frames:
            log(message(frame))


def write_candump(path: Path, frames: Iterable[Frame]) -> None:
    """Write what candump -L of can-utils writes: error frames with payload, RTR with length."""
    lines = []
    for f in frames:
        can_id = f"{f.can_id | 0x20000000:08X}" if f.error else f"{f.can_id:03X}"
        can_id = f"{f.can_id:08X}" if f.extended else can_id
        body = f"R{f.length}" if f.remote else f.data.hex().upper()
        body = f"#{f.brs + 2 * f.esi:X}{body}" if f.fd else body
        stamp = f"({START_S + f.t_us // 10**6}.{f.t_us % 10**6:06d})"
        lines.append(f"{stamp} vcan{f.bus} {can_id}#{body} {'T' if f.sent else 'R'}\n")
    path.write_text("".join(lines))


def write_trc(path: Path, frames: Iterable[Frame]) -> None:
    """Write version 2.1 by its public description."""
    days = START_S / 86400 + 25569
    lines = [f";$FILEVERSION=2.1\n;$STARTTIME={days!r}\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n;\n"]
    for n, f in enumerate(frames, start=1):
        kind = "ER" if f.error else "RR" if f.remote else "DT"
        if f.fd:
            kind = {(0, 0): "FD", (1, 0): "FB", (1, 1): "FE", (0, 1): "BI"}[f.brs, f.esi]
        can_id = f"{f.can_id:08X}" if f.extended else f"{f.can_id:04X}"
        lines.append(
            f"{n:7} {f.t_us / 1000:13.3f} {kind} {f.bus + 1} {can_id:>8} {'Tx' if f.sent else 'Rx'}"
            f" -  {FD_CODES[f.length]:<4} {f.data.hex(' ').upper()}\n"
        )
        if n % 50 == 0:
            lines.append(
                f"{n:7} {f.t_us / 1000:13.3f} ST {f.bus + 1}     - Rx -  4    00 00 00 08\n"
            )
    path.write_text("".join(lines))


def write_journal(path: Path, frames: list[Frame]) -> None:
    head = JournalHead("", "", "test", START_S * 10**9, 0)
    with JournalWriter(path.parent, head) as journal:
        for first in range(0, len(frames), 300):
            journal.append(batch_of(frames[first : first + 300]), HopLosses())
    next(path.parent.glob("journal_*.bbj")).rename(path)  # the segment got its name at its end


def everything(frame: Frame) -> Frame:
    return frame


def without_error_details(frame: Frame) -> Frame:
    if not frame.error:
        return frame
    return replace(frame, can_id=0, length=0, data=b"", extended=False, sent=False)


def by_python_can_in_candump(frame: Frame) -> Frame:
    """Its writer gives every error frame the same class, and remote frames no length."""
    if frame.error:
        return replace(frame, can_id=0x80)
    return replace(frame, length=0) if frame.remote else frame


def in_csv(frame: Frame) -> Frame:
    long = frame.length > 8
    return replace(frame, fd=long, brs=False, esi=False, bus=0, sent=False)


CASES: dict[str, tuple[str, Callable[[Path, list[Frame]], None], Callable[[Frame], Frame]]] = {
    "blf": (".blf", write_with_python_can, everything),
    "asc": (".asc", write_with_python_can, without_error_details),
    "candump": (".log", write_candump, everything),
    "candump by python-can": (".log", write_with_python_can, by_python_can_in_candump),
    "csv": (".csv", write_with_python_can, in_csv),
    "trc": (".trc", write_trc, without_error_details),
    "mf4": (".mf4", write_with_python_can, everything),
    "journal": (".bbj", write_journal, everything),
}


def read_all(path: Path) -> tuple[Log, FrameBatch]:
    log = read_log(path)
    return log, FrameBatch.concatenate(list(log))


@pytest.mark.parametrize("case", CASES)
def test_every_kind_of_frame_is_kept(tmp_path: Path, case: str) -> None:
    suffix, write, held = CASES[case]
    path = tmp_path / f"mixed{suffix}"
    frames = FRAMES[:400] if suffix == ".mf4" else FRAMES  # its writer takes 0.1 ms a frame
    write(path, frames)
    log, batch = read_all(path)
    assert not log.loss.any, log.loss.text
    assert log.hops == HopLosses()
    assert log.frames == len(frames)
    found = frames_in(batch)
    for got, sent in zip(found, frames, strict=True):
        assert got == held(sent)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".csv", ".trc"])
def test_our_reader_agrees_with_python_can_where_that_is_right(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"plain{suffix}"
    plain = [f for f in FRAMES if not (f.fd or f.remote or f.error)]
    write_with_python_can(path, plain)
    theirs = list(can.LogReader(path, relative_timestamp=False))
    ours = read_all(path)[1]
    assert ours.can_id.tolist() == [m.arbitration_id for m in theirs]
    assert [row[:n].tobytes() for row, n in zip(ours.data, ours.length, strict=True)] == [
        bytes(m.data) for m in theirs
    ]
    assert ours.t_ns.tolist() == pytest.approx([m.timestamp * 1e9 for m in theirs], abs=600)


# Logs of loggers and other tools ------------------------------------------------------------------


def read_frames(path: Path) -> tuple[Log, list[Frame]]:
    log = read_log(path)
    return log, frames_in(FrameBatch.concatenate(list(log)))


@pytest.mark.parametrize("packed", [False, True])
def test_every_frame_of_an_unfinished_mf4_is_kept_whatever_the_file_is_called(
    tmp_path: Path, packed: bool
) -> None:
    path = tmp_path / "a.mf4"
    write_with_python_can(path, FRAMES[:800])
    raw = path.read_bytes().replace(b"MDF     ", b"UnFinMF ", 1)
    path = path.rename(tmp_path / "a.dat")
    path.write_bytes(gzip.compress(raw, 1) if packed else raw)
    log, found = read_frames(path)
    assert found == FRAMES[:800]
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
    log, frames = read_frames(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False)] * 20 + [(0x800, True)]
    assert "1 records unreadable" in log.loss.text
    assert "800" in log.loss.text.split("; ")[1]
    if name != ".asc":
        assert "first 0x800 with 11 bits at 2025-10-09T08:53:20.02" in log.loss.text


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
    log, found = read_frames(path)
    assert not log.loss.any
    assert [(f.fd, f.length, f.data) for f in found] == [
        (fd, length, bytes([0x11 if base == "hex" else 11] * length)),
        (False, 2, bytes([0x11 if base == "hex" else 11] * 2)),
    ]


def test_mf4_that_counts_buses_from_0(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    one = [replace(f, bus=1) for f in FRAMES[:20]]
    write_with_python_can(path, one)
    assert {f.bus for f in read_frames(path)[1]} == {0}
    write_with_python_can(path, [replace(FRAMES[0], bus=0), *one])
    assert {f.bus for f in read_frames(path)[1]} == {0, 1}


def test_an_mf4_without_the_kind_of_identifiers_has_29_bits_where_11_do_not_do(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.mf4"
    plain = replace(FRAMES[0], length=1, data=b"\x12")
    write_with_python_can(path, [replace(plain, can_id=n, t_us=n) for n in (0x7FF, 0x800)])
    path.write_bytes(path.read_bytes().replace(b"CAN_DataFrame.IDE", b"CAN_DataFrame.IDQ"))
    log, frames = read_frames(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False), (0x800, True)]
    assert not log.loss.any
