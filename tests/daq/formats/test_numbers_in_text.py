"""Numbers and payloads as texts: how long they may be, what is none, and what is cut off."""

from __future__ import annotations

import numpy as np
import pytest

from daq.formats.text import cut_lines, decimals, integers, is_word, packed_bytes, spaced_bytes

INTEGERS: list[tuple[str, int, int, int | None]] = [
    ("0", 10, 18, 0),
    ("90", 10, 18, 90),
    ("9a", 10, 18, None),
    ("9aF", 16, 18, 0x9AF),
    ("9ag", 16, 18, None),
    ("7fffffffffffffff", 16, 18, 0x7FFFFFFFFFFFFFFF),
    ("101", 2, 18, 5),
    ("102", 2, 18, None),
    ("-1", 10, 18, None),
    ("1.0", 10, 18, None),
    ("123456789012345678", 10, 18, 123456789012345678),
    ("1234567890123456789", 10, 18, None),
    ("123", 10, 3, 123),
    ("1234", 10, 3, None),
    ("0001", 10, 3, None),
]


@pytest.mark.parametrize(("word", "base", "longest", "number"), INTEGERS)
def test_a_whole_number(word: str, base: int, longest: int, number: int | None) -> None:
    lines = cut_lines(f"{word} 777\n{word}".encode())
    value, good = integers(lines.text, *lines.token(0, np.arange(2)), base, longest)
    assert good.tolist() == [number is not None] * 2
    assert number is None or value.tolist() == [number] * 2


def test_nothing_is_no_number() -> None:
    lines = cut_lines(b"12\n")
    start, _ = lines.token(0, np.arange(1))
    assert not integers(lines.text, start, start, 10)[1].any()
    assert not decimals(lines.text, start, start, 9)[1].any()
    assert len(integers(lines.text, start[:0], start[:0], 10)[0]) == 0


DECIMALS: list[tuple[str, int, int | None]] = [
    ("1", 9, 1_000_000_000),
    ("1.5", 9, 1_500_000_000),
    ("1.", 9, 1_000_000_000),
    (".5", 9, 500_000_000),
    (".", 9, None),
    ("1.5.2", 9, None),
    ("1e5", 9, None),
    ("-1", 9, -1_000_000_000),
    ("--1", 9, None),
    ("0.000000001", 9, 1),
    ("0.0000000019", 9, 1),
    ("1.999", 0, 1),
    ("1.25", 1, 12),
    ("1234567890.123456789", 9, 1234567890123456789),
    ("1234567890", 9, 1234567890000000000),
    ("12345678901", 9, None),
    ("12345678901.123456789", 9, None),
    ("1234567890.12345678901234", 9, 1234567890123456789),
    ("1234567890.123456789012345", 9, 1234567890123456789),
    ("1234567890.1234567890123456", 9, None),  # 27 characters
]


@pytest.mark.parametrize(("word", "places", "number"), DECIMALS)
def test_a_decimal_fraction(word: str, places: int, number: int | None) -> None:
    lines = cut_lines(f"{word} 777\n{word}".encode())
    value, good = decimals(lines.text, *lines.token(0, np.arange(2)), places)
    assert good.tolist() == [number is not None] * 2
    assert number is None or value.tolist() == [number] * 2


def test_numbers_of_different_lengths_side_by_side() -> None:
    lines = cut_lines(b"1 22.5\n333 .25\n")
    rows = np.arange(2)
    assert integers(lines.text, *lines.token(0, rows), 10)[0].tolist() == [1, 333]
    assert decimals(lines.text, *lines.token(1, rows), 3)[0].tolist() == [22_500, 250]


def test_lines_and_their_tokens() -> None:
    lines = cut_lines(b"\n a  bc\td \r\n\r\n  \nef\n", b" \t")
    assert lines.number.tolist() == [1, 4]
    assert lines.count.tolist() == [3, 1]
    assert [lines.line(row) for row in (0, 1)] == [b"a  bc\td", b"ef"]
    commas = cut_lines(b"a b,c,,d\n", b",")
    assert commas.count.tolist() == [3]
    assert len(cut_lines(b"").first) == len(cut_lines(b"\n \n").first) == 0


def test_a_word_in_any_case_and_no_longer() -> None:
    lines = cut_lines(b"Rx rX RX r rxx rx[ @x ^\n")
    same = [is_word(lines, lines.start[n : n + 1], lines.end[n : n + 1], b"rx") for n in range(8)]
    assert [bool(one[0]) for one in same] == [True, True, True, *[False] * 5]
    assert not is_word(lines, lines.start[6:7], lines.end[6:7], b"`x").any()


@pytest.mark.parametrize(
    ("text", "length", "data"),
    [
        (b"0aFf", 2, "0aff"),
        (b"0aFf", 1, "0a"),
        (b"0ag0", 2, None),
        (b"0a0g", 2, None),
        (b"0ag0", 1, "0a"),
        (b"0a" * 8, 8, "0a" * 8),
        (b"0a" * 9, 9, "0a" * 9),
        (b"0a" * 64, 64, "0a" * 64),
        (b"", 0, ""),
    ],
)
def test_a_payload_without_spaces(text: bytes, length: int, data: str | None) -> None:
    lines = cut_lines(text + b"\n")
    found, good = packed_bytes(lines.text, np.zeros(1, np.intp), np.array([length]))
    assert good.tolist() == [data is not None]
    assert found.shape == (1, 8 if length <= 8 else 64)
    assert data is None or found[0].tobytes() == bytes.fromhex(data).ljust(found.shape[1], b"\0")


@pytest.mark.parametrize(
    ("text", "base", "data"),
    [
        (b"0a ff 1", 16, "0aff01"),
        (b"255 0 10", 10, "ff000a"),
        (b"256", 10, None),
        (b"100", 16, None),
        (b"0ff", 16, "ff"),
        (b"00ff", 16, None),
        (b"0a g", 16, None),
        (b"1 " * 9, 16, "01" * 9),
    ],
)
def test_a_payload_with_spaces(text: bytes, base: int, data: str | None) -> None:
    lines = cut_lines(text + b"\n")
    length = np.array([len(text.split())])
    found, good = spaced_bytes(lines, lines.first[:1], length, base)
    assert good.tolist() == [data is not None]
    assert data is None or found[0].tobytes() == bytes.fromhex(data).ljust(found.shape[1], b"\0")
