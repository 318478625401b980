"""Lines of labels and texts, in a file and at a terminal."""

from __future__ import annotations

import sys

import pytest

from tui.output import print_item, print_labelled, print_line, print_table

SHORT = ("OK   bus", "3999 frames in 1.00 s")
LONG = ("FAIL channel accelerometer_hub_fl", "zero all the time -> plug it in, then check again")


def shown(rows: list[tuple[str, str]], capsys: pytest.CaptureFixture[str]) -> list[str]:
    print_labelled(rows)
    return capsys.readouterr().out.splitlines()


def test_texts_begin_two_columns_after_the_longest_label(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert shown([SHORT, LONG], capsys) == [
        "OK   bus                           3999 frames in 1.00 s",
        "FAIL channel accelerometer_hub_fl  zero all the time -> plug it in, then check again",
    ]
    assert shown([SHORT], capsys) == ["OK   bus  3999 frames in 1.00 s"]
    assert shown([("車輪", "wide"), ("abc", "narrow")], capsys) == ["車輪  wide", "abc   narrow"]
    assert shown([], capsys) == []


def test_foreign_text_is_no_emoji(capsys: pytest.CaptureFixture[str]) -> None:
    """Rich draws a car for `:car:`, which is also a name that a person may give."""
    print_line("session of :car:")
    print_table("Parts of :car:", [":car:"], [[":car:"]])
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert lines == ["session of :car:", "Parts of :car:", ":car:", ":car:"]


def test_in_a_file_a_text_is_one_line_whatever_its_length(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert shown([("a", "word " * 100)], capsys) == ["a  " + "word " * 100]


def test_an_item_is_folded_between_words_at_a_terminal_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    text = "weigh the added weights again"
    print_item(text)
    assert capsys.readouterr().out.splitlines() == [f"  - {text}"]
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    print_item(text)
    assert capsys.readouterr().out.splitlines() == ["  - weigh the added", "    weights again"]


def test_at_a_terminal_texts_are_folded_within_its_width(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "80")
    assert shown([SHORT, LONG], capsys) == [
        "OK   bus                           3999 frames in 1.00 s",
        "FAIL channel accelerometer_hub_fl  zero all the time -> plug it in, then check",
        "                                   again",
    ]


@pytest.mark.parametrize(
    ("size", "lines"),
    [(38, ["b" + 39 * " " + "y", "a" * 38 + "  x"]), (39, ["b  y", "a" * 39, "   x"])],
)
def test_a_label_that_fills_half_of_the_width_has_its_text_in_the_next_line(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    size: int,
    lines: list[str],
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "80")
    assert shown([("b", "y"), ("a" * size, "x")], capsys) == lines
