"""Shows help over a screen: its purpose and its keys."""

from __future__ import annotations

from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.dom import DOMNode
from textual.screen import ModalScreen, Screen
from textual.widgets import Markdown, Static

from ..state.help_pages import page_of
from .news import RecorderLost

_COMMON = ("app.focus_next", "app.focus_previous", "screen.copy_text")


def _is_common(node: DOMNode, binding: Binding) -> bool:
    """Return True for a key of every list and every field: the screen's own come first."""
    return not isinstance(node, Screen | App) or binding.action in _COMMON


class HelpScreen(ModalScreen[None]):
    """One page; Esc, SPACE or F1 closes it.

    `page`: as `tui.terminal.state.help_pages.page_of`.
    """

    DEFAULT_CSS = """
    HelpScreen { align: center middle; }
    HelpScreen > Vertical { width: 90; max-width: 100%; height: 94%;
        border: solid $primary; background: $surface; }
    HelpScreen VerticalScroll { height: 1fr; }
    HelpScreen #keys { height: auto; padding: 0 2 1 2; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,space,enter,q", "dismiss", "Close")]

    def __init__(self, page: str) -> None:
        super().__init__()
        self._page = page

    def compose(self) -> ComposeResult:
        """Compose page and keys."""
        with Vertical() as box:
            box.border_title = "Help"
            box.border_subtitle = "Esc closes, arrows scroll"
            with VerticalScroll(can_focus=True):
                yield Markdown(page_of(self._page), open_links=False)
                yield Static("\n".join(self._keys()), id="keys", markup=False)

    def on_recorder_lost(self, _: RecorderLost) -> None:
        """Close, because the screen below shows what to do."""
        self.dismiss()

    def _keys(self) -> list[str]:
        """Return the keys of the screen below, hidden ones included, with their actions."""
        stack = self.app.screen_stack
        below: Screen[object] = stack[-2] if stack[-1] is self else stack[-1]
        actions: dict[str, str] = {}
        found = below.active_bindings.values()
        for _, binding, enabled, _ in sorted(found, key=lambda key: _is_common(key[0], key[1])):
            words = binding.tooltip or binding.description
            if enabled and words and words not in actions.values():
                actions[self.app.get_key_display(binding)] = words
        lines = ["Keys of this screen", ""]
        lines += [f"  {key:<12} {words}" for key, words in actions.items()]
        return lines
