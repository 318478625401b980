"""The line that is always there: who and what, and how the recorder is doing."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from textual.content import Content
from textual.widgets import Static

from daq.errors import printable
from daq.messages import BusState, Status

from ..glyphs import Glyphs

if TYPE_CHECKING:
    from ..app import BenchApp

_WIDE = 120


class TopLine(Static):
    """Vehicle, day, operator; bus, losses, sensors, disk; the overload lamp."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__(markup=False)
        self._glyphs = glyphs

    def show(self, status: Status | None, app: BenchApp) -> None:
        """Show a status, or that there is none."""
        wide = self.size.width >= _WIDE
        if app.lost is not None:
            self.update(Content.assemble((f" RECORDER LOST  {app.lost.text}", "bold reverse")))
            return
        if status is None:
            self.update(Content(" BUMP  waiting for the recorder"))
            return
        day = datetime.fromtimestamp(status.wall_ns * 1e-9, UTC).astimezone().date().isoformat()
        left = f" BUMP  {printable(status.vehicle, 24)} · {day} · op. {printable(app.operator, 12)}"
        if not app.in_control:
            left += " (VIEWER)"
        right: list[tuple[str, str] | str] = []
        for bus in status.buses:
            good = bus.state is BusState.OK
            mark = self._glyphs.bus if good else self._glyphs.bad
            word = f"{bus.load:.0%}" if good else bus.state.value.upper()
            style = "$success" if good else "bold reverse $error"
            right += [(f"{printable(bus.name, 12)} {mark} {word}  ", style)]
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
        room = max(8, self.size.width - tail.cell_length - len(gap))
        head = Content(left[:room].ljust(room) if wide else left[:room])
        self.update(head + Content(gap) + tail)
