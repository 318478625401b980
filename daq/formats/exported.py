"""Reads the exports of sessions that `daq.formats.export` has written."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import printable

from ..errors import BumpbenchError, InputError
from ..optional import optional
from ..sessions import Session
from . import description
from .description import (
    Columns,
    Description,
    GroupDescription,
    RunDescription,
    description_of,
    session_of,
)
from .export.csv_files import CsvStyle, read_csv
from .exported_log import read_exported_log
from .exported_mat import read_exported_mat
from .exported_uff import read_exported_uff

_DAMAGED = "the file is damaged or cut off"
_HEADER_AT, _FIRST_ATTACHMENT = 64, slice(48, 56)
"""Position of the header block of an MF4, and in it of the link to the first attachment."""
_MAX_SIDECAR_BYTES = 256 << 20


def exported_session(path: Path) -> Session | None:
    """Return the session in an export; None if the file is not an export, or has no description.

    `path`: MF4, MAT, Parquet, UFF or a log of raw frames, or the sidecar of a CSV.  Raises
    InputError if it is damaged, or a library is missing.
    """
    try:
        if path.exists() and not path.is_file():  # a FIFO would wait for ever
            return None
        with path.open("rb") as file:
            head = file.read(128)
    except OSError:
        # A CSV export has a file for each message of each run, and no file of the given name.
        is_csv = path.suffix == ".csv" and not path.exists() and _is_described(path)
        return exported_session(description.sidecar_of(path)) if is_csv else None
    try:
        for fits, read in _READERS:
            if fits(path, head):
                return read(path)
    except BumpbenchError:
        raise
    except Exception as error:  # libraries raise many kinds of errors
        what = f"cannot be read: {str(error) or type(error).__name__}"
        raise InputError(str(path), what.splitlines()[0], _DAMAGED) from error
    return None


def _mf4(path: Path) -> Session | None:
    """Return the session in an MF4; handles what asammdf raises, logs and prints."""
    if not _names_description(path):
        return None
    asammdf = optional("asammdf", "mf4")
    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)
    hook, failure = sys.unraisablehook, ""
    try:
        with redirect_stdout(StringIO()):
            return _from_mf4(asammdf, path)
    except BumpbenchError:
        raise
    except Exception as error:
        failure = str(error) or type(error).__name__
        # Its incomplete object fails again when it is deleted, with a traceback on stderr.
        sys.unraisablehook = lambda _: None
    gc.collect()
    sys.unraisablehook = hook
    raise InputError(str(path), f"cannot be read: {printable(failure, 200)}", _DAMAGED)


def _from_mf4(asammdf: Any, path: Path) -> Session:
    with asammdf.MDF(path) as mdf:
        texts = {
            str(block.file_name): mdf.extract_attachment(number)[0]
            for number, block in enumerate(mdf.attachments)
        }
        about = description_of(texts[description.NAME], str(path))
        named = {group.channel_group.acq_name: n for n, group in enumerate(mdf.groups)}

        def samples(run: RunDescription, group: GroupDescription) -> Columns:
            number = named[f"{run.label}/{group.name}"]
            got = {
                name: np.array(mdf.get(name, group=number).samples)
                for name in ("time_s", "t_ns", *group.channels)
            }
            return got.pop("time_s"), got.pop("t_ns").astype(np.int64), got

        return session_of(about, samples, str(path))


def _names_description(path: Path) -> bool:
    """Return whether our attachment's name occurs in an MF4, because opening one may take long."""
    wanted, kept = description.NAME.encode(), b""
    with path.open("rb") as file:
        file.seek(_HEADER_AT)
        header = file.read(_FIRST_ATTACHMENT.stop)
        if header[:4] == b"##HD" and not any(header[_FIRST_ATTACHMENT]):
            return False  # as in most logs, which may have many gigabytes
        file.seek(0)
        while piece := file.read(1 << 20):
            if wanted in kept + piece:
                return True
            kept = piece[-len(wanted) :]
    return False


def _parquet(path: Path) -> Session | None:
    parquet = optional("pyarrow.parquet", "data")
    with parquet.ParquetFile(path) as file:
        text = (file.schema_arrow.metadata or {}).get(description.KEY.encode())
        if text is None:
            return None
        table = file.read()
    about = description_of(text, str(path))
    runs, groups = (np.array(table["run"].to_pylist()), np.array(table["group"].to_pylist()))

    def samples(run: RunDescription, group: GroupDescription) -> Columns:
        rows = (runs == run.label) & (groups == group.name)
        own = table.filter(rows)
        values = {name: _floats(own[name]) for name in group.channels}
        return _floats(own["time_s"]), own["t_ns"].to_numpy().astype(np.int64), values

    return session_of(about, samples, str(path))


def _floats(column: Any) -> NDArray[np.float64]:
    return np.asarray(column.to_pandas(), np.float64)


def _uff(path: Path) -> Session:
    return read_exported_uff(path, _described(description.sidecar_of(path)))


def _log(path: Path) -> Session:
    return read_exported_log(path, _described(description.sidecar_of(path)))


def _is_described(path: Path) -> bool:
    return description.sidecar_of(path).is_file()


def _csv(path: Path) -> Session | None:
    about = _described(path)
    style = CsvStyle(*about.style)

    def samples(run: RunDescription, group: GroupDescription) -> Columns:
        if Path(group.file).name != group.file or not group.file:
            raise ValueError(f"names {group.file!r}, which is not a file next to it")
        time_s, values = read_csv(path.with_name(group.file), style, group.channels)
        return time_s, None, values

    return session_of(about, samples, str(path))


def _described(sidecar: Path) -> Description:
    """Return the description in a file next to an export."""
    if sidecar.stat().st_size > _MAX_SIDECAR_BYTES:
        raise InputError(str(sidecar), "is larger than any description", "check what it is")
    return description_of(sidecar.read_bytes(), str(sidecar))


_Reader = tuple[Callable[[Path, bytes], bool], Callable[[Path], Session | None]]
_READERS: Sequence[_Reader] = (
    (lambda _, head: head[:8] == b"MDF     ", _mf4),
    (lambda _, head: head[:4] == b"PAR1", _parquet),
    (lambda _, head: head[:10] == b"MATLAB 5.0", read_exported_mat),
    (lambda path, _: path.name.endswith(f".csv.{description.NAME}"), _csv),
    (lambda path, head: head.lstrip()[:2] == b"-1" and _is_described(path), _uff),
    (lambda path, _: _is_described(path), _log),
)
