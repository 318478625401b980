"""Exports a session to formats of other tools: decoded channels, or raw frames."""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameFlag
from dbc.words import InputError, counted, csv_text, plural, printable

from ..channels import ON_BODY, TIME_DERIVATIVE, Channel, Quantity
from ..files import make_room, refuse_existing, replaced
from ..runs import Run, SampleGroup
from ..sessions import Session
from .reader import optional


class ExportFormat(StrEnum):
    """File formats to which a session can be exported."""

    MF4 = "mf4"
    MAT = "mat"
    UFF = "uff"
    CSV = "csv"
    PARQUET = "parquet"
    BLF = "blf"
    ASC = "asc"
    CANDUMP = "log"


_SUFFIXES = {f".{form}": form for form in ExportFormat} | {".unv": ExportFormat.UFF}


def csv_groups(session: Session, path: Path) -> dict[Path, SampleGroup]:
    """Return the sample groups of a session by their files, ``car_RUN_GROUP.csv`` for ``car.csv``.

    Raises InputError if the runs have no samples, or two groups have the same file.
    """
    groups: dict[Path, SampleGroup] = {}
    for run in session.runs:
        for group in run.groups:
            name = f"{run.label}_{group.name}"
            plain = "".join(c if c.isalnum() or c in "-+_" else "_" for c in name)
            file = path.with_name(f"{path.stem}_{plain}.csv")
            if file in groups:
                raise InputError(str(file), "would be the file of two runs", "choose with --run")
            groups[file] = group
    if not groups:
        raise InputError("session", "its runs hold no samples", "choose other runs")
    return groups


def write_csv(group: SampleGroup, units: dict[str, str], path: Path, decimal: str) -> None:
    """Write the samples of one clock; a missing value is an empty cell.

    The columns are ``time_s``, the channels as ``name [unit]``, and ``quality``
    (`dbc.codec.Quality`).  Numbers have as many digits as are needed to read them back exactly.
    `decimal`: mark before the fraction; where it is a comma, semicolons separate the columns.
    """

    def cells(values: NDArray[np.float64]) -> list[str]:
        # Only NaN differs from itself.
        texts = ["" if value != value else repr(value) for value in values.tolist()]
        return [text.replace(".", decimal) for text in texts]

    names = [f"{name} [{units[name]}]" if units[name] else name for name in group.values]
    columns = [*map(cells, (group.time_s, *group.values.values())), group.quality.tolist()]
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, delimiter=";" if decimal == "," else ",")
        writer.writerow(["time_s", *map(csv_text, names), "quality"])
        writer.writerows(zip(*columns, strict=True))


def write_parquet(session: Session, path: Path) -> None:
    """Write one table: `run group status time_s t_ns quality`, then a column for each channel, SI.

    A channel is null in the rows of other groups.  pandas reads the units in
    ``DataFrame.attrs["units"]``.
    """
    pandas = optional("pandas", "data")
    tables = [
        pandas.DataFrame(
            {
                "run": run.label,
                "group": group.name,
                "status": str(run.status),
                "time_s": group.time_s,
                "t_ns": group.t_ns,
                "quality": group.quality,
                **group.values,
            }
        )
        for run in session.runs
        for group in run.groups
    ]
    first_columns = ["run", "group", "status", "time_s", "t_ns", "quality"]
    names = [channel.name for channel in session.channels]
    joined = pandas.concat(tables, ignore_index=True) if tables else pandas.DataFrame()
    frame = joined.reindex(columns=[*first_columns, *names])
    words = dict.fromkeys(("run", "group", "status"), "category")  # few words in many rows
    frame = frame.astype(words | dict.fromkeys(names, "f8"))
    units = {"time_s": "s", "t_ns": "ns", **session.units}
    frame.attrs = {"units": units, "vehicle": session.vehicle.name}
    frame.to_parquet(path, engine="pyarrow", compression="zstd", index=False)


def write_mf4(session: Session, path: Path) -> None:
    """Write an MDF 4.10 file with a channel group ``run/group`` per run and sample clock.

    All times count from the whole second in which the session begins, which the header states.  A
    group has the flags of `dbc.codec.Quality` as `quality`, and `time_s` and `t_ns` as in the
    session.
    """
    asammdf = optional("asammdf", "mf4")
    start_s = min((run.t0_ns for run in session.runs), default=0) // 1_000_000_000
    units = {"time_s": "s", "t_ns": "ns", **session.units}
    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime.fromtimestamp(start_s, UTC)
        mdf.header.comment = f"bumpbench session of {session.vehicle.name}"
        for run in session.runs:
            for group in run.groups:
                columns: dict[str, NDArray[Any]] = {**group.values, "quality": group.quality}
                columns |= {"time_s": group.time_s, "t_ns": group.t_ns}
                shared = {
                    "timestamps": group.time_s + (run.t0_ns - start_s * 1_000_000_000) * 1e-9,
                    "comment": f"{run.label} ({run.status})",
                }
                signals = [
                    asammdf.Signal(np.array(values), name=name, unit=units.get(name, ""), **shared)
                    for name, values in columns.items()
                ]
                mdf.append(signals, acq_name=f"{run.label}/{group.name}", common_timebase=True)
        mdf.save(path, overwrite=True, compression=1)


def write_mat(session: Session, path: Path) -> None:
    """Write a MAT file: ``runs.RUN.GROUP.CHANNEL``, with ``t`` in s and ``units.CHANNEL``.

    In addition to its channels a group has ``t_ns`` (int64, bus time) and ``quality`` (uint8); a
    run has ``mass_state``, ``excitation``, ``repeat``, ``status``, ``reasons``, ``t0_ns`` and
    ``bump_s``.  ``vehicle`` and ``channels`` describe the measured quantities and their places.
    """
    from scipy.io import savemat

    vehicle: dict[str, Any] = {"name": session.vehicle.name}
    if session.vehicle.geometry is not None:
        vehicle |= {f"{name}_m": v for name, v in asdict(session.vehicle.geometry).items()}
    channels = {
        channel.name: asdict(channel)
        | {"quantity": str(channel.quantity), "corner": str(channel.corner or "")}
        for channel in session.channels
    }
    runs = _fields((run.label, _matlab_run(run, session.units)) for run in session.runs)
    variables = {"runs": runs, "channels": _fields(channels.items()), "vehicle": vehicle}
    savemat(path, variables, long_field_names=True, do_compression=True, oned_as="column")


def _matlab_run(run: Run, units: dict[str, str]) -> dict[str, Any]:
    """Return the fields of a run: what it is, and its groups."""
    properties = {
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": run.repeat,
        "status": str(run.status),
        "reasons": "\n".join(run.reasons),
        "t0_ns": np.int64(run.t0_ns),
        "bump_s": run.bump_s,
    }
    groups = {}
    for group in run.groups:
        columns = {"t": group.time_s, "t_ns": group.t_ns, "quality": group.quality}
        taken = [*columns, "units"]
        units_by_field = _fields(((name, units[name]) for name in group.values), taken)
        columns |= {"units": {"t": "s", **units_by_field}}
        groups[group.name] = columns | _fields(group.values.items(), taken)
    return properties | _fields(groups.items(), properties)


def _fields(items: Iterable[tuple[str, Any]], taken: Collection[str] = ()) -> dict[str, Any]:
    """Return items under different names that MATLAB allows for fields and that are not `taken`."""
    result: dict[str, Any] = {}
    for name, value in items:
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        field, number = plain[:63], 1  # MATLAB cuts longer names
        while field in result or field in taken:
            number += 1
            field = f"{plain[:59]}_{number}"
        result[field] = value
    return result


def write_uff(session: Session, path: Path) -> tuple[str, ...]:
    """Write dataset 164 (SI), and one 58 per run and channel with two samples, as SDRC published.

    Data are binary (58b, little-endian float64), because the text form has only 6 digits of a time.
    Returns a note if samples are missing.
    """
    missing = 0
    with path.open("wb") as stream:
        # Factors of length, force and temperature, then the offset of the temperature, K.
        factor, kelvin = f"{'1.0000000000000000D+00':>25}", f"{'2.7314999999999998D+02':>25}"
        units = [f"{1:10d}{'SI: metre, newton':>20}{2:10d}", factor * 3, kelvin]
        stream.write(_dataset([f"{164:6d}{'':74}", *units]))
        for run in session.runs:
            for group in run.groups:
                for number, channel in enumerate(session.channels, start=1):
                    values = group.values.get(channel.name)
                    if values is not None and np.isfinite(values).sum() > 1:
                        stream.write(_dataset_58b(run, group, channel, number))
                        missing += int(np.sum(~np.isfinite(values)))
    if not missing:
        return ()
    note = f"{counted(missing, 'missing sample is', 'missing samples are')} left out: "
    note += f"{plural(missing, 'its record is', 'their records are')} not equidistant"
    return (note,)


def _dataset(lines: Sequence[str], data: bytes = b"") -> bytes:
    """Return a dataset, lines and binary data, between its delimiters."""
    text = "".join(f"{line}\n" for line in ["    -1", *lines])
    return text.encode("ascii", "replace") + data + b"    -1\n"


def _dataset_58b(run: Run, group: SampleGroup, channel: Channel, number: int) -> bytes:
    """Return dataset 58b: a channel without its missing samples.

    Nodes 1..4 are the corners FL FR RL RR; a channel without a corner has its `number`, + 100.
    Layout: (I6,1A1,2I6,2I12,4I..), 5 x (80A1), 2(I5,I10),2(1X,10A1,I10,I4), (3I10,3E13.5),
    4 x (I10,3I5,2(1X,20A1)), then the data.
    """
    values = group.values[channel.name]
    is_present = np.isfinite(values)
    time_s, values = group.time_s[is_present], values[is_present]
    # The head has only six digits; if these do not give the times, every sample has its own.
    step_s = float(f"{(time_s[-1] - time_s[0]) / (len(time_s) - 1):13.5e}")
    start_s = float(f"{time_s[0]:13.5e}")
    even = int(np.array_equal(start_s + step_s * np.arange(len(time_s)), time_s))
    columns = values if even else np.column_stack([time_s, values])
    data = np.ascontiguousarray(columns, "<f8").tobytes()
    begin = datetime.fromtimestamp(run.t0_ns // 1_000_000_000, UTC)
    data_types = {None: 0, 0: 8, 1: 11, 2: 12}  # unknown, displacement, velocity, acceleration
    data_type = data_types[TIME_DERIVATIVE.get(channel.quantity)]
    node = number + 100 if channel.corner is None else channel.corner.position + 1
    about_y = (Quantity.PITCH_RATE, Quantity.PITCH_ACCELERATION)
    about_x = (Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION)
    direction = 0  # none; 3: along z; 4, 5: about x and y
    if channel.corner is not None or channel.quantity in ON_BODY:
        direction = 3
    elif channel.quantity in (*about_x, *about_y):
        direction = 4 if channel.quantity in about_x else 5
    entity = "".join(c if c.isascii() and c.isprintable() else "?" for c in channel.name)[:10]
    texts = (
        channel.name,
        f"{run.label} {group.name} ({run.status})",
        f"{begin:%d-%b-%y %H:%M:%S}".upper(),
        f"mass state {run.mass_state}, {run.excitation}, repeat {run.repeat}",
        channel.signal,
    )
    axes = ((17, "time", "s"), (data_type, str(channel.quantity), channel.unit))
    head = [
        f"{58:6d}b{1:6d}{2:6d}{11:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *(f"{printable(text, 80) or 'NONE':<80}" for text in texts),
        f"{1:5d}{0:10d}{0:5d}{0:10d} {entity or 'NONE':<10}{node:10d}{direction:4d}"
        f" {'NONE':<10}{0:10d}{0:4d}",
        f"{4:10d}{len(values):10d}{even:10d}{even * start_s:13.5e}{even * step_s:13.5e}{0.0:13.5e}",
        *(
            f"{code:10d}{0:5d}{0:5d}{0:5d} {label[:20]:<20} {unit[:20] or 'NONE':<20}"
            for code, label, unit in (*axes, (0, "NONE", "NONE"), (0, "NONE", "NONE"))
        ),
    ]
    return _dataset(head, data)


# Raw frames, with python-can ----------------------------------------------------------------------


def write_frames(session: Session, path: Path, form: ExportFormat) -> tuple[str, ...]:
    """Write a log as BLF (times exact to 1 ns), ASC or candump (1 microsecond).

    Returns notes on what a text format cannot hold.  Raises InputError if the session has no raw
    frames.
    """
    import can

    from ..bus.interfaces import messages_of

    frames = session.frames
    if not len(frames):
        what = "its runs hold no raw frames"
        raise InputError("session", what, "export the decoded channels: mf4, mat, csv, parquet")
    # Times count from a start in whole ms: seconds since 1970 have steps of 238 ns in float64.
    start_ns = int(frames.t_ns[0]) // 1_000_000 * 1_000_000
    if form is ExportFormat.BLF:
        with can.BLFWriter(path) as blf:
            blf.start_timestamp = 0.0  # else the first message's, which it subtracts
            for message in messages_of(frames, start_ns):
                blf.on_message_received(message)
            blf.start_timestamp = start_ns * 1e-9  # for the head of the file
            blf.stop_timestamp = int(frames.t_ns[-1]) * 1e-9
        return ()
    with path.open("w", encoding="ascii", newline="\n") as stream:
        if form is ExportFormat.ASC:
            writer: Any = can.ASCWriter(stream)
            # The writer's own head states the time of writing as the start of the measurement.
            stream.seek(0)
            stream.truncate()
            start = datetime.fromtimestamp(start_ns // 1_000_000 / 1000)
            day = f"{start:%a %b %d %H:%M:%S}.{start.microsecond // 1000:03d} {start:%Y}"
            stream.write(f"date {day}\nbase hex  timestamps absolute\ninternal events logged\n")
            stream.write(f"Begin Triggerblock {day}\n   0.000000 Start of measurement\n")
            writer.header_written = True
        else:
            writer, start_ns = can.CanutilsLogWriter(stream), 0  # it writes times since 1970
        for message in messages_of(frames, start_ns):
            writer.on_message_received(message)
        writer.stop()
    name = "ASC" if form is ExportFormat.ASC else "candump"
    notes = [f"{name} rounds times to 1 µs"] if (frames.t_ns % 1000).any() else []
    if errors := int(np.count_nonzero(frames.flags & FrameFlag.ERROR)):
        notes.append(f"{name} keeps only the times of {counted(errors, 'error frame')}")
    return tuple(notes)


# The export ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Exported:
    """The files of an export."""

    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    """Contents of the session that the format cannot hold, one line each."""


def format_of(path: Path) -> ExportFormat:
    """Return the format that a file's suffix means; raises InputError if it means none."""
    form = _SUFFIXES.get(path.suffix.lower())
    if form is None:
        what = f"{path.suffix} is not an export format" if path.suffix else "has no suffix"
        raise InputError(str(path), what, f"use {' '.join(_SUFFIXES)}, or name it with --format")
    return form


def chosen_runs(session: Session, labels: Sequence[str]) -> Session:
    """Return a session with only the runs of these labels; with all runs if no label is given.

    Raises InputError if there is no such run.
    """
    present = [run.label for run in session.runs]
    for label in labels:
        if label not in present:
            raise InputError("--run", f"there is no run {label}", f"use {' '.join(present)}")
    runs = tuple(run for run in session.runs if not labels or run.label in labels)
    return replace(session, runs=runs)


_CHANNEL_WRITERS: dict[ExportFormat, Callable[[Session, Path], tuple[str, ...] | None]] = {
    ExportFormat.MF4: write_mf4,
    ExportFormat.MAT: write_mat,
    ExportFormat.UFF: write_uff,
    ExportFormat.PARQUET: write_parquet,
}
"""Writers of decoded channels in one file; they return what the format cannot hold."""


def export_session(
    session: Session, path: Path, form: ExportFormat, *, decimal: str = ".", force: bool = False
) -> Exported:
    """Write a session in a format of other tools; files are complete or absent.

    CSV has one file per run and sample clock: ``car.csv`` becomes ``car_RUN_GROUP.csv``.
    `decimal`: as of `write_csv`.  `force`: True if existing files may be replaced.  Raises
    InputError if there is nothing to write in this format, a file exists already or cannot be
    written, or a library is missing.
    """
    try:
        groups = csv_groups(session, path) if form is ExportFormat.CSV else {}
        targets = list(groups) or [path]
        for target in targets:
            refuse_existing(target, replace=force)
        for target in targets:
            make_room(target)
        with replaced(targets) as new_files:
            for new_file, group in zip(new_files, groups.values(), strict=False):
                write_csv(group, session.units, new_file, decimal)
            if form in (ExportFormat.BLF, ExportFormat.ASC, ExportFormat.CANDUMP):
                return Exported(tuple(targets), write_frames(session, new_files[0], form))
            notes = () if groups else _CHANNEL_WRITERS[form](session, new_files[0]) or ()
        if n_frames := sum(len(run.frames) for run in session.runs):
            frames = counted(n_frames, "raw frame is", "raw frames are")
            notes = (*notes, f"{frames} left out: use blf, asc or log")
        return Exported(tuple(targets), notes)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors
        reason, advice = str(error), "check the session with bumpbench validate"
        if isinstance(error, OSError):
            reason, advice = error.strerror or reason, "check folder, rights and free space"
        what = f"cannot be written: {reason or type(error).__name__}"
        raise InputError(str(path), what, advice) from error
