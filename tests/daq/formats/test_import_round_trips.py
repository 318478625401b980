"""2,000 mixed frames through each raw format: what it can hold is kept, digit for digit."""

from __future__ import annotations

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
