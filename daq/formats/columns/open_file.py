"""Opens a file of columns, in the format that its content shows."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from ...errors import InputError
from .csv_table import open_csv
from .hdf5 import open_hdf5
from .matlab5 import open_matlab5
from .mdf import open_mdf
from .opened import ColumnFile
from .parquet import open_parquet
from .tdms import open_tdms

NAMES = "CSV, MF4, MAT, TDMS, Parquet, HDF5"
"""Names of the formats, for messages."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAGIC: dict[bytes, Callable[[Path], AbstractContextManager[ColumnFile]]] = {
    b"PAR1": open_parquet,
    b"MDF     ": open_mdf,
    b"TDSm": open_tdms,
    b"MATLAB 5.0": open_matlab5,
    b"MATLAB 7.3": open_hdf5,
    _HDF5: open_hdf5,
}
_HEAD_BYTES = 4096


def open_columns(path: Path) -> AbstractContextManager[ColumnFile]:
    """Return a file of columns, to be used in a `with` statement.

    Raises InputError if it is missing, empty or of no known kind.
    """
    where = str(path)
    if not path.is_file():
        what = "is not a regular file" if path.exists() else "no such file"
        raise InputError(where, what, f"name a file of channels: {NAMES}")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError(where, what, "check rights and disk") from error
    if not head:
        raise InputError(where, "is empty", "check that it is the right file")
    if head.startswith(b"UnFinMF "):
        what = "was not finished by its logger"
        raise InputError(where, what, "finish it with the logger's tool, or import its bus log")
    for magic, opener in _MAGIC.items():
        if head.startswith(magic):
            return opener(path)
    if _HDF5 in (head[512:520], head[1024:1032], head[2048:2056]):  # after a head of its maker
        return open_hdf5(path)
    return open_csv(path)
