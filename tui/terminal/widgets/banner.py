"""The state as a banner of three rows, and in big letters."""

from __future__ import annotations

from textwrap import wrap

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.content import Content
from textual.widgets import Digits, Static

from ..state.glyphs import Glyphs, GlyphSet
from ..state.words import Banner
from .bars import Words

ROWS = 5
_FONT = {
    " ": ("  ", "  ", "  ", "  ", "  "),
    "A": (" ### ", "#   #", "#####", "#   #", "#   #"),
    "B": ("#### ", "#   #", "#### ", "#   #", "#### "),
    "C": (" ####", "#    ", "#    ", "#    ", " ####"),
    "D": ("#### ", "#   #", "#   #", "#   #", "#### "),
    "E": ("#####", "#    ", "#### ", "#    ", "#####"),
    "G": (" ####", "#    ", "#  ##", "#   #", " ####"),
    "I": ("###", " # ", " # ", " # ", "###"),
    "J": ("  ###", "    #", "    #", "#   #", " ### "),
    "L": ("#    ", "#    ", "#    ", "#    ", "#####"),
    "M": ("#   #", "## ##", "# # #", "#   #", "#   #"),
    "N": ("#   #", "##  #", "# # #", "#  ##", "#   #"),
    "O": (" ### ", "#   #", "#   #", "#   #", " ### "),
    "P": ("#### ", "#   #", "#### ", "#    ", "#    "),
    "R": ("#### ", "#   #", "#### ", "#  # ", "#   #"),
    "S": (" ####", "#    ", " ### ", "    #", "#### "),
    "T": ("#####", "  #  ", "  #  ", "  #  ", "  #  "),
    "U": ("#   #", "#   #", "#   #", "#   #", " ### "),
    "W": ("#   #", "#   #", "# # #", "## ##", "#   #"),
    "Y": ("#   #", " # # ", "  #  ", "  #  ", "  #  "),
}


def big_word(word: str, width: int, height: int, full: str) -> list[str]:
    """Return the rows of a word in the largest size that fits; no row where none fits.

    `width`, `height`: cells.  `full`: the character that fills a cell.
    """
    rows = [" ".join(_FONT[letter][row] for letter in word) for row in range(ROWS)]
    times = min(3, width // max(1, len(rows[0])), height // ROWS)
    wide = ["".join(full * times if dot == "#" else " " * times for dot in row) for row in rows]
    return [row for row in wide for _ in range(times)]


KINDS = ("armed", "moving", "good", "bad", "quiet")
_WORD, _DIGITS = 13, 10


class BannerBar(Horizontal):
    """State as symbol, word and digits; the colour only adds to it."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._plain = glyphs.name is GlyphSet.ASCII
        self._shown: tuple[Banner, int] | None = None
        # Stored, not queried: a status may come before they are composed.
        self._words = Static(markup=False)
        self._digits = Static(markup=False, id="figures") if self._plain else Digits()

    def compose(self) -> ComposeResult:
        """Compose words on the left, digits on the right."""
        yield self._words
        yield self._digits

    def show(self, banner: Banner) -> None:
        """Show a banner."""
        if (banner, self.size.width) == self._shown:
            return
        self._shown = banner, self.size.width
        for kind in KINDS:
            self.set_class(kind == banner.kind, f"-{kind}")
        indent = " " * 3
        lines = [
            Content.assemble(
                (f" {banner.symbol} {banner.word:<{_WORD}}", "bold"), (banner.title, "bold")
            ),
            *(Content(f"{indent}{line}") for line in self._folded(banner, len(indent))),
        ]
        self._words.update(Content("\n").join(lines))
        self._digits.update(f"\n{banner.digits:>5} " if self._plain else banner.digits)

    def _folded(self, banner: Banner, indent: int) -> list[str]:
        """Return two lines; a first line that is too long may continue before the second."""
        if not banner.folds:
            return [banner.first, banner.second]
        room = max(20, self.size.width - _DIGITS - indent)
        first, *rest = wrap(banner.first, room) or [""]
        second = "  ".join(part for part in (" ".join(rest), banner.second) if part)
        return [first, second]


_SHARE = 3
"""Divisor of the screen's height that gives the largest height of the word."""


class BigWord(Words):
    """Shows the state word in at least five rows, in the banner's colour."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._full = "#" if glyphs.name is GlyphSet.ASCII else "█"

    def show(self, banner: Banner, wanted: bool) -> None:
        """Show the word of a banner; hide where it is not wanted, or does not fit."""
        width, height = self.app.size
        rows = big_word(banner.word, width - 1, max(ROWS, height // _SHARE), self._full)
        self.display = wanted and bool(rows)
        for kind in KINDS:
            self.set_class(kind == banner.kind, f"-{kind}")
        self.say(Content("\n".join(f" {row}" for row in rows)))
