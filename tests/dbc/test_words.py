"""Numbers of things, in words."""

from __future__ import annotations

import pytest

from dbc import counted, plural


@pytest.mark.parametrize(
    ("number", "text"),
    [(0, "0 frames"), (1, "1 frame"), (2, "2 frames"), (999, "999 frames"), (1000, "1,000 frames")],
)
def test_one_thing_has_no_s(number: int, text: str) -> None:
    assert counted(number, "frame") == text


def test_irregular_words_are_stated() -> None:
    assert [counted(n, "bus is", "buses are") for n in (0, 1, 2)] == [
        "0 buses are",
        "1 bus is",
        "2 buses are",
    ]
    assert plural(1, "was", "were") == "was"
    assert plural(2, "was", "were") == "were"
