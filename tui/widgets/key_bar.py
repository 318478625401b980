"""The keys of the screen in one line: packed tighter than Textual's footer, which cuts at 80."""

from __future__ import annotations

from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static


class KeyBar(Static):
    """Every binding of the screen that is to be shown, in the order in which it was bound."""

    def __init__(self) -> None:
        super().__init__(markup=False)

    def on_mount(self) -> None:
        """Follow the bindings."""
        self.screen.bindings_updated_signal.subscribe(self, self._changed)
        self._changed(self.screen)

    def _changed(self, screen: Screen[object]) -> None:
        shown: dict[str, tuple[str, str]] = {}
        for _, binding, enabled, _ in screen.active_bindings.values():
            if binding.show and enabled and binding.action not in shown:
                key = binding.key_display or self.app.get_key_display(binding)
                shown[binding.action] = (key, binding.description)
        parts: list[tuple[str, str]] = []
        for key, words in shown.values():
            parts += [(key, "bold $accent"), (f" {words}  ", "$foreground")]
        self.update(Content.assemble(*parts))
