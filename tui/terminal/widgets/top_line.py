"""The line that is always there: who and what, and how the recorder is doing."""

from __future__ import annotations

from datetime import UTC, datetime

from textual.content import Content

from daq import Status
from daq.control import BusState
from daq.errors import printable

from ..context import BenchContext
from ..state.glyphs import Glyphs
from .words import Words

_WIDE = 120


class TopLine(Words):
    """Vehicle, day, operator; bus, losses, sensors, disk; the overload lamp."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs

    def show(self, status: Status | None, app: BenchContext) -> None:
        """Show a status, or that there is none."""
        width = self.size.width or self.app.size.width  # on a screen that has just come
        wide = width >= _WIDE
        if app.lost is not None:
            self.say(
                Content.assemble((f" RECORDER LOST  {printable(app.lost.text)}", "bold reverse"))
            )
            return
        if status is None:
            self.say(Content(" BUMP  waiting for the recorder"))
            return
        day = datetime.fromtimestamp(status.wall_ns * 1e-9, UTC).astimezone().date().isoformat()
        vehicle, who = printable(status.vehicle, 24), f"op. {printable(app.operator, 12)}"
        if not app.in_control:
            who = "VIEWER"
        lefts = [f" BUMP  {vehicle} · {day} · {who}", f" {vehicle} · {day} · {who}"]
        lefts += [f" {vehicle} · {who}"]
        right: list[tuple[str, str] | str] = []
        for bus in status.buses:
            good = bus.state is BusState.OK
            mark = self._glyphs.bus if good else self._glyphs.bad
            word = f"{bus.load:.0%}" if good else bus.state.value.upper()
            style = "$success" if good else "bold reverse $error"
            right += [(f"{printable(bus.name, 16 if wide else 8)} {mark} {word}  ", style)]
        alive = f"{status.sensors_alive}/{status.sensors_expected} alive"
        lacking = status.sensors_alive < status.sensors_expected
        right += [(f"{alive}  ", "bold reverse $error" if lacking else "")]
        lost = status.losses.measured
        if wide or lost:
            right += [(f"lost {lost}  ", "bold $warning" if lost else "")]
        right += [f"disk {status.disk.free_bytes / 1e9:.0f} GB"]
        if status.overloaded:
            names = printable(", ".join(status.overloaded), 24)
            right = [(f"{self._glyphs.overload} OVERLOAD {names}  ", "bold reverse $error"), *right]
        gap = " │ "
        tail = Content.assemble(*right)
        room = max(8, width - tail.cell_length - len(gap))
        left = next(
            (c for words in lefts if (c := Content(words)).cell_length <= room), Content(lefts[-1])
        )
        head = left.truncate(room, pad=True)
        self.say(head + Content(gap) + tail)
