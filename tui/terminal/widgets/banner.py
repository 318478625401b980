"""The state as a banner of three rows, to be read from some metres."""

from __future__ import annotations

from textwrap import wrap

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.content import Content
from textual.widgets import Digits, Static

from ..state.glyphs import Glyphs, GlyphSet
from ..state.words import Banner

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
        """Show a banner; a first line that is too long may continue before the second."""
        if (banner, self.size.width) == self._shown:
            return
        self._shown = banner, self.size.width
        for kind in KINDS:
            self.set_class(kind == banner.kind, f"-{kind}")
        first, second = banner.first, banner.second
        if banner.folds:
            first, *others = wrap(first, max(20, self.size.width - _DIGITS - 3)) or [""]
            second = "  ".join(part for part in (" ".join(others), second) if part)
        head = f" {banner.symbol} {banner.word:<{_WORD}}{banner.title}"
        self._words.update(Content.assemble((head, "bold"), f"\n   {first}\n   {second}"))
        self._digits.update(f"\n{banner.digits:>5} " if self._plain else banner.digits)
