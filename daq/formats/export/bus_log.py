"""Writes raw frames as BLF and ASC, with python-can's writers, and as candump's log.

BLF and ASC count the time from a start in whole milliseconds.  The writers get times from that
start, because seconds since 1970 in a float64 have steps of 238 ns.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import can

from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

from .raw_frames import has

_NS_PER_MS, _NS_PER_US = 1_000_000, 1000
_ERROR_BIT, _BRS, _ESI = 0x2000_0000, 1, 2
"""Marks of candump: error frame (a bit of the identifier), and properties of an FD frame."""


def write_blf(frames: FrameBatch, path: Path) -> tuple[str, ...]:
    """Write a BLF log; time stamps exact to 1 ns.

    `frames`, FrameBatch, not empty: in order of time.  Returns notes on the contents of `frames`
    that the format cannot hold.
    """
    start_ns = int(frames.t_ns[0]) // _NS_PER_MS * _NS_PER_MS
    with can.BLFWriter(path) as writer:
        writer.start_timestamp = 0.0
        for message in _messages(frames, start_ns):
            writer.on_message_received(message)
        writer.start_timestamp = start_ns * 1e-9
        writer.stop_timestamp = int(frames.t_ns[-1]) * 1e-9
    errors = has(frames, FrameFlag.ERROR)
    sent = errors & has(frames, FrameFlag.TRANSMITTED)
    n = int(sent.sum())
    return (f"BLF does not store who sent {counted(n, 'error frame')}",) if n else ()


def write_asc(frames: FrameBatch, path: Path) -> tuple[str, ...]:
    """Write an ASC log; parameters and result as `write_blf`."""
    start_ns = int(frames.t_ns[0]) // _NS_PER_MS * _NS_PER_MS
    start = datetime.fromtimestamp(start_ns // _NS_PER_MS / 1000)
    with path.open("w", encoding="ascii", newline="\n") as stream, can.ASCWriter(stream) as writer:
        # The writer's own head states the time of writing as the start of the measurement.
        stream.seek(0)
        stream.truncate()
        day = f"{start:%a %b %d %H:%M:%S}.{start.microsecond // 1000:03d} {start:%Y}"
        stream.write(f"date {day}\nbase hex  timestamps absolute\ninternal events logged\n")
        stream.write(f"Begin Triggerblock {day}\n   0.000000 Start of measurement\n")
        writer.header_written = True
        for message in _messages(frames, start_ns):
            writer.on_message_received(message)
    notes = ["ASC rounds times to 1 µs"] if (frames.t_ns % _NS_PER_US).any() else []
    errors = has(frames, FrameFlag.ERROR)
    if errors.any():
        kept = counted(int(errors.sum()), "error frame")
        notes.append(f"ASC keeps only the times of {kept}")
    return tuple(notes)


def write_candump(frames: FrameBatch, path: Path) -> tuple[str, ...]:
    """Write a log of candump with every field of a frame; parameters and result as `write_blf`."""
    t_us = (frames.t_ns + _NS_PER_US // 2) // _NS_PER_US
    columns = (t_us, frames.can_id, frames.flags, frames.bus, frames.length)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    payload, width = frames.data.tobytes(), frames.data.shape[1]
    with path.open("w", encoding="ascii", newline="\n") as stream:
        for i, (at_us, can_id, flags, bus, length) in enumerate(rows):
            if flags & FrameFlag.ERROR:
                name = f"{can_id | _ERROR_BIT:08X}"
            else:
                name = f"{can_id:08X}" if flags & FrameFlag.EXTENDED else f"{can_id:03X}"
            content = payload[i * width : i * width + length].hex().upper()
            if flags & FrameFlag.REMOTE:
                content = f"R{length}"
            elif flags & FrameFlag.FD:
                bits = _BRS * bool(flags & FrameFlag.BITRATE_SWITCH)
                bits |= _ESI * bool(flags & FrameFlag.ERROR_STATE)
                content = f"#{bits:X}{content}"
            seconds, rest_us = divmod(abs(at_us), 1_000_000)
            sign = "-" if at_us < 0 else ""
            way = "T" if flags & FrameFlag.TRANSMITTED else "R"
            stream.write(f"({sign}{seconds:010d}.{rest_us:06d}) can{bus} {name}#{content} {way}\n")
    return ("candump rounds times to 1 µs",) if (frames.t_ns % _NS_PER_US).any() else ()


def _messages(frames: FrameBatch, start_ns: int) -> Iterator[can.Message]:
    """Yield frames as messages of python-can, stamped from the start of the log."""
    # Half a nanosecond is added, because the BLF writer truncates digits instead of rounding.
    since_s = ((frames.t_ns - start_ns) + 0.5) * 1e-9
    columns = (since_s, frames.can_id, frames.flags, frames.bus, frames.length)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    payload, width = frames.data.tobytes(), frames.data.shape[1]
    for i, (time_s, can_id, flags, bus, length) in enumerate(rows):
        remote = bool(flags & FrameFlag.REMOTE)
        yield can.Message(
            timestamp=time_s,
            arbitration_id=can_id,
            is_extended_id=bool(flags & FrameFlag.EXTENDED),
            is_remote_frame=remote,
            is_error_frame=bool(flags & FrameFlag.ERROR),
            is_fd=bool(flags & FrameFlag.FD),
            bitrate_switch=bool(flags & FrameFlag.BITRATE_SWITCH),
            error_state_indicator=bool(flags & FrameFlag.ERROR_STATE),
            is_rx=not flags & FrameFlag.TRANSMITTED,
            channel=bus,
            dlc=length,
            data=None if remote else payload[i * width : i * width + length],
        )
