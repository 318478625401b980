"""Chunks that are packed here and unpacked by HDF5's own filters."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from daq.session.chunks import fletcher32
from daq.session.datasets import write_column


def summed(content: bytes) -> int:
    """Return Fletcher's checksum of bytes, word by word."""
    first = second = 0
    for at in range(0, len(content), 2):
        first += int.from_bytes(content[at : at + 2].ljust(2, b"\0"), "big")
        first = (first & 0xFFFF) + (first >> 16)
        second += first
        second = (second & 0xFFFF) + (second >> 16)
    return second << 16 | first


@pytest.mark.parametrize("size", [0, 1, 2, 3, 719, 720, 65_537, 140_000])
def test_the_checksum_is_fletchers(size: int) -> None:
    for content in (np.random.default_rng(size).bytes(size), bytes(size), b"\xff" * size):
        assert fletcher32(content) == summed(content)


@pytest.mark.parametrize("rows", [1, 8191, 8192, 8193, 16_384, 20_001])
@pytest.mark.parametrize("form", ["f8", "i8", "u1", "S3", "64u1"])
def test_hdf5_unpacks_what_was_packed(tmp_path: Path, rows: int, form: str) -> None:
    size = np.dtype(form).itemsize
    raw = np.random.default_rng(rows).integers(1, 100, rows * size, np.uint8)
    values = np.frombuffer(raw.tobytes(), form)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write_column(file.id, "column", values)
    with h5py.File(tmp_path / "a.h5") as file:
        column = file["column"]
        assert (column.compression, column.shuffle, column.fletcher32) == ("gzip", True, True)
        assert column.chunks[0] == min(rows, 8192)
        np.testing.assert_array_equal(column[()], values)


def test_a_changed_bit_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        write_column(file.id, "column", np.random.default_rng(1).normal(size=1000))
    with h5py.File(path) as file:
        where = file["column"].id.get_chunk_info(0)
    damaged = bytearray(path.read_bytes())
    damaged[where.byte_offset + where.size // 2] ^= 1
    path.write_bytes(damaged)
    with h5py.File(path) as file, pytest.raises(OSError, match="filter returned failure"):
        file["column"][()]
