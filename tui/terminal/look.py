"""Themes of high contrast, and the filter for terminals that show only ASCII."""

from __future__ import annotations

from functools import lru_cache
from unicodedata import name, normalize

from rich.cells import cell_len
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter
from textual.theme import Theme

BENCH_DARK = Theme(
    name="bench-dark",
    primary="#4fb3ff",
    secondary="#8fd3ff",
    warning="#ffb000",
    error="#ff5c5c",
    success="#3ddc84",
    accent="#ffd54a",
    foreground="#ffffff",
    background="#000000",
    surface="#101418",
    panel="#1c2228",
    dark=True,
    text_alpha=1.0,
)
BENCH_LIGHT = Theme(
    name="bench-light",
    primary="#004a99",
    secondary="#003366",
    warning="#8a4b00",
    error="#a80000",
    success="#005c2e",
    accent="#5b2a86",
    foreground="#000000",
    background="#ffffff",
    surface="#f4f4f4",
    panel="#e2e2e2",
    dark=False,
    text_alpha=1.0,
)
THEMES = (BENCH_DARK, BENCH_LIGHT)


_SIMILAR = {
    "│": "|", "┃": "|", "║": "|", "▎": "|", "▏": "|", "▊": "|", "▌": "|", "▐": "|", "┊": ":",
    "─": "-", "━": "-", "═": "=", "▔": "-", "▁": "_", "▄": "_", "▀": "-", "█": "#", "■": "#",
    "·": ".", "•": "*", "●": "*", "○": "o", "▲": "^", "▼": "v", "▶": ">", "►": ">", "◀": "<",
    "✓": "+", "✗": "x", "√": "+", "±": "~", "\u00d7": "x", "\u2013": "-", "—": "-", "…": ".",
    "°": "o",
}  # fmt: skip


class PlainAscii(LineFilter):
    """Replace each character outside ASCII by a similar one of the same width."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments of a line in ASCII."""
        return [
            segment
            if segment.text.isascii()
            else Segment(_plain(segment.text), segment.style, segment.control)
            for segment in segments
        ]


@lru_cache(4096)
def _plain(text: str) -> str:
    """Return ASCII in as many columns; a character of no width or of two has none like it."""
    cells = ((character, cell_len(character)) for character in text.replace(" ± ", "+/-"))
    return "".join(_similar(character) if width == 1 else "?" * width for character, width in cells)


def _similar(character: str) -> str:
    if character.isascii():
        return character
    if character in _SIMILAR:
        return _SIMILAR[character]
    if "BOX DRAWINGS" in name(character, ""):
        return "+"
    first = normalize("NFKD", character)[:1]
    return first if first.isascii() else "?"
