"""Reads files forwards that may be packed with gzip, and unpacks them."""

from __future__ import annotations

import gzip
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Protocol

from dbc.errors import InputError

from .losses import Ledger

GZIP_MAGIC = b"\x1f\x8b"
MAX_UNPACKED_BYTES = 16 << 30
"""Largest unpacked size of a packed file on the disk, bytes: a day of a full bus."""


class Readable(Protocol):
    """Bytes that are read forwards."""

    def read(self, size: int, /) -> bytes:
        """Return this number of bytes, fewer at the end."""

    def tell(self) -> int:
        """Return the number of bytes read."""


class Unpacked:
    """A file that is unpacked while it is read, if packed; it ends where it is damaged or cut.

    `file`: at its beginning.  `ledger`: collects the losses.
    """

    def __init__(self, file: BinaryIO, ledger: Ledger) -> None:
        self._raw, self._ledger = file, ledger
        self.packed = file.read(2) == GZIP_MAGIC
        """True if it is packed."""
        file.seek(0)
        self._stream: BinaryIO | gzip.GzipFile = (
            gzip.GzipFile(fileobj=file) if self.packed else file
        )
        self._count = 0

    def read(self, size: int, /) -> bytes:
        """Return this number of bytes, fewer at the end."""
        parts: list[bytes] = []
        left = size
        try:
            while left and (part := self._stream.read(left)):
                parts.append(part)
                left -= len(part)
        except (EOFError, gzip.BadGzipFile, zlib.error):
            self._ledger.cut(0, "it cannot be unpacked to its end")
            self._ledger.garbled(1, "the rest is lost")
            self._stream = self._raw
            self._raw.seek(0, 2)
        data = b"".join(parts)
        self._count += len(data)
        return data

    def tell(self) -> int:
        """Return the number of bytes read, unpacked."""
        return self._count

    @property
    def position(self) -> int:
        """Position in the stored file."""
        return self._raw.tell()


@contextmanager
def on_disk(path: Path, ledger: Ledger) -> Iterator[Path]:
    """Yield a file's path; for a packed file, that of an unpacked temporary copy.

    Raises InputError if there is no room for the copy, or it is larger than `MAX_UNPACKED_BYTES`.
    """
    with path.open("rb") as file:
        source = Unpacked(file, ledger)
        if not source.packed:
            yield path
            return
        with tempfile.TemporaryDirectory(prefix="bumpbench") as folder:
            copy = Path(folder) / path.stem
            room = min(MAX_UNPACKED_BYTES, shutil.disk_usage(folder).free // 2)
            with copy.open("wb") as target:
                while piece := source.read(1 << 20):
                    if target.tell() + len(piece) > room:
                        what = f"unpacks to more than {room >> 20} MiB"
                        raise InputError(str(path), what, "unpack it yourself")
                    target.write(piece)
            yield copy
