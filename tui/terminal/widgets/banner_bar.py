"""The banner: three rows over the full width, to be read from three metres."""

from __future__ import annotations

from textwrap import wrap

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.content import Content
from textual.widgets import Digits, Static

from ..state.banner import Banner
from ..state.glyphs import Glyphs, GlyphSet

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
