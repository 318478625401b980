"""Packed files, read forwards as if they were not; what is damaged ends them and is counted."""

from __future__ import annotations

import gzip
import io

import pytest

from daq.formats.source import Ledger, Unpacked

CONTENT = bytes(range(256)) * 400
PACKED = gzip.compress(CONTENT, 1)


@pytest.mark.parametrize("packed", [False, True])
def test_pieces_of_a_file_and_how_many_bytes_they_are(packed: bool) -> None:
    ledger = Ledger()
    file = Unpacked(io.BytesIO(PACKED if packed else CONTENT), ledger)
    assert file.packed is packed
    assert (file.read(0), file.tell()) == (b"", 0)
    assert file.read(10) == CONTENT[:10]
    assert file.tell() == 10
    assert file.read(1 << 20) == CONTENT[10:]
    assert file.read(5) == b""
    assert file.tell() == len(CONTENT)
    assert not ledger.loss.any


def test_two_packed_parts_one_after_the_other() -> None:
    file = Unpacked(io.BytesIO(PACKED + PACKED), Ledger())
    assert file.read(1 << 20) == CONTENT * 2


@pytest.mark.parametrize("raw", [b"", b"\x1f", b"\x1f\x8a" + bytes(10)])
def test_short_files_are_not_packed(raw: bytes) -> None:
    file = Unpacked(io.BytesIO(raw), Ledger())
    assert (file.packed, file.read(99)) == (False, raw)


@pytest.mark.parametrize(
    "raw",
    [PACKED[:-1], PACKED[:200], PACKED[:-8] + bytes(8), PACKED[:60] + b"\xff" * 20],
    ids=["end", "most", "check", "middle"],
)
def test_what_is_cut_off_or_damaged_ends_a_packed_file(raw: bytes) -> None:
    ledger = Ledger()
    file = Unpacked(io.BytesIO(raw), ledger)
    pieces = []
    while piece := file.read(1000):
        pieces.append(piece)
    assert CONTENT.startswith(b"".join(pieces))
    assert file.read(10) == b""
    assert (ledger.loss.garbled, ledger.loss.bytes_cut) == (1, 0)
    assert len(ledger.loss.notes) == 1
