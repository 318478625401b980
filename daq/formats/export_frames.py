"""Writes the raw frames of a session as BLF, ASC or candump with python-can."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np

from dbc.frames import FrameBatch, FrameFlag
from dbc.words import InputError, counted

from ..sessions import Session

_NS_PER_MS = 1_000_000


def session_frames(session: Session) -> FrameBatch:
    """Return all raw frames of a session (`Session.frames`); raises InputError if it has none."""
    frames = session.frames
    if not len(frames):
        what = "its runs hold no raw frames"
        raise InputError("session", what, "export the decoded channels: mf4, mat, csv, parquet")
    return frames


def frames_left_out(session: Session) -> tuple[str, ...]:
    """Return the note on raw frames for a format that holds only decoded channels."""
    count = sum(len(run.frames) for run in session.runs)
    frames = counted(count, "raw frame is", "raw frames are")
    return (f"{frames} left out: use blf, asc or log",) if count else ()


def write_blf(session: Session, path: Path) -> tuple[str, ...]:
    """Write a BLF log; time stamps exact to 1 ns.

    Raises InputError if the session has no frames.
    """
    import can

    from ..bus.interfaces import messages_of

    frames = session_frames(session)
    start_ns = int(frames.t_ns[0]) // _NS_PER_MS * _NS_PER_MS
    with can.BLFWriter(path) as writer:
        # Times count from a start in whole milliseconds, because seconds since 1970 in a float64
        # have steps of 238 ns.
        writer.start_timestamp = 0.0
        for message in messages_of(frames, start_ns):
            writer.on_message_received(message)
        writer.start_timestamp = start_ns * 1e-9  # for the head of the file
        writer.stop_timestamp = int(frames.t_ns[-1]) * 1e-9
    return ()


def write_asc(session: Session, path: Path) -> tuple[str, ...]:
    """Write an ASC log; as `write_blf`, but with times in whole microseconds."""
    import can

    from ..bus.interfaces import messages_of

    frames = session_frames(session)
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
        for message in messages_of(frames, start_ns):
            writer.on_message_received(message)
    return _lost_in_text(frames, "ASC")


def write_candump(session: Session, path: Path) -> tuple[str, ...]:
    """Write a log of candump; as `write_asc`."""
    import can

    from ..bus.interfaces import messages_of

    frames = session_frames(session)
    with can.CanutilsLogWriter(path) as writer:
        for message in messages_of(frames, 0):
            writer.on_message_received(message)
    return _lost_in_text(frames, "candump")


def _lost_in_text(frames: FrameBatch, name: str) -> tuple[str, ...]:
    notes = [f"{name} rounds times to 1 µs"] if (frames.t_ns % 1000).any() else []
    errors = int(np.count_nonzero(frames.flags & FrameFlag.ERROR))
    if errors:
        notes.append(f"{name} keeps only the times of {counted(errors, 'error frame')}")
    return tuple(notes)
