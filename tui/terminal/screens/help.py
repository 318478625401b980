"""Help over a screen: one page a screen, a reason to reject a run, or an alarm; and its keys.

The pages of screens are Markdown files; the others come from the recorder's own tables
(`daq.verdict.WORDS`, `daq.alarms.EXPLAINED`), so that they cannot differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from types import MappingProxyType
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.dom import DOMNode
from textual.screen import ModalScreen, Screen
from textual.widgets import Markdown, Static

from daq.alarms import EXPLAINED
from daq.verdict import WORDS

from ..context import RecorderLost

SCREEN_PAGES = (
    "vehicle", "check", "home", "run", "masses", "identify", "results", "report", "sessions",
    "note",
)  # fmt: skip
_NONE = "# Help\n\nThere is no page for this. F1 on another screen shows its help.\n"


def page_of(name: str) -> str:
    """Return a page as Markdown.

    `name`: a screen, or the code of a finding (the reason of a rejected run) or of an alarm.
    """
    if name in SCREEN_PAGES:
        return (files("tui.terminal") / "help" / f"{name}.md").read_text("utf-8")
    pages = []
    if name in WORDS:
        words = WORDS[name]
        kept = "\nNothing is lost: a rejected run is kept and can be taken back.\n"
        title = f"Rejected: {words.title}"
        pages.append(_explained(title, words.meaning, words.advice, SKETCHES.get(name, "")) + kept)
    if name in EXPLAINED:
        alarm = EXPLAINED[name]
        pages.append(_explained(f"Alarm: {alarm.title}", alarm.meaning, alarm.advice, ""))
    return "\n".join(pages) or _NONE


def _explained(title: str, meaning: str, advice: str, sketch: str) -> str:
    drawn = f"\n```{sketch}```\n" if sketch else ""
    return f"# {title}\n\n{_sentence(meaning)}\n{drawn}\n**What to do:** {_sentence(advice)}\n"


def _sentence(text: str) -> str:
    text = text.strip()
    text = f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith((".", "!", "?")) else f"{text}."


SKETCHES: Mapping[str, str] = MappingProxyType(
    {
        "double_bump": r"""
   good                       bumped twice
    /\                         /\      /\
   /  \    /\                 /  \    /  \   /\
--'    \  /  `-----        --'    `--'    `-'  `---
        \/                          ^ second bump
""",
        "too_weak": r"""
   good                       too weak
    /\
   /  \    /\
--'    \  /  `-----        --.-'`.-.-'`-.-.-------
        \/                    lost in the noise
""",
        "not_at_rest": r"""
   good                       not at rest before
    /\                              /\
   /  \    /\                 /\   /  \    /\
--'    \  /  `-----        \_/  `-'    \  /  `----
        \/                  ^ still moves \/
""",
        "not_decayed": r"""
   good                       not decayed
    /\                         /\    /\    /\    /
   /  \    /\                 /  \  /  \  /  \  /
--'    \  /  `-----        --'    \/    \/    \/  |
        \/                                  the end
""",
        "overload": r"""
   good                       overload
    /\                        ____  <- end of the range
   /  \    /\                 /  \    /\
--'    \  /  `-----        --'    \__/  `-----
        \/
""",
        "wrong_mode": r"""
   bounce            pitch             roll
   all four wheels   front axle        left side
   [=]     [=]       [=]     [ ]       [=]     [=]  left
   [=]     [=]       [=]     [ ]       [ ]     [ ]  right
  front   rear      front   rear      front   rear
""",
        "lost_frames": r"""
   sent       1 2 3 4 5 6 7 8 9
   recorded   1 2 3     6 7 8 9
                    ^ ^ lost: gap in the counter
""",
        "frozen": r"""
   wheel FL   .-'`-.-'`-.-'`-.
   wheel RR   .-'--------------    <- one value from here on
""",
        "stale": r"""
   wheel FL   .-'`-.-'`-.-'`-.
   wheel RR   .-'`-.               <- silent from here on
""",
    }
)


_COMMON = ("app.focus_next", "app.focus_previous", "screen.copy_text")


def _is_common(node: DOMNode, binding: Binding) -> bool:
    """Return True for a key of every list and every field: the screen's own come first."""
    return not isinstance(node, Screen | App) or binding.action in _COMMON


class HelpScreen(ModalScreen[None]):
    """One page; Esc, SPACE or F1 closes it.

    `page`: as `page_of`.
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
