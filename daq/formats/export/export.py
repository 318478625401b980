"""Exports a session: chooses the writer of a format and the places of its files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from ...errors import InputError
from ...files import make_room, refuse_existing, replaced
from ...runs import SampleGroup
from ...sessions import Session
from .. import description
from .bus_log import write_asc, write_blf, write_candump
from .csv_files import PLAIN, CsvStyle, write_csv
from .matlab import write_mat
from .mdf import write_mf4
from .parquet import write_parquet
from .raw_frames import frame_spans, frames_left_out, session_frames
from .sep005 import write_sep005
from .universal import ModeShapes, write_uff


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
    SEP005 = "sep005"

    @property
    def suffix(self) -> str:
        """Suffix of the format's files."""
        return ".json" if self is ExportFormat.SEP005 else f".{self}"


_LOGS = {
    ExportFormat.BLF: write_blf,
    ExportFormat.ASC: write_asc,
    ExportFormat.CANDUMP: write_candump,
}
_SUFFIXES = {form.suffix: form for form in ExportFormat} | {".unv": ExportFormat.UFF}


@dataclass(frozen=True, slots=True)
class Exported:
    """The files of an export."""

    paths: tuple[Path, ...]
    """The files."""
    notes: tuple[str, ...]
    """Contents of the session that the format cannot hold, one line each."""


def format_of(path: Path) -> ExportFormat:
    """Return the format that a file's suffix means.

    Raises InputError if it means none.
    """
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


def export_session(
    session: Session,
    path: Path,
    form: ExportFormat,
    *,
    style: CsvStyle = PLAIN,
    modes: Sequence[ModeShapes] = (),
    force: bool = False,
) -> Exported:
    """Write a session in a format of other tools; files are complete or absent.

    CSV has one file per run and sample clock: ``car.csv`` becomes ``car_RUN_GROUP.csv``.  The
    description of the session (`daq.formats.description`) is inside MF4, MAT and Parquet files, and
    next to CSV, UFF and logs.  `force`: True if existing files may be replaced.  Raises InputError
    if there is nothing to write in this format, a file exists already or cannot be written, or a
    library is missing.
    """
    try:
        return _exported(session, path, form, style, modes, force)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors
        what = f"cannot be written: {str(error) or type(error).__name__}"
        advice = "check the session with bumpbench validate"
        raise InputError(str(path), what, advice) from error


def _exported(
    session: Session,
    path: Path,
    form: ExportFormat,
    style: CsvStyle,
    modes: Sequence[ModeShapes],
    force: bool,
) -> Exported:
    if form is ExportFormat.CSV:
        return _export_csv(session, path, style, force)
    if form is ExportFormat.UFF:
        sidecar = description.sidecar_of(path)
        with written_whole([path, sidecar], force) as (part, about):
            notes = write_uff(session, modes, part)
            about.write_text(description.session_text(session), "utf-8")
        return Exported((path, sidecar), notes)
    if form in _LOGS:
        return _export_log(session, path, form, force)
    with written_whole([path], force) as (part,):
        match form:
            case ExportFormat.MF4:
                notes = write_mf4(session, part)
            case ExportFormat.MAT:
                notes = write_mat(session, part)
            case ExportFormat.PARQUET:
                notes = write_parquet(session, part)
            case ExportFormat.SEP005:
                notes = write_sep005(session, part)
    return Exported((path,), notes)


def _export_csv(session: Session, path: Path, style: CsvStyle, force: bool) -> Exported:
    groups: dict[Path, SampleGroup] = {}
    files: dict[tuple[str, str], str] = {}
    for run in session.runs:
        for group in run.groups:
            name = "".join(
                c if c.isalnum() or c in "-+_" else "_" for c in f"{run.label}_{group.name}"
            )
            place = path.with_name(f"{path.stem}_{name}.csv")
            if place in groups:
                raise InputError(str(place), "would be the file of two runs", "choose with --run")
            groups[place] = group
            files[run.label, group.name] = place.name
    if not groups:
        raise InputError("session", "its runs hold no samples", "choose other runs")
    sidecar = description.sidecar_of(path)
    about = description.describe(session, files, style=(style.separator, style.decimal))
    with written_whole([*groups, sidecar], force) as (*parts, about_part):
        for part, group in zip(parts, groups.values(), strict=True):
            write_csv(group, session.units, part, style)
        about_part.write_text(description.text_of(about), "utf-8")
    return Exported((*groups, sidecar), frames_left_out(session))


def _export_log(session: Session, path: Path, form: ExportFormat, force: bool) -> Exported:
    frames = session_frames(session)
    described = description.describe(session, spans=frame_spans(session, frames))
    sidecar = description.sidecar_of(path)
    with written_whole([path, sidecar], force) as (part, about):
        notes = _LOGS[form](frames, part)
        about.write_text(description.text_of(described), "utf-8")
    return Exported((path, sidecar), notes)


@contextmanager
def written_whole(targets: Sequence[Path], force: bool) -> Iterator[list[Path]]:
    """Write files under temporary names; move them to their targets when all are complete.

    `targets`: final paths.  `force`: True if existing files may be replaced.  Yields the paths to
    write to: same folder, same suffix.  Raises InputError if a target exists already, or cannot be
    written.
    """
    for target in targets:
        refuse_existing(target, replace=force)
    for target in targets:
        make_room(target)
    try:
        with replaced(targets) as parts:
            yield parts
    except OSError as error:
        what = f"cannot be written: {error.strerror or error}"
        advice = "check folder, rights and free space"
        raise InputError(str(targets[0]), what, advice) from error
