"""Judges the guided push test: a push on one corner of the car proves places and signs of sensors.

A push on a corner presses its suspension together (travel first positive), sinks the body there
(displacement first negative), and turns it: nose down at the front (pitch rate first positive), the
pushed side down (positive roll lifts the left side, so first negative on the left).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..channels import Channel, Quantity
from ..vehicle import Corner

ORDER = (Corner.FRONT_LEFT, Corner.FRONT_RIGHT, Corner.REAR_LEFT, Corner.REAR_RIGHT)
"""The order in which the corners are pushed."""
_LEAST = {
    Quantity.SUSPENSION_TRAVEL: 3e-3,
    Quantity.BODY_DISPLACEMENT: 3e-3,
    Quantity.PITCH_RATE: 0.01,
    Quantity.ROLL_RATE: 0.01,
}
"""Least deviation that counts as a push by hand, SI.  Accelerations are not used: in them the swing
back is stronger than the push, and gravity has already proved their signs."""
_OVER_NOISE = 6.0
_FIRST_SHARE = 0.4
"""Share of the peak from which the first excursion counts: clearly more than noise, and reached
before the swing back."""
_SETTLED_S = 0.6
"""Time without motion after which a push is over, s."""
_LONGEST_S = 5.0
_SURE = 0.4
"""Sinking of a point, as a share of that of the body's middle, from which it surely sinks."""

Envelope = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lowest and highest value of a channel in each bin, (n,) each."""


@dataclass(frozen=True, slots=True)
class PushResult:
    """The result of a push on one corner."""

    corner: Corner
    """The corner that should be pushed."""
    done: bool
    """True once the push is over."""
    passed: bool
    """True if every channel that moved did so in the right direction."""
    text: str
    """The observation, in words."""
    advice: str = ""
    """The next step for the operator; empty if everything is right."""
    inverted: tuple[str, ...] = ()
    """Channels that moved in the wrong direction."""


class _Move(NamedTuple):
    """The motion of a channel: its largest deviation, and its first direction."""

    channel: Channel
    size: float
    first: int


def spoken(corner: Corner) -> str:
    """Return the name of a corner for a person at the car."""
    return f"{'front' if corner.front else 'rear'} {'LEFT' if corner.side > 0 else 'RIGHT'}"


def shows_push(channels: Sequence[Channel]) -> bool:
    """Return whether any channel of a bench shows a push by hand."""
    return any(channel.quantity in _LEAST for channel in channels)


def judge_push(
    corner: Corner,
    channels: Sequence[Channel],
    lanes: Mapping[str, Envelope],
    begin: int,
    bin_s: float,
) -> PushResult:
    """Judge the push on one corner from the data so far.

    `lanes`: the last seconds as an envelope, NaN where there is no sample; all have the same bins,
    and most bins are at rest.  `begin`: the first bin that counts: before it another corner may
    have been pushed; a motion that goes on there does not count either.  `bin_s`: width of a bin,
    s.
    """
    deviations = {
        c: deviation
        for c in channels
        if c.quantity in _LEAST and (deviation := _deviation(c, lanes.get(c.name))) is not None
    }
    asked = PushResult(corner, False, False, f"push DOWN at the {spoken(corner)}, let go")
    moving = PushResult(corner, False, False, "moving: let it come to rest")
    if not deviations:
        return asked
    loud = np.any([np.abs(away) >= least for away, least in deviations.values()], axis=0)
    settling = round(_SETTLED_S / bin_s)
    # Begin after a motion that was there before: its first direction is not seen.
    for number in np.flatnonzero(loud).tolist():
        if begin - settling <= number < begin:
            begin = min(number + settling + 1, len(loud))
    moves = []
    for channel, (away, least) in deviations.items():
        size = np.abs(away[begin:])
        peak = float(np.max(size, initial=0.0))
        if peak >= least:
            first = away[begin + int(np.argmax(size >= _FIRST_SHARE * peak))]
            moves.append(_Move(channel, peak, int(np.sign(first))))
    if not moves:
        return moving if begin == len(loud) and loud.any() else asked
    first_loud, last_loud = begin + np.flatnonzero(loud[begin:])[[0, -1]]
    moving_s, quiet_s = (len(loud) - 1 - first_loud) * bin_s, (len(loud) - 1 - last_loud) * bin_s
    if quiet_s < _SETTLED_S and moving_s < _LONGEST_S:
        return moving
    return _judged(corner, moves, channels)


def _deviation(channel: Channel, lane: Envelope | None) -> tuple[NDArray[np.float64], float] | None:
    """Return the deviation of a channel from rest, and the limit for a movement."""
    if lane is None:
        return None
    middle = (lane[0] + lane[1]) / 2.0
    known = middle[np.isfinite(middle)]
    if not len(known):
        return None
    level = float(np.median(known))
    # A push does not change a median; 1.48 makes a standard deviation of normal noise from it.
    noise = 1.48 * float(np.median(np.abs(known - level)))
    return np.nan_to_num(middle - level), max(_LEAST[channel.quantity], _OVER_NOISE * noise)


def _judged(corner: Corner, moves: Sequence[_Move], channels: Sequence[Channel]) -> PushResult:
    travels = [m for m in moves if m.channel.quantity is Quantity.SUSPENSION_TRAVEL]
    most = max(travels, key=lambda m: m.size, default=None)
    due = next(
        (c for c in channels if c.quantity is Quantity.SUSPENSION_TRAVEL and c.corner is corner),
        None,
    )
    if due is not None and most is None:
        text, advice = f"{due.name} did not move", "check its plug and its rod, then push again"
        return PushResult(corner, True, False, text, advice)
    if due is not None and most is not None and most.channel.corner is not corner:
        return _elsewhere(corner, due, most.channel, moves)
    wrong = [m.channel.name for m in moves if _expected(corner, m.channel) == -m.first]
    if wrong:
        text = f"{', '.join(wrong)} moved the wrong way"
        advice = f"I inverts the sign of {wrong[0]}"
        return PushResult(corner, True, False, text, advice, tuple(wrong))
    shown = most or moves[0]
    size = f"{shown.first * shown.size:+.2g} {shown.channel.unit}"
    if shown.channel.unit == "m":
        size = f"{shown.first * shown.size * 1e3:+.0f} mm"
    return PushResult(corner, True, True, f"{shown.channel.name} moved {size}, sign right")


def _elsewhere(corner: Corner, due: Channel, moved: Channel, moves: Sequence[_Move]) -> PushResult:
    """Distinguish a swapped plug from a push on another corner, if the gyroscopes show it."""
    pitch = next((m.first for m in moves if m.channel.quantity is Quantity.PITCH_RATE), 0)
    roll = next((m.first for m in moves if m.channel.quantity is Quantity.ROLL_RATE), 0)
    # The corner that the car tilted towards.
    lowest = next((c for c in Corner if (c.front, c.side) == (pitch > 0, -roll)), None)
    text = f"{moved.corner} moved"
    if pitch and roll and lowest is moved.corner:
        text += f", and the car tilted that way: the {spoken(corner)} was not pushed"
        return PushResult(corner, True, False, text, f"push the {spoken(corner)}")
    text += f": {due.name} and {moved.name} are swapped"
    advice = "swap their plugs, or their signals in bench.toml"
    if not (pitch and roll):
        advice += f"; or another corner was pushed: press R and push the {spoken(corner)}"
    return PushResult(corner, True, False, text, advice)


def _expected(corner: Corner, channel: Channel) -> int | None:
    """Return the expected first direction of a channel, +1 or -1; None if it is not certain."""
    match channel.quantity:
        case Quantity.SUSPENSION_TRAVEL:
            return 1 if channel.corner is corner else None
        case Quantity.PITCH_RATE:
            return 1 if corner.front else -1
        case Quantity.ROLL_RATE:
            return -corner.side
    # A plate on four equal springs that is pushed at (u', v') sinks by 1 + u u' + v v' at (u, v),
    # in half lengths from its middle; those of a usual car are used.
    u, v = 1.0 + channel.x_m / 1.4, channel.y_m / 0.75  # x counts from the front axle
    sinks = 1.0 + u * (1 if corner.front else -1) + v * corner.side > _SURE
    return -1 if channel.at_cg or sinks else None
