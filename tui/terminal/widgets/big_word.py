"""The state word in big letters, to be read from five metres."""

from __future__ import annotations

from textual.content import Content

from ..state.banner import Banner
from ..state.big_letters import ROWS, big_word
from ..state.glyphs import Glyphs, GlyphSet
from .banner_bar import KINDS
from .words import Words

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
