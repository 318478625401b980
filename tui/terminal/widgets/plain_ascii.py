"""Filter that replaces every character outside ASCII, for terminals that show no more."""

from __future__ import annotations

from functools import lru_cache
from unicodedata import name, normalize

from rich.cells import cell_len
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

_LIKE = {
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
    cells = ((character, cell_len(character)) for character in text.replace(" ± ", "+/-"))
    return "".join(_one(character) if width == 1 else "?" * width for character, width in cells)


def _one(character: str) -> str:
    if character.isascii():
        return character
    if character in _LIKE:
        return _LIKE[character]
    if "BOX DRAWINGS" in name(character, ""):
        return "+"
    first = normalize("NFKD", character)[:1]
    return first if first.isascii() else "?"
