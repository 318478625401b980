"""Packed files, read forwards as if they were not; what is damaged ends them and is counted."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import pytest

from daq.errors import InputError
from daq.formats import unpacked
from daq.formats.losses import Ledger, LogLoss
from daq.formats.unpacked import Unpacked, on_disk

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
    assert file.position == len(PACKED if packed else CONTENT)
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
    assert len(ledger.loss.notes) == 2


def test_a_packed_file_is_unpacked_on_the_disk_as_long_as_it_is_needed(tmp_path: Path) -> None:
    (tmp_path / "a.mf4.gz").write_bytes(PACKED)
    (tmp_path / "b.mf4").write_bytes(CONTENT)
    with on_disk(tmp_path / "a.mf4.gz", Ledger()) as path:
        assert path.name == "a.mf4"
        assert path.read_bytes() == CONTENT
    assert not path.exists()
    with on_disk(tmp_path / "b.mf4", Ledger()) as path:
        assert path == tmp_path / "b.mf4"
    assert path.exists()


def test_a_file_that_unpacks_to_more_than_there_is_room_for_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.gz").write_bytes(gzip.compress(bytes(3 << 20)))
    for limit, good in ((3 << 20, True), ((3 << 20) - 1, False)):
        monkeypatch.setattr(unpacked, "MAX_UNPACKED_BYTES", limit)
        if good:
            with on_disk(tmp_path / "a.gz", Ledger()) as path:
                assert path.stat().st_size == 3 << 20
            continue
        with (
            pytest.raises(InputError, match="more than 2 MiB"),
            on_disk(tmp_path / "a.gz", Ledger()),
        ):
            pass


def test_the_account_of_a_log_has_its_first_eight_notes() -> None:
    ledger = Ledger()
    assert (ledger.loss.any, ledger.loss.text) == (False, "")
    ledger.garbled(2, "first")
    assert (ledger.loss.any, ledger.loss.text) == (True, "2 records unreadable; first")
    ledger.cut(5, "second\n")
    for n in range(3, 11):
        ledger.cut(1, f"note {n}")
    loss = ledger.loss
    assert (loss.garbled, loss.bytes_cut, len(loss.notes)) == (2, 13, 8)
    assert loss.text.startswith("2 records unreadable, 13 bytes cut off; first; second")
    assert loss.text.endswith("; note 8")
    assert LogLoss(0, 1, ()).any
    assert LogLoss(0, 1, ()).text == "1 bytes cut off"
    assert not LogLoss(0, 0, ("a note",)).any
    assert LogLoss(0, 0, ("a note",)).text == ""
