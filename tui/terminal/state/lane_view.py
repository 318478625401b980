"""Chooses the channels to draw, their labels and units, and the time window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from daq import Channel, Quantity, Status
from daq.channels import AT_CORNER
from daq.control import Phase

from .lanes import Lanes

if TYPE_CHECKING:
    from daq import Bench

SPAN_S = 6.0
_HELD = (Phase.TRIGGERED, Phase.DECAY, Phase.ACCEPTED, Phase.REJECTED)
_LEAST = {"m/s2": 0.5, "rad/s": 0.05, "rad/s2": 0.5, "m": 0.002}
_SHOWN = {"m": ("mm", 1e3)}
_SHORT = {
    Quantity.BODY_ACCELERATION: "body",
    Quantity.BODY_DISPLACEMENT: "body",
    Quantity.HUB_ACCELERATION: "wheel",
    Quantity.HUB_DISPLACEMENT: "wheel",
    Quantity.SUSPENSION_TRAVEL: "travel",
    Quantity.PITCH_RATE: "pitch",
    Quantity.ROLL_RATE: "roll",
    Quantity.PITCH_ACCELERATION: "pitch",
    Quantity.ROLL_ACCELERATION: "roll",
}


@dataclass(frozen=True, slots=True)
class LaneSpec:
    """One lane."""

    channel: str
    """Its name in the recording."""
    label: str
    """Short words on the left."""
    unit: str
    """Unit as shown."""
    factor: float
    """Factor from SI to the shown unit."""
    least: float
    """Smallest range, in the shown unit."""
    scale: str
    """Lanes with the same word share one scale: those of one quantity at the wheels."""


@dataclass(frozen=True, slots=True)
class Window:
    """Bins first_bin .. first_bin + count; `trigger` is the share of the width where the bump is.

    None if it is not in view.
    """

    first_bin: int
    count: int
    trigger: float | None


def lane_specs(bench: Bench | None, lanes: Lanes, page: int, room: int) -> list[LaneSpec]:
    """Return the lanes to draw: those of the body, then of each quantity at the wheels.

    `bench`: None while it is not known: then the channels are drawn as the recorder sends them.
    `page`: number of the first group to show, modulo their number; further groups follow if they
    fit completely.  `room`: largest number of lanes.
    """
    if bench is None:
        return [LaneSpec(name, name[:10], "", 1.0, 0.5, name) for name in lanes.channels[:room]]
    used = [c for c in bench.channels if c.quantity is not Quantity.UNUSED]
    groups: dict[str, list[Channel]] = {}
    for channel in sorted(used, key=lambda c: c.quantity in AT_CORNER):
        at_corner = channel.quantity in AT_CORNER
        groups.setdefault(channel.quantity if at_corner else "body", []).append(channel)
    pages = list(groups.values())
    shift = page % max(1, len(pages))
    chosen: list[Channel] = []
    for group in pages[shift:] + pages[:shift]:
        if not chosen or len(chosen) + len(group) <= room:
            chosen += group[:room]
    return [_spec(channel, chosen) for channel in chosen]


def _spec(channel: Channel, chosen: list[Channel]) -> LaneSpec:
    unit, factor = _SHOWN.get(channel.unit, (channel.unit, 1.0))
    words = _SHORT.get(channel.quantity, "")
    place = f"{words} {channel.corner}" if channel.corner else words
    same = [c for c in chosen if (c.quantity, c.corner) == (channel.quantity, channel.corner)]
    label = place if len(same) == 1 and place else channel.name
    least = _LEAST[channel.unit] * factor
    scale = str(channel.quantity) if channel.corner else channel.name
    return LaneSpec(channel.name, label[:10], unit, factor, least, scale)


def window(status: Status | None, lanes: Lanes, span_s: float = SPAN_S) -> Window:
    """Return the window to draw: the run around its bump if there is one, else the last seconds."""
    bin_s = lanes.bin_s or 0.02
    count = round(span_s / bin_s)
    if status is None or not status.bump_ns:
        return Window(lanes.end - count, count, None)
    bump = int(status.bump_ns * 1e-9 / bin_s)
    first = lanes.end - count
    if status.phase in _HELD:
        first = max(bump - round(1.0 / bin_s), lanes.end - count)
    share = (bump - first) / count
    return Window(first, count, share if 0.0 <= share < 1.0 else None)
