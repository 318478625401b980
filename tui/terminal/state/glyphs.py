"""Sets of characters that a terminal can show; every symbol is shown with a word."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

MOST_PIECES = 10


class GlyphSet(StrEnum):
    """Values of `--glyphs`."""

    AUTO = "auto"
    BRAILLE = "braille"
    BLOCKS = "blocks"
    ASCII = "ascii"


@dataclass(frozen=True, slots=True)
class Glyphs:
    """The characters of one set."""

    name: GlyphSet
    dots: tuple[int, int]
    """Sub-columns and sub-rows of a cell of a trace."""
    good: str
    bad: str
    warn: str
    now: str
    bus: str
    paused: str
    full: str
    empty: str
    """`full`, `empty`: pieces of a bar."""
    trigger: str
    axis: str
    overload: str

    def bar(self, done: int, planned: int, mark: str = "") -> str:
        """Return a piece for each planned item, at most ten; `mark` is the next one."""
        cells = min(planned, MOST_PIECES)
        filled = min(done, planned) * cells // max(planned, 1)
        bar = self.full * filled + (mark if filled < cells else "")
        return bar.ljust(cells, self.empty)


_BRAILLE = Glyphs(GlyphSet.BRAILLE, (2, 4), "✓", "✗", "!", "▶", "●", "○", "■", "·", "┊", "│", "▲")
_BLOCKS = Glyphs(GlyphSet.BLOCKS, (2, 2), "√", "x", "!", "►", "●", "○", "■", "·", "│", "│", "▲")
_ASCII = Glyphs(GlyphSet.ASCII, (1, 3), "+", "x", "!", ">", "*", "o", "#", ".", ":", "|", "^")
_SETS = {glyphs.name: glyphs for glyphs in (_BRAILLE, _BLOCKS, _ASCII)}


def choose_glyphs(wanted: GlyphSet, environment: Mapping[str, str], encoding: str) -> Glyphs:
    """Return the wanted set; for `auto` the best that the terminal reports to support.

    `wanted`: from the command line.  `environment`: `TERM` of the Linux console and of old ones
    have no braille; Windows Terminal sets `WT_SESSION`, the old console host does not.  `encoding`:
    encoding of stdout; any other than Unicode gets ASCII.
    """
    if wanted is not GlyphSet.AUTO:
        return _SETS[wanted]
    if not encoding.lower().replace("-", "").startswith("utf"):
        return _ASCII
    if environment.get("TERM", "") in ("linux", "vt100", "vt220", "dumb"):
        return _BLOCKS
    if environment.get("OS") == "Windows_NT" and "WT_SESSION" not in environment:
        return _BLOCKS
    return _BRAILLE
