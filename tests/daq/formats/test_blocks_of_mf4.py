"""Blocks of MDF 4: data, lists, packings, chains and texts, and what of them is refused."""

from __future__ import annotations

import io
import struct
import zlib

import pytest

from daq.errors import InputError
from daq.formats.losses import Ledger
from daq.formats.mdf4_blocks import BlockFile

from .loggers import Mdf

HEAD = struct.pack("<QhhBBBBdd", 0, 0, 0, 0, 0, 0, 0, 0, 0)
CONTENT = bytes(range(1, 25))


def _mdf(unfinished: bool = False) -> Mdf:
    mdf = Mdf(unfinished)
    mdf.block("HD", [0] * 6, HEAD)
    return mdf


def _pieces(mdf: Mdf, at: int, cut: int = 0) -> tuple[bytes, int]:
    """Return the data at a place, and the bytes that were lost; `cut`: bytes off the end."""
    ledger = Ledger()
    file = BlockFile(io.BytesIO(mdf.raw[: len(mdf.raw) - cut]), "a.mf4", ledger)
    return b"".join(file.pieces(at)), ledger.loss.bytes_cut


@pytest.mark.parametrize("kind", ["DT", "SD", "RD"])
def test_the_data_of_a_plain_block(kind: str) -> None:
    mdf = _mdf()
    at = mdf.block(kind, [], CONTENT)
    mdf.block("TX", [], b"behind it")
    assert _pieces(mdf, at) == (CONTENT, 0)


def test_data_behind_the_links_of_a_block() -> None:
    mdf = _mdf()
    assert _pieces(mdf, mdf.block("DT", [64, 64], CONTENT)) == (CONTENT, 0)


def test_a_block_of_no_data_and_no_block() -> None:
    mdf = _mdf()
    assert _pieces(mdf, mdf.block("DT", [], b"")) == (b"", 0)
    assert _pieces(mdf, 0) == (b"", 0)


@pytest.mark.parametrize("cut", [1, 10, 24])
def test_data_that_are_cut_off(cut: int) -> None:
    mdf = _mdf()
    at = mdf.block("DT", [], CONTENT)
    assert _pieces(mdf, at, cut) == (CONTENT[: 24 - cut], cut)


@pytest.mark.parametrize(
    ("flags", "size", "taken", "lost"),
    [
        (0b100, 0, 24, 0),  # the length of the last block was never written
        (0b100, 24, 24, 0),
        (0b100, 25, 1, 0),
        (0b100, 1000, 24, 0),
        (0b100, 48, 24, 0),
        (0b011, 24, 0, 0),
        (0b011, 1000, 24, 1000 - 48),
    ],
)
def test_a_last_block_whose_length_was_never_written(
    flags: int, size: int, taken: int, lost: int
) -> None:
    mdf = _mdf(unfinished=True)
    mdf.raw[60:62] = struct.pack("<H", flags)
    at = mdf.block("DT", [], CONTENT)
    struct.pack_into("<Q", mdf.raw, at + 8, size)
    assert _pieces(mdf, at) == (CONTENT[:taken], lost)


def test_a_finished_file_has_its_length_whatever_the_flags_are() -> None:
    mdf = _mdf()
    mdf.raw[60:62] = struct.pack("<H", 0b100)
    at = mdf.block("DT", [], CONTENT)
    struct.pack_into("<Q", mdf.raw, at + 8, 24)
    assert _pieces(mdf, at) == (b"", 0)


def test_data_in_lists_that_follow_each_other() -> None:
    mdf = _mdf()
    parts = [mdf.block("DT", [], CONTENT[n : n + 8]) for n in (0, 8, 16)]
    second = mdf.block("DL", [0, parts[2]], bytes(8))
    first = mdf.block("DL", [second, parts[0], 0, parts[1]], bytes(8))
    assert _pieces(mdf, first) == (CONTENT, 0)
    assert _pieces(mdf, mdf.block("HL", [first], bytes(8))) == (CONTENT, 0)
    assert _pieces(mdf, mdf.block("HL", [parts[1], first], bytes(8))) == (CONTENT[8:16], 0)
    assert _pieces(mdf, mdf.block("HL", [0], bytes(8))) == (b"", 0)
    assert _pieces(mdf, mdf.block("HL", [], bytes(8))) == (b"", 0)


def _packed(
    data: bytes, method: int = 0, columns: int = 0, claimed: int | None = None, whole: int = 0
) -> bytes:
    claimed = len(data) if claimed is None else claimed
    packed = zlib.compress(data)[: whole or None]
    return struct.pack("<2sBxLQQ", b"DT", method, columns, claimed, len(packed)) + packed


# Records of 5 bytes, column by column: 4 records, and 4 bytes that fill none.
_UPRIGHT = bytes(CONTENT[row * 5 + column] for column in range(5) for row in range(4))
PACKED: dict[str, tuple[bytes, bytes, int]] = {
    "deflated": (_packed(CONTENT), CONTENT, 0),
    "transposed": (_packed(_UPRIGHT + CONTENT[20:], 1, 5), CONTENT, 0),
    "transposed, one column": (_packed(CONTENT, 1, 1), CONTENT, 0),
    "transposed, one row": (_packed(CONTENT, 1, 24), CONTENT, 0),
    "transposed, no row": (_packed(CONTENT, 1, 25), CONTENT, 0),
    "transposed, no column": (_packed(CONTENT, 1, 0), b"", 24),
    "transposed, 64 MiB": (_packed(CONTENT, 1, 1, 64 << 20), CONTENT, (64 << 20) - 24),
    "transposed, larger": (_packed(CONTENT, 1, 1, (64 << 20) + 1), b"", (64 << 20) + 1),
    "another way": (_packed(CONTENT, 2, 5), b"", 24),
    "more than claimed": (_packed(CONTENT, claimed=20), CONTENT[:20], 0),
    "less than claimed": (_packed(CONTENT, claimed=30), CONTENT, 6),
    "no zlib": (struct.pack("<2sBxLQQ", b"DT", 0, 0, 24, 9) + bytes(9), b"", 24),
    "nothing": (_packed(b""), b"", 0),
}


@pytest.mark.parametrize("name", PACKED)
def test_a_packed_block(name: str) -> None:
    body, data, lost = PACKED[name]
    mdf = _mdf()
    at = mdf.block("DZ", [], body)
    mdf.block("TX", [], b"behind it")
    assert _pieces(mdf, at) == (data, lost)


def test_packed_data_end_with_their_block_and_with_the_file() -> None:
    noise = bytes((n * n * 31 + n // 7) % 251 for n in range(400))
    for links in ([], [64, 64]):
        mdf = _mdf()
        at = mdf.block("DZ", links, _packed(noise))
        size = len(mdf.raw) - at
        assert _pieces(mdf, at) == (noise, 0)
        found, lost = _pieces(mdf, at, cut=40)
        assert noise.startswith(found)
        assert lost == 400 - len(found) > 0
        struct.pack_into("<Q", mdf.raw, at + 8, size - 40)  # and what follows is no part of it
        assert _pieces(mdf, at) == (found, lost)


def test_a_packed_block_without_its_head_is_damage() -> None:
    mdf = _mdf()
    at = mdf.block("DZ", [], _packed(b""))
    cut = len(zlib.compress(b""))
    assert _pieces(mdf, at, cut) == (b"", 0)
    with pytest.raises(InputError, match=f"byte {at}"):
        _pieces(mdf, at, cut + 1)


def _blocks(mdf: Mdf) -> BlockFile:
    return BlockFile(io.BytesIO(mdf.raw), "a.mf4", Ledger())


def test_a_block_with_its_links_and_its_text() -> None:
    mdf = _mdf()
    at = mdf.block("CG", [7, 8, 9], b"body")
    text, comment = mdf.text("Motor °C"), mdf.block("MD", [], b"<x/>\0\0")
    file = _blocks(mdf)
    block = file.block(at, b"##CN", b"##CG")
    assert (block.kind, block.links, block.body) == (b"##CG", (7, 8, 9), b"body")
    assert (file.text(text), file.text(comment), file.text(0)) == ("Motor °C", "<x/>", "")
    assert file.kind(at) == b"##CG"


def test_a_chain_of_blocks_ends_without_a_link_and_is_refused_in_a_circle() -> None:
    mdf = _mdf()
    last = mdf.block("CG", [], b"b")
    first = mdf.block("CG", [last, last], b"a")
    assert [block.body for block in _blocks(mdf).chain(first, b"##CG")] == [b"a", b"b"]
    assert not list(_blocks(mdf).chain(0, b"##CG"))
    circle = mdf.block("CG", [0], b"")
    mdf.link(circle, 0, circle)
    with pytest.raises(InputError, match="circle"):
        list(_blocks(mdf).chain(circle, b"##CG"))


DAMAGED: dict[str, tuple[int, int, bool]] = {
    "1 MiB": (24 + 8 * 2 + (1 << 20), 2, True),
    "more than 1 MiB": (24 + 8 * 2 + (1 << 20) + 1, 2, False),
    "no body": (24 + 8 * 2, 2, True),
    "less than no body": (24 + 8 * 2 - 1, 2, False),
    "beyond the end": (24 + 8 * 2 + (1 << 20), 3, False),
    "2^20 links": (24 + 8 * (1 << 20), 1 << 20, True),
    "more links": (24 + 8 * ((1 << 20) + 1), (1 << 20) + 1, False),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_block_of_an_impossible_size_is_refused(name: str) -> None:
    size, links, good = DAMAGED[name]
    mdf = _mdf()
    at = len(mdf.raw)
    mdf.raw += struct.pack("<4s4xQQ", b"##CG", size, links) + bytes(max(size, 24) - 24)
    if name == "beyond the end":
        del mdf.raw[-1:]
    if good:
        block = _blocks(mdf).block(at, b"##CG")
        assert (len(block.links), len(block.body)) == (links, size - 24 - 8 * links)
        return
    with pytest.raises(InputError, match=f"byte {at}"):
        _blocks(mdf).block(at, b"##CG")


def test_a_link_to_nowhere_and_to_another_kind_are_refused() -> None:
    mdf = _mdf()
    at = mdf.block("CN", [], b"")
    for place in (len(mdf.raw), len(mdf.raw) - 23, 1 << 60):
        with pytest.raises(InputError, match=f"byte {place}"):
            _blocks(mdf).kind(place)
    with pytest.raises(InputError, match=f"byte {at} is not a CG"):
        _blocks(mdf).block(at, b"##CG")
    with pytest.raises(InputError, match=f"byte {at} is not a DT"):
        list(_blocks(mdf).pieces(at))


def test_a_file_without_a_header_block_is_refused() -> None:
    with pytest.raises(InputError, match="no header block"):
        _blocks(Mdf(unfinished=False))
    mdf = _mdf()
    mdf.raw[:8] = b"MDF 3   "
    with pytest.raises(InputError, match="begin with MDF"):
        _blocks(mdf)
