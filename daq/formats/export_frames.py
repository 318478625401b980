"""Writes raw frames: BLF, ASC and candump by python-can; MF4, with the channels, by asammdf."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import counted

from ..bench.campaign import Origin
from ..errors import InputError, optional
from ..runs import Run, SampleGroup
from ..sessions import Session

_NS_PER_MS, _NS_PER_US = 1_000_000, 1000


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
    return (f"{frames} left out: use mf4, blf, asc or log",) if count else ()


def has(frames: FrameBatch, flag: FrameFlag) -> NDArray[np.bool_]:
    """Return a mask of the frames that have a flag, (n,)."""
    return np.asarray(frames.flags & flag != 0, np.bool_)


def write_blf(session: Session, path: Path) -> tuple[str, ...]:
    """Write a BLF log; time stamps exact to 1 ns.

    Returns notes on the frames' contents that the format cannot hold.  Raises InputError if the
    session has no frames.
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
    state_origin(session, path, 72)
    n = int((has(frames, FrameFlag.ERROR) & has(frames, FrameFlag.TRANSMITTED)).sum())
    return (f"BLF does not store who sent {counted(n, 'error frame')}",) if n else ()


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
        if origin := _unlike_real(session):
            stream.write(f"// origin: {origin}\n")
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
            if origin := _unlike_real(session):  # an interface's name, as it has no comments
                message.channel = f"{origin}{message.channel}"
            writer.on_message_received(message)
    remote = int((has(frames, FrameFlag.REMOTE) & (frames.length > 0)).sum())
    without_length = f"candump does not store the length of {counted(remote, 'remote frame')}"
    return (*_lost_in_text(frames, "candump"), *((without_length,) if remote else ()))


def _unlike_real(session: Session) -> str:
    """Return the origin of a session, which `Log.origin` reads in the head of a log; "" if real."""
    origin = session.provenance.get("origin", Origin.REAL)
    return "" if origin == Origin.REAL else origin


def state_origin(session: Session, path: Path, offset: int) -> None:
    """Write the origin of a session, unless it is real, to a log's head.

    `offset`: of the reserved part of the head, bytes, which readers skip.
    """
    if origin := _unlike_real(session):
        with path.open("r+b") as stream:
            stream.seek(offset)
            stream.write(f"origin: {origin}".encode())


def _lost_in_text(frames: FrameBatch, name: str) -> tuple[str, ...]:
    notes = [f"{name} rounds times to 1 µs"] if (frames.t_ns % _NS_PER_US).any() else []
    errors = int(has(frames, FrameFlag.ERROR).sum())
    if errors:
        notes.append(f"{name} keeps only the times of {counted(errors, 'error frame')}")
    return tuple(notes)


_NS_PER_S = 1_000_000_000
_REMOTE = {
    "BusChannel": "u1",
    "ID": "<u4",
    "IDE": "u1",
    "DLC": "u1",
    "DataLength": "u1",
    "Dir": "u1",
}
_DATA = _REMOTE | {"DataBytes": "(64,)u1", "EDL": "u1", "BRS": "u1", "ESI": "u1"}
"""Fields of a frame and their types, as in ASAM's bus logging."""


def write_mf4(session: Session, path: Path) -> tuple[str, ...]:
    """Write an MDF 4.10 file: one channel group per run and sample clock, then the bus log.

    All times count from the whole second in which the session begins, which the header states.  A
    channel group is named ``run/group``; it has the flags of `dbc.codec.Quality` as `quality`,
    and `time_s` and `t_ns` as in the session.  Buses count from 1, as MDF requires.  bench.toml and
    the databases are attached.

    Returns notes on the contents of the session that the format cannot hold: none.
    """
    asammdf = optional("asammdf", "mf4")
    raw = session_frames(session) if any(len(run.frames) for run in session.runs) else None
    firsts = [run.t0_ns for run in session.runs] + ([int(raw.t_ns[0])] if raw is not None else [])
    start_ns = min(firsts, default=0) // _NS_PER_S * _NS_PER_S
    units = {"time_s": "s", "t_ns": "ns", **session.units}
    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime.fromtimestamp(start_ns // _NS_PER_S, UTC)
        mdf.header.comment = f"bumpbench session of {session.vehicle.name}"
        for run in session.runs:
            for group in run.groups:
                signals = _signals(asammdf, run, group, units, start_ns)
                mdf.append(signals, acq_name=f"{run.label}/{group.name}", common_timebase=True)
        if raw is not None:
            _append_bus_log(asammdf, mdf, raw, start_ns)
        for name, file in (("bench_toml", "bench.toml"), ("dbc", "bench.dbc")):
            if name in session.provenance:
                content = session.provenance[name].encode("utf-8", "surrogateescape")
                mdf.attach(content, file_name=file, mime="text/plain", compression=False)
        mdf.save(path, overwrite=True, compression=1)
    state_origin(session, path, 30)
    return ()


def _signals(
    asammdf: Any, run: Run, group: SampleGroup, units: dict[str, str], start_ns: int
) -> list[Any]:
    time_s = group.time_s + (run.t0_ns - start_ns) * 1e-9
    columns: dict[str, NDArray[Any]] = {**group.values, "quality": group.quality}
    columns |= {"time_s": group.time_s, "t_ns": group.t_ns}
    return [
        asammdf.Signal(
            samples=np.array(values),
            timestamps=time_s,
            name=name,
            unit=units.get(name, ""),
            comment=f"{run.label} ({run.status})",
        )
        for name, values in columns.items()
    ]


def _append_bus_log(asammdf: Any, mdf: Any, frames: FrameBatch, start_ns: int) -> None:
    """Append the frames as in ASAM's bus logging: data, remote and error frames separately."""
    source = asammdf.Source(
        name="CAN",
        path="CAN",
        comment="",
        source_type=asammdf.Source.SOURCE_BUS,
        bus_type=asammdf.Source.BUS_TYPE_CAN,
    )
    remote, error = has(frames, FrameFlag.REMOTE), has(frames, FrameFlag.ERROR)
    kinds = (
        ("CAN_DataFrame", _DATA, ~remote & ~error),
        ("CAN_RemoteFrame", _REMOTE, remote & ~error),
        ("CAN_ErrorFrame", _DATA, error),
    )
    for name, fields, mask in kinds:
        if mask.any():
            selected = frames.select(mask)
            signal = asammdf.Signal(
                samples=_records(selected, name, fields),
                timestamps=(selected.t_ns - start_ns) * 1e-9,
                name=name,
                source=source,
            )
            mdf.append(signal, acq_name="CAN", acq_source=source)


def _records(frames: FrameBatch, kind: str, fields: dict[str, str]) -> NDArray[np.void]:
    records = np.zeros(len(frames), [(f"{kind}.{name}", form) for name, form in fields.items()])
    fd = has(frames, FrameFlag.FD)
    code = np.searchsorted(FD_LENGTHS, np.minimum(frames.length, 64))
    cells = {
        "BusChannel": frames.bus + 1,
        "ID": frames.can_id,
        "IDE": has(frames, FrameFlag.EXTENDED),
        "DLC": np.where(fd, code, frames.length),
        "DataLength": frames.length if "DataBytes" in fields else np.uint8(0),
        "DataBytes": np.pad(frames.data, ((0, 0), (0, 64 - frames.data.shape[1]))),
        "Dir": has(frames, FrameFlag.TRANSMITTED),
        "EDL": fd,
        "BRS": has(frames, FrameFlag.BITRATE_SWITCH),
        "ESI": has(frames, FrameFlag.ERROR_STATE),
    }
    for name in fields:
        records[f"{kind}.{name}"] = cells[name]
    return records
