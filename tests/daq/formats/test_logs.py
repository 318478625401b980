"""Logs of raw frames: read whole, cut anywhere, damaged, or none at all; and as we write them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
from numpy.testing import assert_allclose

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.formats.columns import read_columns
from daq.formats.export import ExportFormat, export_session
from daq.formats.log import BLF, Log, detect, read_logs
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from dbc import FrameBatch
from dbc.frames import FrameFlag
from dbc.words import InputError

from ..crash_frames import block
from ..small_session import mixed_frames, small_session
from .mixed import START_S, Frame, batch_of, frames_in, message, mixed

FRAMES = mixed(640)
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


def read(path: Path) -> tuple[Log, list[Frame]]:
    """Return a log after it was read, and its frames."""
    log = Log([path])
    return log, frames_in(FrameBatch.concatenate(list(log)))


@pytest.mark.parametrize("case", CASES)
def test_every_kind_of_frame_is_kept(tmp_path: Path, case: str) -> None:
    suffix, write, held = CASES[case]
    path = tmp_path / f"mixed{suffix}"
    write(path, FRAMES)
    log, frames = read(path)
    assert not log.loss.any, log.loss.text
    assert log.hops == HopLosses()
    assert log.frames == len(FRAMES)
    assert frames == [held(sent) for sent in FRAMES]


# Logs of loggers and other tools ------------------------------------------------------------------


def test_every_frame_of_an_unfinished_mf4_is_kept_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    write_with_python_can(path, FRAMES)
    raw = path.read_bytes().replace(b"MDF     ", b"UnFinMF ", 1)
    path = path.rename(tmp_path / "a.dat")
    path.write_bytes(raw)
    log, found = read(path)
    assert found == FRAMES
    assert not log.loss.any, log.loss.text
    assert log.read_fraction == 1.0


@pytest.mark.parametrize("name", [".mf4", ".blf", ".asc"])
def test_a_frame_whose_identifier_cannot_be_is_left_out_and_named(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / f"a{name}"
    plain = replace(FRAMES[0], can_id=0x7FF, length=1, data=b"\x12")
    kept = [replace(plain, t_us=n * 1000) for n in range(20)]
    kept.append(replace(kept[-1], t_us=30_000, can_id=0x800, extended=True))
    write_with_python_can(path, [*kept, replace(plain, t_us=25_000, can_id=0x800)])
    log, frames = read(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False)] * 20 + [(0x800, True)]
    assert "1 record unreadable" in log.loss.text
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
    log, found = read(path)
    assert not log.loss.any
    assert [(f.fd, f.length, f.data) for f in found] == [
        (fd, length, bytes([0x11 if base == "hex" else 11] * length)),
        (False, 2, bytes([0x11 if base == "hex" else 11] * 2)),
    ]


def test_mf4_that_counts_buses_from_0(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    one = [replace(f, bus=1) for f in FRAMES[:20]]
    write_with_python_can(path, one)
    assert {f.bus for f in read(path)[1]} == {0}
    write_with_python_can(path, [replace(FRAMES[0], bus=0), *one])
    assert {f.bus for f in read(path)[1]} == {0, 1}


def test_an_mf4_without_the_kind_of_identifiers_has_29_bits_where_11_do_not_do(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.mf4"
    plain = replace(FRAMES[0], length=1, data=b"\x12")
    write_with_python_can(path, [replace(plain, can_id=n, t_us=n) for n in (0x7FF, 0x800)])
    path.write_bytes(path.read_bytes().replace(b"CAN_DataFrame.IDE", b"CAN_DataFrame.IDQ"))
    log, frames = read(path)
    assert [(f.can_id, f.extended) for f in frames] == [(0x7FF, False), (0x800, True)]
    assert not log.loss.any


# Logs that are damaged, or that are none: what is whole comes out -------------------------------


TEXTS = (".asc", ".log", ".csv", ".trc")
PLAIN = [f for f in mixed(2400) if not (f.fd or f.remote or f.error)]


@pytest.mark.parametrize("suffix", TEXTS)
def test_a_text_log_cut_off_gives_every_whole_line(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.formats.reader.BLOCK_BYTES", 1 << 12)
    path = tmp_path / f"a{suffix}"
    write_with_python_can(path, PLAIN)
    _, frames = read(path)
    raw = path.read_bytes()
    path.write_bytes(raw[: raw.index(b"\n", len(raw) * 2 // 3) - 4])
    log, found = read(path)
    assert 0.6 * len(frames) < len(found) < 0.7 * len(frames)
    assert found == frames[: len(found)]
    assert "cut off" in log.loss.text
    assert "has no end" in log.loss.text


HOSTILE = {
    "empty": (".blf", b"", "is empty"),
    "text as BLF": (".blf", b"hello\n" * 100, "no line of a known log"),
    "half a header": (".blf", b"LOGG" + bytes(20), "cut off within its header"),
    "text as MF4": (".mf4", b"hello\n" * 100, "no line of a known log"),
    "MF4 of nothing": (".mf4", b"MDF     4.10    " + bytes(100), "cannot be read"),
    "text as journal": (".bbj", b"hello\n" * 100, "no line of a known log"),
    "no log": (".xyz", b"hello", "no line of a known log"),
    **{f"noise {s}": (s, bytes(range(256)) * 300, "no line of a known log") for s in TEXTS},
    **{f"prose {s}": (s, b"It was a dark night.\n" * 40, "no line of a known log") for s in TEXTS},
    "zeros": (".log", bytes(100), "begins with no line"),
    **{f"one line {s}": (s, b"a" * 70_000, "no line of a known log") for s in TEXTS},
}


def test_a_cut_journal_gives_its_whole_blocks(tmp_path: Path) -> None:
    path = tmp_path / "a.bbj"
    write_journal(path, PLAIN[:1200])
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    log, found = read(path)
    assert found == PLAIN[: len(found)]
    assert len(found) % 300 == 0
    assert found
    assert "are no whole block" in log.loss.text


@pytest.mark.parametrize("case", HOSTILE)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    suffix, content, why = HOSTILE[case]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=why) as caught:
        list(Log([path]))
    assert "\n" not in str(caught.value)


# The format is found by the content ---------------------------------------------------------------

ASC, TRC, CANDUMP = "1.5 1 7FF Rx d 1 11\n", "1) 1 0123 1 AA\n", "(1.5) can0 123#01\n"
HEADS: dict[str, tuple[str, str, str]] = {
    "candump": ("a.txt", CANDUMP, "candump"),
    "ASC": ("a.txt", ASC, "ASC"),
    "TRC": ("a.txt", TRC, "TRC"),
    "as much of both": ("a.txt", TRC + ASC, "ASC"),
    "more of one than the name says": ("a.trc", TRC + ASC * 2, "ASC"),
    "more than half of it is none": ("a.txt", TRC + "some more words\n" * 2, ""),
    "a head alone": ("a.txt", ";$FILEVERSION=1.0\n", "TRC"),
    "a head and one line that is none": ("a.txt", ";$FILEVERSION=1.0\nsome more words\n", ""),
    "one line without an end": ("a.txt", TRC[:-1], "TRC"),
    "blank lines": ("a.txt", "\n \n" + CANDUMP, "candump"),
}


@pytest.mark.parametrize("name", HEADS)
def test_the_format_of_a_text_log(tmp_path: Path, name: str) -> None:
    file, text, form = HEADS[name]
    path = tmp_path / file
    path.write_bytes(text.encode())
    if form:
        assert detect(path).name == form
        return
    with pytest.raises(InputError, match="no line of a known log"):
        detect(path)


BINARIES = {"BLF": b"LOGG", "MF4": b"MDF     ", "journal": b"\xb5BUMP\r\n\x01"}


@pytest.mark.parametrize("name", BINARIES)
def test_the_format_of_a_binary_log(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(BINARIES[name] + bytes(100))
    assert detect(path).name == name


def test_segments_of_a_journal_that_follow_each_other_are_one_log(tmp_path: Path) -> None:
    head = JournalHead("", "", "test", 1_800_000_000 * 10**9, 0)
    with JournalWriter(tmp_path, head, RecorderConfig(reserve_bytes=0.0)) as journal:
        for k in range(3):
            journal.append(block(2 * k, 2), HopLosses())
            journal.cut()
        segments = list(journal.paths)
    other = tmp_path / "a.log"
    other.write_text(CANDUMP)
    found = read_logs([*segments[:2], other, segments[2]])
    assert [log.paths for log in found] == [tuple(segments[:2]), (other,), (segments[2],)]
    assert sum(len(batch) for batch in found[0]) == 4


def test_what_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory"):
        detect(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        detect(tmp_path / "absent")
    with pytest.raises(InputError, match=r"too long|no such file"):  # Python 3.14: none
        detect(tmp_path / ("a" * 300))
    with pytest.raises(InputError, match="not a regular file"):
        detect(Path("/dev/null"))
    unreadable = Path("/proc/self/mem")  # a regular file whose first byte cannot be read
    with pytest.raises(InputError, match="cannot be read"):
        detect(unreadable)
    with pytest.raises(InputError, match="cannot be read"):
        read_columns(unreadable, ())
    with pytest.raises(InputError, match="cannot be read"):
        list(Log([unreadable], BLF))


def test_frames_and_the_share_that_was_read_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.formats.reader.BLOCK_BYTES", 1 << 12)
    path = tmp_path / "a.log"
    lines = [f"(1.{n:06d}) can0 123#01\n" for n in range(500)]
    for row in (10, 12, 177):  # out of line, the last at the end of a block: no later part
        lines[row] = "(5000.000) can0 123#01\n"
    path.write_text("".join(lines))
    log = Log([path])
    assert (log.read_fraction, log.frames) == (0.0, 0)
    seen = [(log.read_fraction, log.frames) for _ in log]
    assert seen[0][1] < 500
    assert 0.0 < seen[0][0] < 1.0
    assert [share for share, _ in seen] == sorted(share for share, _ in seen)
    assert (log.read_fraction, log.frames, log.loss.garbled, log.remarks) == (1.0, 497, 3, [])
    assert [t.split("at frame ")[-1] for t in log.loss.text.split("; ")[1:]] == ["11", "178"]


def test_a_log_without_a_frame_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.trc"
    path.write_text(";$FILEVERSION=1.0\n")
    with pytest.raises(InputError, match=r"no frame \(TRC\)"):
        list(Log([path]))


# Raw frames as other tools read them: what a format can hold is kept, the rest is said -----------

SENT = mixed_frames(300)
IS_ERROR = (SENT.flags & FrameFlag.ERROR) != 0


def _messages(frames: FrameBatch, path: Path, form: ExportFormat) -> list[can.Message]:
    export_session(small_session(frames), path, form)
    options = {"relative_timestamp": False} if form is ExportFormat.ASC else {}
    with can.LogReader(path, **options) as reader:
        return list(reader)


FIELDS = {
    *("arbitration_id", "is_extended_id", "is_remote_frame", "is_error_frame", "is_fd", "channel"),
    *("bitrate_switch", "error_state_indicator", "is_rx", "dlc", "data"),
}


def _is_kept(
    frames: FrameBatch,
    messages: list[can.Message],
    except_for: Callable[[int], set[str]] = lambda _: set(),
) -> None:
    """Hold every field of every frame, unless the format cannot hold it."""
    for i, (got, frame) in enumerate(zip(messages, frames_in(frames), strict=True)):
        for name in FIELDS - except_for(i):
            assert getattr(got, name) == getattr(message(frame), name), f"frame {i}: {name}"


def _times_s(messages: list[can.Message]) -> np.ndarray:
    return np.array([message.timestamp for message in messages])


def test_blf(tmp_path: Path) -> None:
    messages = _messages(SENT, tmp_path / "car.blf", ExportFormat.BLF)
    _is_kept(SENT, messages, lambda i: {"is_rx"} if IS_ERROR[i] else set())
    # Seconds since 1970 in a float64 step by 238 ns; the file has every nanosecond.
    assert_allclose(_times_s(messages), SENT.t_ns * 1e-9, rtol=0, atol=5e-7)
    with can.BLFReader(tmp_path / "car.blf") as reader:
        assert reader.start_timestamp == 1_700_000_000.123


def test_asc(tmp_path: Path) -> None:
    messages = _messages(SENT, tmp_path / "car.asc", ExportFormat.ASC)
    lost = {"arbitration_id", "is_extended_id", "dlc", "data", "is_rx"}
    empty = ((SENT.flags & FrameFlag.FD) != 0) & (SENT.length == 0)
    # python-can takes an FD frame without data for a remote frame, which FD has not.
    excuse = {"is_remote_frame"}
    _is_kept(SENT, messages, lambda i: lost if IS_ERROR[i] else excuse if empty[i] else set())
    assert_allclose(_times_s(messages), SENT.t_ns * 1e-9, rtol=0, atol=1e-6)
    notes = export_session(small_session(SENT), tmp_path / "a.asc", ExportFormat.ASC).notes
    assert notes[0] == "ASC rounds times to 1 µs"
    assert notes[1].startswith(f"ASC keeps only the times of {IS_ERROR.sum()} error frames")


def test_candump(tmp_path: Path) -> None:
    messages = _messages(SENT, tmp_path / "car.log", ExportFormat.CANDUMP)
    lost = {"arbitration_id", "is_extended_id", "dlc", "data", "is_rx", "channel"}
    remote = (SENT.flags & FrameFlag.REMOTE) != 0
    except_for = [
        lost if e else {"dlc", "channel"} if r else {"channel"}
        for e, r in zip(IS_ERROR, remote, strict=True)
    ]
    _is_kept(SENT, messages, except_for.__getitem__)
    plain = np.array([message.channel for message in messages])[~IS_ERROR]
    assert plain.tolist() == [f"can{bus}" for bus in SENT.bus[~IS_ERROR]]
    assert_allclose(_times_s(messages), SENT.t_ns * 1e-9, rtol=0, atol=1e-6)
    notes = export_session(small_session(SENT), tmp_path / "a.log", ExportFormat.CANDUMP).notes
    assert notes == (
        "candump rounds times to 1 µs",
        f"candump keeps only the times of {IS_ERROR.sum()} error frames",
    )
    whole = replace(
        SENT.select(~IS_ERROR & ~remote), t_ns=SENT.t_ns[~IS_ERROR & ~remote] // 1000 * 1000
    )
    assert not export_session(small_session(whole), tmp_path / "b.log", ExportFormat.CANDUMP).notes


@pytest.mark.parametrize("form", [ExportFormat.BLF, ExportFormat.ASC, ExportFormat.CANDUMP])
def test_a_session_of_plain_arrays_has_no_frames(tmp_path: Path, form: ExportFormat) -> None:
    session = small_session(FrameBatch.empty())
    with pytest.raises(InputError, match="hold no raw frames"):
        export_session(session, tmp_path / "car.x", form)
    assert not list(tmp_path.iterdir())
