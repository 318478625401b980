"""Judges the guided push test: a push on one corner of the car proves places and signs of sensors.

A push on a corner presses its suspension together (travel first positive), sinks the body there
(displacement first negative), and turns it: nose down at the front (pitch rate first positive), the
pushed side down (positive roll lifts the left side, so first negative on the left).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..channels import Channel, Quantity
from ..vehicle import Corner

ORDER = (Corner.FRONT_LEFT, Corner.FRONT_RIGHT, Corner.REAR_LEFT, Corner.REAR_RIGHT)
"""The order in which the corners are pushed."""
_WORDS = {
    Corner.FRONT_LEFT: "front LEFT",
    Corner.FRONT_RIGHT: "front RIGHT",
    Corner.REAR_LEFT: "rear LEFT",
    Corner.REAR_RIGHT: "rear RIGHT",
}

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
_LONGEST_S = 5.0
_SURE = 0.4

Envelope = tuple[NDArray[np.float64], NDArray[np.float64]]


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


@dataclass(frozen=True, slots=True)
class _Move:
    """The motion of a channel: its largest deviation, and its first direction."""

    channel: Channel
    size: float
    first: int


def spoken(corner: Corner) -> str:
    """Return the name of a corner for a person at the car."""
    return _WORDS[corner]


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
    asked = PushResult(corner, False, False, f"push DOWN at the {spoken(corner)}, let go")
    deviations = {
        c: found
        for c in channels
        if c.quantity in _LEAST and (found := _deviation(c, lanes.get(c.name))) is not None
    }
    if not deviations:
        return asked
    loud = np.any([np.abs(away) >= least for away, least in deviations.values()], axis=0)
    begin = _at_rest(loud, begin, round(_SETTLED_S / bin_s))
    moves = [
        _move(c, away[begin:])
        for c, (away, least) in deviations.items()
        if _peak(away[begin:]) >= least
    ]
    if begin == len(loud) and loud.any():
        return PushResult(corner, False, False, "moving: let it come to rest")
    if not moves:
        return asked
    if not _over(loud[begin:], bin_s):
        return PushResult(corner, False, False, "moving: let it come to rest")
    return _judged(corner, moves, channels)


def _deviation(channel: Channel, lane: Envelope | None) -> tuple[NDArray[np.float64], float] | None:
    """Return the deviation of a channel from rest, and the limit for a movement."""
    if lane is None or not len(lane[0]):
        return None
    low, high = lane
    middle = (low + high) / 2.0
    seen = middle[np.isfinite(middle)]
    if not len(seen):
        return None
    rest = float(np.median(seen))
    noise = 1.48 * float(np.median(np.abs(seen - rest)))  # a push does not change a median
    return np.nan_to_num(middle - rest), max(_LEAST[channel.quantity], _OVER_NOISE * noise)


def _at_rest(loud: NDArray[np.bool_], begin: int, quiet: int) -> int:
    """Return the first bin from `begin` before which nothing has moved for `quiet` bins.

    A motion that began earlier does not count: its first direction was not seen.
    """
    for moved in np.flatnonzero(loud).tolist():
        if begin - quiet <= moved < begin:
            begin = min(moved + quiet + 1, len(loud))
    return begin


def _peak(deviation: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(deviation), initial=0.0))


def _move(channel: Channel, deviation: NDArray[np.float64]) -> _Move:
    peak = _peak(deviation)
    first = int(np.argmax(np.abs(deviation) >= _FIRST_SHARE * peak))
    return _Move(channel, peak, int(np.sign(deviation[first])))


def _over(loud: NDArray[np.bool_], bin_s: float) -> bool:
    """Return whether all channels are at rest again, or have moved for too long to wait."""
    begun_s, quiet_s = (len(loud) - 1 - np.flatnonzero(loud)[[0, -1]]) * bin_s
    return bool(quiet_s >= _SETTLED_S or begun_s >= _LONGEST_S)


def _judged(corner: Corner, moves: Sequence[_Move], channels: Sequence[Channel]) -> PushResult:
    travels = [m for m in moves if m.channel.quantity is Quantity.SUSPENSION_TRAVEL]
    own = next(
        (c for c in channels
         if c.quantity is Quantity.SUSPENSION_TRAVEL and c.corner is corner), None
    )  # fmt: skip
    most = max(travels, key=lambda m: m.size, default=None)
    if own is not None:
        if most is None:
            text, advice = f"{own.name} did not move", "check its plug and its rod, then push again"
            return PushResult(corner, True, False, text, advice)
        if most.channel.corner is not corner:
            return _elsewhere(corner, own, most, moves)
    wrong = [m for m in moves if (way := _expected(corner, m.channel)) and way != m.first]
    seen = most or moves[0]
    sizes = f"{seen.channel.name} moved {_spoken_size(seen)}"
    if wrong:
        names = tuple(m.channel.name for m in wrong)
        text = f"{', '.join(names)} moved the wrong way"
        return PushResult(corner, True, False, text, f"I inverts the sign of {names[0]}", names)
    return PushResult(corner, True, True, f"{sizes}, sign right")


def _elsewhere(corner: Corner, own: Channel, most: _Move, moves: Sequence[_Move]) -> PushResult:
    """Distinguish a swapped plug from a push on another corner, if the gyroscopes show it."""
    assert most.channel.corner is not None  # ensured by Channel: a travel has a corner
    pushed = _corner_of_turn(moves)
    text = f"{most.channel.corner} moved"
    if pushed is most.channel.corner:
        text += f", and the car tilted that way: the {spoken(corner)} was not pushed"
        return PushResult(corner, True, False, text, f"push the {spoken(corner)}")
    text += f": {own.name} and {most.channel.name} are swapped"
    advice = "swap their plugs, or their signals in bench.toml"
    if pushed is None:
        advice += f"; or another corner was pushed: press R and push the {spoken(corner)}"
    return PushResult(corner, True, False, text, advice)


def _corner_of_turn(moves: Sequence[_Move]) -> Corner | None:
    """Return the corner that went down, from pitch and roll; None if either did not move."""
    pitch = next((m.first for m in moves if m.channel.quantity is Quantity.PITCH_RATE), 0)
    roll = next((m.first for m in moves if m.channel.quantity is Quantity.ROLL_RATE), 0)
    if not (pitch and roll):
        return None
    return next(c for c in Corner if (c.front, c.side) == (pitch > 0, -roll))


def _expected(corner: Corner, channel: Channel) -> int:
    """Return the expected first direction of a channel, +1 or -1; 0 if it is not certain."""
    quantity = channel.quantity
    if quantity is Quantity.SUSPENSION_TRAVEL:
        return 1 if channel.corner is corner else 0
    if quantity is Quantity.PITCH_RATE:
        return 1 if corner.front else -1
    if quantity is Quantity.ROLL_RATE:
        return -corner.side
    return -1 if quantity is Quantity.BODY_DISPLACEMENT and _sinks(corner, channel) else 0


def _sinks(corner: Corner, channel: Channel) -> bool:
    """Return whether a point of the body certainly goes down with a corner.

    A plate on four equal springs that is pushed at (u', v') sinks by 1 + u u' + v v' at (u, v), in
    half lengths from its middle; the half lengths of a usual car are used.
    """
    if channel.at_cg:
        return True
    u, v = 1.0 + channel.x_m / 1.4, channel.y_m / 0.75
    return 1.0 + u * (1 if corner.front else -1) + v * corner.side > _SURE


def _spoken_size(move: _Move) -> str:
    if move.channel.unit == "m":
        return f"{move.first * move.size * 1e3:+.0f} mm"
    return f"{move.first * move.size:+.2g} {move.channel.unit}"
