"""Writes MF4: decoded channels with units, and the raw frames as bus logging."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag

from ...errors import optional
from ...runs import Run, SampleGroup
from ...sessions import Session
from .frames import has, session_frames, state_origin

_NS_PER_S = 1_000_000_000
_RESERVED = 30
"""Offset of the reserved part of the head, bytes; readers skip it."""
_UNITS = {"time_s": "s", "t_ns": "ns"}

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
    channel group is named ``run/group``; it has the flags of `dbc.samples.Quality` as `quality`,
    and `time_s` and `t_ns` as in the session.  Buses count from 1, as MDF requires.  bench.toml and
    the databases are attached.

    Returns notes on the contents of the session that the format cannot hold: none.
    """
    asammdf = optional("asammdf", "mf4")
    raw = session_frames(session) if any(len(run.frames) for run in session.runs) else None
    firsts = [run.t0_ns for run in session.runs] + ([int(raw.t_ns[0])] if raw is not None else [])
    start_ns = min(firsts, default=0) // _NS_PER_S * _NS_PER_S
    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime.fromtimestamp(start_ns // _NS_PER_S, UTC)
        mdf.header.comment = f"bumpbench session of {session.vehicle.name}"
        for run in session.runs:
            for group in run.groups:
                signals = _signals(asammdf, run, group, session.units, start_ns)
                mdf.append(signals, acq_name=f"{run.label}/{group.name}", common_timebase=True)
        if raw is not None:
            _append_bus_log(asammdf, mdf, raw, start_ns)
        for name, file in (("bench_toml", "bench.toml"), ("dbc", "bench.dbc")):
            if name in session.provenance:
                content = session.provenance[name].encode("utf-8", "surrogateescape")
                mdf.attach(content, file_name=file, mime="text/plain", compression=False)
        mdf.save(path, overwrite=True, compression=1)
    state_origin(session, path, _RESERVED)
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
            unit=units.get(name, _UNITS.get(name, "")),
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
