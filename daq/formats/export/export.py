"""Exports a session: chooses the writer of a format and the places of its files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from ...errors import InputError
from ...files import make_room, refuse_existing, replaced
from ...sessions import Session
from .channels import CsvStyle, csv_groups, write_csv, write_mat, write_parquet, write_uff
from .frames import frames_left_out, write_asc, write_blf, write_candump
from .mdf import write_mf4


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

    @property
    def suffix(self) -> str:
        """Suffix of the format's files."""
        return f".{self}"


_WRITERS = {
    ExportFormat.MF4: write_mf4,
    ExportFormat.MAT: write_mat,
    ExportFormat.UFF: write_uff,
    ExportFormat.PARQUET: write_parquet,
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
    style: CsvStyle | None = None,
    force: bool = False,
) -> Exported:
    """Write a session in a format of other tools; files are complete or absent.

    CSV has one file per run and sample clock: ``car.csv`` becomes ``car_RUN_GROUP.csv``.  `style`:
    of CSV.  `force`: True if existing files may be replaced.  Raises InputError if there is
    nothing to write in this format, a file exists already or cannot be written, or a library is
    missing.
    """
    try:
        if form is ExportFormat.CSV:
            groups = csv_groups(session, path)
            with _written_whole(list(groups), force) as parts:
                for part, group in zip(parts, groups.values(), strict=True):
                    write_csv(group, session.units, part, style or CsvStyle())
            return Exported(tuple(groups), frames_left_out(session))
        with _written_whole([path], force) as (part,):
            notes = _WRITERS[form](session, part)
        return Exported((path,), notes)
    except InputError:
        raise
    except Exception as error:  # libraries raise many kinds of errors
        what = f"cannot be written: {str(error) or type(error).__name__}"
        advice = "check the session with bumpbench validate"
        raise InputError(str(path), what, advice) from error


@contextmanager
def _written_whole(targets: Sequence[Path], force: bool) -> Iterator[list[Path]]:
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
