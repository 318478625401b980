"""The next action in words."""

from __future__ import annotations

from textual.content import Content

from daq import Status
from daq.errors import printable

from ..state.banner import banner
from ..state.feed import Lost
from ..state.next_action import NextAction
from ..state.obstacle import cause_words, obstacle
from ..state.run_words import proposal_words
from ..state.steps import progress
from .words import DrawnWords

_NAMED = 2
"""Largest number of runs that are named; the list of runs names all."""


class NextPanel(DrawnWords):
    """The next bump in words, and what SPACE does."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "Next"

    def show(self, status: Status | None, action: NextAction, lost: Lost | None) -> None:
        """Show the next action; without a recorder, that is to start one."""
        if lost is not None:
            shown = banner(status, lost, action, self._glyphs)
            head = Content.assemble((f"{shown.symbol} {shown.word}", "bold $error"))
            words = Content.assemble((shown.second, "bold $accent"))
            self.say(Content("\n").join([head, Content(shown.first), Content(""), words]))
            return
        lines: list[Content] = []
        if status is None:
            lines = [Content("waiting for the recorder; to start it takes some seconds")]
        elif action.step is not None:
            lines = [Content.assemble((f"{self._glyphs.now} Step {action.step.title}", "bold"))]
        elif (alarm := obstacle(status)) is not None:
            name, advice, details = cause_words(alarm)
            head = Content.assemble((f"{self._glyphs.bad} STOP  {name}", "bold $error"))
            lines = [head, Content(advice), Content(details)]
        elif status.due is not None:
            due = status.due
            title = f"{due.step.mass_state.capitalize()} · {due.step.excitation.words.upper()}"
            count = f"run {min(due.accepted + 1, due.planned)} of {due.planned}"
            if due.accepted >= due.planned:
                count = f"run {due.accepted + 1}, {due.planned} were planned"
            lines = [
                Content.assemble((f"{self._glyphs.now} {title}, {count}", "bold")),
                Content(printable(due.instruction, 300)),
            ]
        else:
            lines = [Content(f"step {progress(status).due.title}")]
        lines += [Content(line) for line in _unlike(status)]
        lines += [Content(""), Content.assemble((action.words, "bold $accent"))]
        self.say(Content("\n").join(lines))


def _unlike(status: Status | None) -> list[str]:
    """Return the runs that differ from the others, in what, and the key that leaves them out."""
    if status is None or not status.proposed:
        return []
    runs = [f"  {run.label}: {printable(run.text, 120)}" for run in status.proposed[:_NAMED]]
    return [proposal_words(status), *runs]
