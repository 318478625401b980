"""The two themes for a noisy hall: every colour is named, and can be read on its ground."""

from __future__ import annotations

import pytest
from textual.color import Color
from textual.theme import Theme

from tui.terminal.look import BENCH_DARK, BENCH_LIGHT, THEMES

LETTERS = ("primary", "secondary", "warning", "error", "success", "accent", "foreground")
GROUNDS = ("background", "surface", "panel")


def luminance(colour: Color) -> float:
    """Return the relative luminance of WCAG 2.2."""
    parts = (channel / 255 for channel in colour.rgb)
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", [BENCH_DARK, BENCH_LIGHT], ids=lambda theme: theme.name)
@pytest.mark.parametrize("letters", LETTERS)
@pytest.mark.parametrize("ground", GROUNDS)
def test_letters_stand_out_from_every_ground(theme: Theme, letters: str, ground: str) -> None:
    """WCAG 2.2 asks for 4.5 to 1 (AA)."""
    named = getattr(theme, letters), getattr(theme, ground)
    assert all(named), "named here, not made up by the library"
    low, high = sorted(luminance(Color.parse(name)) for name in named)
    assert (high + 0.05) / (low + 0.05) >= 4.5


def test_the_grounds_differ_and_letters_are_drawn_in_full() -> None:
    for theme in THEMES:
        assert len({getattr(theme, ground) for ground in GROUNDS}) == 3
        assert theme.text_alpha == 1.0
    assert (BENCH_DARK.dark, BENCH_LIGHT.dark) == (True, False)
    assert luminance(Color.parse(BENCH_DARK.background or "")) == 0.0
    assert luminance(Color.parse(BENCH_LIGHT.background or "")) == pytest.approx(1.0)
