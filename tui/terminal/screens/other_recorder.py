"""Asks before a terminal is attached to a recorder with another setup than requested."""

from __future__ import annotations

from typing import cast

from textual.app import App

from daq.control import Setup, ShutDown, Stop, differences
from daq.errors import printable

from ..context import BenchContext
from .dialogs import ChoiceScreen

ATTACH, REPLACE, END = "attach", "replace", "end"


class OtherRecorder:
    """Compares the running recorder to the wanted one, once for each terminal.

    `wanted`: None if the terminal accepts any setup.  `asking`: True while the operator has not
    answered; no other screen opens before.
    """

    def __init__(self, app: App[None], wanted: Setup | None) -> None:
        self._app, self._wanted = app, wanted
        self._bench_app = cast("BenchContext", app)
        self.asking = False

    def compare(self, running: Setup, in_control: bool) -> None:
        """Ask if the running recorder has another setup."""
        if self.asking or self._wanted is None:
            return
        if not (texts := differences(running, self._wanted)):
            return
        self.asking = True
        options = [(ATTACH, "attach to it: it goes on as it is")]
        if in_control:
            options += [
                (REPLACE, "end its recording, and begin a new one as asked for"),
                (END, "end its recording and the recorder"),
            ]
        title = f"Another recorder runs here: {'; '.join(texts)}."
        self._app.push_screen(ChoiceScreen(printable(title, 400), options), self._settle)

    async def _settle(self, choice: str | None) -> None:
        """Carry out the answer; without one nothing is changed and the terminal ends."""
        if choice in (REPLACE, END):
            await self._bench_app.ask(Stop())  # refused if nothing is being recorded
            if await self._bench_app.ask(ShutDown()) is None:
                self.asking = False  # the reason is shown, and the question is asked again
                return
        if choice in (ATTACH, REPLACE):
            self._wanted, self.asking = None, False
        if choice == REPLACE:
            await self._bench_app.action_restart_recorder()
        elif choice != ATTACH:
            self._app.exit()
