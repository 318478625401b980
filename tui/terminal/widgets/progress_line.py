"""Progress in one line, for terminals without room for lists."""

from __future__ import annotations

from textual.content import Content

from daq import Status
from daq.errors import printable

from .words import DrawnWords


class ProgressLine(DrawnWords):
    """`bounce ■■▶··  pitch ·····   1 rejected │ no overload`."""

    def show(self, status: Status) -> None:
        """Show the tallies of the mass state that is due."""
        glyphs = self._glyphs
        due = status.due.step if status.due else None
        states = [tally.mass_state for tally in status.tallies]
        state = due.mass_state if due else (states[-1] if states else "")
        parts = []
        rejected = 0
        for tally in status.tallies:
            if tally.mass_state != state:
                continue
            rejected += tally.rejected
            here = due is not None and due.excitation is tally.excitation
            bar = glyphs.bar(tally.accepted, tally.planned, glyphs.now if here else "")
            parts.append(f"{tally.excitation.words} {bar}")
        lamps = printable(", ".join(status.overloaded), 30)
        lamp = f"{glyphs.overload} OVERLOAD {lamps}" if lamps else "no overload"
        bars, end = "  ".join(parts), f"{glyphs.axis} {lamp}"
        words = f" {state}: {bars}   {rejected} rejected {end}"
        if len(words) > self.size.width > 0:
            words = f" {bars}  {rejected} rej. {end}"
        self.say(Content(words))
