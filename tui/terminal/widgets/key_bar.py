"""The keys of the screen in one line: packed tighter than Textual's footer, which cuts at 80."""

from __future__ import annotations

from textual.content import Content
from textual.screen import Screen

from .words import Words

_FIRST, _LAST = "press('next')", "help"
_DROPPED = ("app.sessions", "app.step(1)", "more", "press('redo')", "app.note", "view")
"""Actions to leave out first where the line is too short; help and palette list all keys."""


class KeyBar(Words):
    """Every binding of the screen that does something now: SPACE first, help last."""

    def __init__(self) -> None:
        super().__init__()

    def on_mount(self) -> None:
        """Follow the bindings."""
        self.screen.bindings_updated_signal.subscribe(self, self._changed)
        self._changed(self.screen)

    def on_resize(self) -> None:
        """Fill the new width."""
        self._changed(self.screen)

    def _changed(self, screen: Screen[object]) -> None:
        shown: dict[str, tuple[str, str]] = {}
        for _, binding, enabled, _ in screen.active_bindings.values():
            if binding.show and enabled and binding.action not in shown:
                key = binding.key_display or self.app.get_key_display(binding)
                shown[binding.action] = (key, binding.description)
        # Keys of the screen itself come before those that every screen has.
        common = ("app.step(1)", "app.note", "app.sessions")
        order = sorted(
            shown, key=lambda action: (action != _FIRST, action == _LAST, action in common)
        )
        width = self.size.width or self.app.size.width  # on a screen that has just come
        for action in (*_DROPPED, *reversed([a for a in order if a not in (_FIRST, _LAST)])):
            if sum(len(" ".join(shown[a])) + 2 for a in order) <= width + 2:
                break
            order = [a for a in order if a != action]
        parts: list[tuple[str, str]] = []
        for action in order:
            key, words = shown[action]
            parts += [(key, "bold $accent"), (f" {words}  ", "$foreground")]
        self.say(Content.assemble(*parts))
