"""The terminal as a device: its keys in order, and its colours."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from textual.app import App
from textual.binding import Binding
from textual.dom import DOMNode
from textual.events import AppBlur, Event, InputEvent, Key, MouseMove, Paste
from textual.theme import Theme
from textual.widgets import Input, TextArea

PATIENCE_S = 5.0
"""Longest wait for the effect of a key, s: more than a recorder may take to answer an order."""
LOCK_OUT_S = 0.3
"""Time between two presses, s, below which a key counts as held: keyboards repeat faster."""
_REPEATING = {"up", "down", "left", "right", "home", "end", "tab", "shift+tab"}
"""Keys that move something: each repetition of a held one counts."""


class KeyboardApp(App[None]):
    """An app whose keys, clicks and pasted texts take effect in the order of their arrival.

    `clock`: monotonic seconds, for held keys.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._last_press: tuple[str, float] = ("", float("-inf"))  # key, and s of the clock
        self._inputs: deque[Event] = deque()  # without effect so far; only the first is delivered
        self._effect: asyncio.Task[None] | None = None
        """The wait for the effect of the first input; stored, because asyncio does not keep it."""

    async def on_event(self, event: Event) -> None:
        """Deliver input once all input before it has had its effect; pass other events on."""
        if isinstance(event, AppBlur):  # a browser may send it between two keys of one text
            return
        is_input = isinstance(event, InputEvent | Paste) and not isinstance(event, MouseMove)
        if not is_input or event.is_forwarded:  # from one widget to another
            await super().on_event(event)
            return
        if not self._inputs or event is not self._inputs[0]:  # it comes for the first time
            self._inputs.append(event)
        if event is self._inputs[0]:  # else it is posted again after the effect of those before
            self._effect = asyncio.create_task(self._await_effect(self._key_path))
            if not self._is_held(event):
                await super().on_event(self._as_bound(event))

    def get_key_display(self, binding: Binding) -> str:
        """Return a key as the manual writes it: Ctrl+Q, Shift+Tab, C."""
        key = super().get_key_display(binding).replace("^", "ctrl+")
        return "+".join(f"{part[:1].upper()}{part[1:]}" for part in key.split("+"))

    def _as_bound(self, event: Event) -> Event:
        """Return an event; a capital letter as the small one, unless a field takes it as text."""
        if not (isinstance(event, Key) and len(event.key) == 1 and event.key.isupper()):
            return event
        if self.focused and self.focused.check_consume_key(event.key, event.character):
            return event
        return Key(event.key.lower(), event.key.lower())

    def _is_held(self, event: Event) -> bool:
        """Return True for the repetition of a key that is held down, where no text is typed."""
        if not isinstance(event, Key) or event.key in _REPEATING:
            return False
        if self.screen_stack and isinstance(self.focused, Input | TextArea):
            return False
        (last_key, last_s), self._last_press = self._last_press, (event.key, self._clock())
        return event.key == last_key and self._last_press[1] - last_s < LOCK_OUT_S

    @property
    def _key_path(self) -> Sequence[DOMNode]:
        """The widget that takes the next key, and those around it up to the app."""
        if not self.screen_stack:
            return (self,)
        return (self.focused or self.screen).ancestors_with_self

    async def _await_effect(self, widgets: Sequence[DOMNode]) -> None:
        """Wait until an input has had its effect on widgets, then deliver the next one.

        While the effect moves the focus, the wait goes on with the widgets around the new one.
        """
        passes = 0
        focused: DOMNode | None = None
        try:
            async with asyncio.timeout(PATIENCE_S):
                # One pass for the key itself, and one for the messages of its action.
                while passes < 2 or widgets[0] is not focused:
                    focused = widgets[0]
                    for widget in widgets:
                        await self._await_queue(widget)
                    passes, widgets = passes + 1, self._key_path
        except TimeoutError:
            self.log.warning("a key has had no effect for too long; the next one is delivered")
        self._inputs.popleft()
        if self._inputs:
            self.post_message(self._inputs[0])

    async def _await_queue(self, widget: DOMNode) -> None:
        """Wait until a widget has processed all messages in its queue, or exists no more."""
        processed = asyncio.Event()
        if not widget.call_later(processed.set):
            return
        while not processed.is_set() and (widget is self or widget.is_attached):
            # Not `wait_for`: on Python 3.11 it drops a cancellation that comes with the result.
            with suppress(TimeoutError):
                async with asyncio.timeout(0.05):  # then look again whether the widget exists
                    await processed.wait()


BENCH_DARK = Theme(
    name="bench-dark", dark=True, text_alpha=1.0,
    primary="#4fb3ff", secondary="#8fd3ff", accent="#ffd54a",
    warning="#ffb000", error="#ff5c5c", success="#3ddc84",
    foreground="#ffffff", background="#000000", surface="#101418", panel="#1c2228",
)  # fmt: skip
BENCH_LIGHT = Theme(
    name="bench-light", dark=False, text_alpha=1.0,
    primary="#004a99", secondary="#003366", accent="#5b2a86",
    warning="#8a4b00", error="#a80000", success="#005c2e",
    foreground="#000000", background="#ffffff", surface="#f4f4f4", panel="#e2e2e2",
)  # fmt: skip
THEMES = (BENCH_DARK, BENCH_LIGHT)
