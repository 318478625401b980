"""Builds the lines of the check screen from the recorder's answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from daq import Channel, Corner, Quantity, Status
from daq.check import ORDER, PushResult, spoken
from daq.control import BusState, CheckItem

OK, WARN, FAIL, NOW, WAIT = "OK", "WARN", "FAIL", "NOW", "wait"
TARED = (Quantity.SUSPENSION_TRAVEL, Quantity.PITCH_RATE, Quantity.ROLL_RATE)
"""Quantities that are zero at rest; not accelerations, for which a tare would hide gravity."""
_SMALL = {"m": 0.5e-3, "rad/s": 1e-3}
"""Largest offset that counts as zero, by unit: below what a tare can improve."""
_LITTLE_BYTES, _LEAST_BYTES = 5e9, 0.5e9
_HEAVY_LOAD = 0.8


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One line: state in a word, subject, result and advice."""

    state: str
    subject: str
    text: str
    advice: str = ""
    overridden: bool = False

    @property
    def blocks(self) -> bool:
        """True if it keeps a campaign from beginning."""
        return self.state == FAIL and not self.overridden

    @property
    def asks(self) -> bool:
        """True if the operator must override it."""
        return self.state == WARN and not self.overridden


@dataclass(frozen=True, slots=True)
class ZeroOffset:
    """A channel with an offset at rest, and the tare that removes it, SI."""

    channel: str
    level: float
    unit: str
    tare: float

    @property
    def text(self) -> str:
        """Channel and offset in words."""
        if self.unit == "m":
            return f"{self.channel} {self.level * 1e3:+.1f} mm"
        return f"{self.channel} {self.level:+.4f} {self.unit}"


def recorder_rows(status: Status) -> tuple[CheckRow, ...]:
    """Return the lines on buses, disk and clock."""
    rows = []
    for bus in status.buses:
        text = f"load {bus.load:.0%}, {bus.frames_per_s:.0f} frames/s, error frames"
        text += f" {bus.error_frames}"
        if bus.tx_errors is not None:
            text += f", TEC {bus.tx_errors}, REC {bus.rx_errors}"
        state, advice = OK, ""
        if bus.state is not BusState.OK:
            state, text = FAIL, f"{bus.state.value}: {text}"
            advice = "check power, plugs, termination and bit rate"
        elif bus.error_frames or bus.load > _HEAVY_LOAD:
            state, advice = WARN, "check termination (60 ohm) and plugs, or lower the rates"
        rows.append(CheckRow(state, f"bus {bus.name}", text, advice))
    free = status.disk.free_bytes
    state = FAIL if status.disk.failed or free < _LEAST_BYTES else OK
    state = WARN if state == OK and free < _LITTLE_BYTES else state
    text = status.disk.failed or f"{free / 1e9:.1f} GB free, {status.disk.lag_s:.1f} s behind"
    rows.append(CheckRow(state, "disk", text, "" if state == OK else "make room, or a new disk"))
    steps = [alarm for alarm in status.alarms if alarm.code == "clock_step"]
    text = steps[0].text if steps else "runs evenly"
    advice = steps[0].advice if steps else ""
    rows.append(CheckRow(WARN if steps else OK, "clock", text, advice))
    return tuple(rows)


def item_rows(items: Sequence[CheckItem]) -> tuple[CheckRow, ...]:
    """Return the lines of the bench check; an item with several findings has several lines."""
    return tuple(CheckRow(item.verdict, item.subject, item.reason, item.advice) for item in items)


def push_rows(
    results: Mapping[Corner, PushResult], active: str, skipped: Mapping[str, str], possible: bool
) -> tuple[CheckRow, ...]:
    """Return the lines of the guided push test, by corner.

    `results`: result of the last push on each corner.  `active`: the corner that is to be pushed
    now; empty if none.  `skipped`: reason why a corner was left out.  `possible`: True if a sensor
    of the bench can distinguish corners.
    """
    if not possible:
        text = "no sensor of this bench can distinguish the corners"
        return (CheckRow(OK, "push", text),)
    rows = []
    for corner in ORDER:
        subject, seen = push_subject(corner), results.get(corner)
        if subject in skipped:
            rows.append(CheckRow(WARN, subject, f"skipped: {skipped[subject]}", "", True))
        elif corner == active:
            text = seen.text if seen else f"push DOWN at the {spoken(corner)}, let go"
            advice = "one firm push; S skips it, with a reason"
            rows.append(CheckRow(NOW, subject, text, advice))
        elif seen is None:
            rows.append(CheckRow(WAIT, subject, spoken(corner)))
        else:
            state = OK if seen.passed else FAIL
            rows.append(CheckRow(state, subject, seen.text, seen.advice))
    return tuple(rows)


def push_subject(corner: str) -> str:
    """Return the subject of the line on a corner."""
    return f"push {corner}"


def rest_levels(items: Sequence[CheckItem]) -> dict[str, float]:
    """Return the level of each channel at rest, SI, by its name."""
    return {
        item.subject.removeprefix("channel "): item.figures["level"]
        for item in items
        if item.subject.startswith("channel ") and "level" in item.figures
    }


def zero_offsets(items: Sequence[CheckItem], channels: Sequence[Channel]) -> tuple[ZeroOffset, ...]:
    """Return the channels that should read zero at rest but do not."""
    levels = rest_levels(items)
    return tuple(
        ZeroOffset(c.name, levels[c.name], c.unit, round(c.tare + levels[c.name], 7))
        for c in channels
        if c.quantity in TARED and abs(levels.get(c.name, 0.0)) > _SMALL[c.unit]
    )


def with_overrides(rows: Sequence[CheckRow], overridden: Mapping[str, str]) -> list[CheckRow]:
    """Return the lines with overridden warnings marked."""
    return [
        CheckRow(row.state, row.subject, row.text, f"overridden: {overridden[row.subject]}", True)
        if row.state == WARN and row.subject in overridden
        else row
        for row in rows
    ]
