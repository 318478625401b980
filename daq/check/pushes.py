"""Judges the guided push test, and finds from gravity and pushes how sensors are mounted.

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
    Quantity.PITCH_RATE: 0.01,
    Quantity.ROLL_RATE: 0.01,
}
"""Least deviation that counts as a push by hand, SI.  Accelerations are not used: in them the swing
back is stronger than the push, and gravity has already proved their signs."""
_SETTLED_S = 0.6
"""Time without motion after which a push is over, s."""

Envelope = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lowest and highest value of a channel in each bin, (n,) each."""


@dataclass(frozen=True, slots=True)
class PushResult:
    """The result of a push on one corner."""

    corner: Corner
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
    deviations = {}  # from rest, and the least that is a movement
    for channel in channels:
        if channel.quantity not in _LEAST or channel.name not in lanes:
            continue
        low, high = lanes[channel.name]
        middle = (low + high) / 2.0
        known = middle[np.isfinite(middle)]
        if len(known):
            level = float(np.median(known))
            # A push changes no median; 1.48 makes a standard deviation of normal noise of it.
            noise = 1.48 * float(np.median(np.abs(known - level)))
            least = max(_LEAST[channel.quantity], 6.0 * noise)
            deviations[channel] = np.nan_to_num(middle - level), least
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
            # Clearly more than noise, and reached before the swing back.
            first = away[begin + int(np.argmax(size >= 0.4 * peak))]
            moves.append(_Move(channel, peak, int(np.sign(first))))
    if not moves:
        return moving if begin == len(loud) and loud.any() else asked
    first_loud, last_loud = begin + np.flatnonzero(loud[begin:])[[0, -1]]
    moving_s, quiet_s = (len(loud) - 1 - first_loud) * bin_s, (len(loud) - 1 - last_loud) * bin_s
    if quiet_s < _SETTLED_S and moving_s < 5.0:
        return moving
    return _judged(corner, moves, channels)


def _judged(corner: Corner, moves: Sequence[_Move], channels: Sequence[Channel]) -> PushResult:
    """Judge a push that is over, by the channels that moved."""
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
        moved = most.channel
        text = f"{moved.corner} moved: another corner was pushed, or {due.name} and {moved.name} "
        text += "are swapped"
        advice = f"press R and push the {spoken(corner)}; if it repeats, swap their plugs"
        return PushResult(corner, True, False, text, advice)
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


def _expected(corner: Corner, channel: Channel) -> int | None:
    """Return the expected first direction of a channel, +1 or -1; None if it is not certain."""
    match channel.quantity:
        case Quantity.SUSPENSION_TRAVEL:
            return 1 if channel.corner is corner else None
        case Quantity.PITCH_RATE:
            return 1 if corner.front else -1
        case Quantity.ROLL_RATE:
            return -corner.side
    return None


# How a sensor is mounted, from gravity and pushes -------------------------------------------------


AXES = ("x", "y", "z")
NEAR_1_G = 0.1
"""Largest relative deviation of a magnitude at rest from 1 g."""
_CLEAR = 2.0
"""Factor by which the best direction or corner must fit the pushes better than the next one."""

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Mounting:
    """Directions of the car in the axes of a sensor."""

    up: Vector
    """Upward direction, shape (3,), components -1, 0 or 1."""
    forward: Vector
    """Forward direction, shape (3,), components -1, 0 or 1."""
    surely_forward: bool
    """True if pushes prove the forward direction."""

    @property
    def left(self) -> Vector:
        """The direction to the left."""
        return np.cross(self.up, self.forward)


def axis_of(direction: Vector) -> tuple[str, int]:
    """Return the axis of the sensor along a direction of the car, and its sign."""
    place = int(np.argmax(np.abs(direction)))
    return AXES[place], 1 if direction[place] > 0 else -1


def mounting(
    gravity_g: Mapping[str, float],
    turns: Mapping[Corner, Mapping[str, float]] | None,
) -> Mounting | None:
    """Return how a sensor is mounted; None if no axis is vertical.

    `gravity_g`: reading of each of the three axes at rest, in g.  `turns`: the angle by which the
    body turned about each axis in a push on each corner, any unit; None without pushes: x is then
    assumed to be forward, or z if x is vertical.
    """
    reading = np.array([gravity_g[axis] for axis in AXES])
    size = float(np.linalg.norm(reading))
    share = reading / size if size > 0 else reading
    vertical = int(np.argmax(np.abs(share)))
    if abs(size - 1) > NEAR_1_G or abs(share[vertical]) < 0.9:
        return None  # or tilted by more than 26 deg
    up = np.zeros(3)
    up[vertical] = np.sign(share[vertical])
    # The four directions that may be forward.
    level = [sign * e for e in np.eye(3) if not np.any(up * e) for sign in (1.0, -1.0)]
    if turns:
        fits = [_fit(up, forward, turns) for forward in level]
        best, second = np.argsort(fits)[:-3:-1].tolist()
        if fits[best] > _CLEAR * max(fits[second], 0.0):
            return Mounting(up, level[best], True)
    # x is forward; where x is vertical it is z, or -z if x points up.
    usual = -up[0] * np.eye(3)[2] if up[0] else np.eye(3)[0]
    return Mounting(up, usual, False)


def _fit(up: Vector, forward: Vector, turns: Mapping[Corner, Mapping[str, float]]) -> float:
    """Return how well a forward direction explains pitch and roll in the pushes."""
    left = np.cross(up, forward)
    total = 0.0
    for corner, angles in turns.items():
        turn = np.array([angles.get(axis, 0.0) for axis in AXES])
        size = float(np.linalg.norm(turn))
        if size > 0:
            pitch, roll = float(turn @ left), float(turn @ forward)
            # Positive pitch is nose down; positive roll lifts the left side, which a push lowers.
            total += ((1.0 if corner.front else -1.0) * pitch - corner.side * roll) / size
    return total


def pushed_corner(
    peaks: Mapping[Corner, float], others: Sequence[Mapping[Corner, float]]
) -> tuple[Corner, int] | None:
    """Return the corner and the sign of a travel sensor; None if they are not clear.

    `peaks`: its largest deviation in the push on each corner, any unit.  `others`: those of all
    other travels.  The push on its own corner moves it more than any other push does.
    """
    best, second = sorted(peaks, key=lambda corner: -abs(peaks[corner]))[:2]
    size = abs(peaks[best])
    if not size or size < _CLEAR * abs(peaks[second]) or any(abs(o[best]) > size for o in others):
        return None
    return best, 1 if peaks[best] > 0 else -1


# Cuts a recording of a push on each corner, with rest between them, and measures the signals ------

_BIN_S = 0.05
_QUIET_S = 0.5
"""Rest between two pushes, s."""
_REST_S = 0.5
"""Rest at the beginning, from which level and noise are taken, s."""

Trace = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Times, ns, and values of a signal, each of shape (n,)."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """A recording of a push on each corner."""

    spans: Mapping[Corner, tuple[int, int]]
    """Start and end of each push, ns."""
    traces: Mapping[str, Trace]
    """Decoded samples, by full name of the signal."""

    def peaks(self, name: str) -> dict[Corner, float]:
        """Return the largest deviation of a signal from rest in each push, signed."""
        return {corner: _largest(value) for corner, _, value in self._parts(name)}

    def turns(self, name: str) -> dict[Corner, float]:
        """Return the largest angle in each push, from a signal that is a rate, signed."""
        return {
            corner: _largest(np.cumsum(rate[:-1] * np.diff(t_ns)) * 1e-9)
            for corner, t_ns, rate in self._parts(name)
        }

    def _parts(self, name: str) -> list[tuple[Corner, NDArray[np.int64], NDArray[np.float64]]]:
        t_ns, value = self.traces[name]
        level = np.median(value[t_ns < t_ns[0] + round(_REST_S * 1e9)])
        inside = {c: (t_ns >= start) & (t_ns < end) for c, (start, end) in self.spans.items()}
        return [(c, t_ns[rows], value[rows] - level) for c, rows in inside.items()]


def _largest(value: NDArray[np.float64]) -> float:
    return float(value[np.argmax(np.abs(value))]) if len(value) else 0.0


def find_pushes(traces: Mapping[str, Trace], moved: Sequence[str]) -> tuple[Pushes | None, int]:
    """Return the pushes in a recording, and how many it has; None unless there are four.

    `traces`: decoded samples, in order of time.  `moved`: the signals that a push by hand moves.
    """
    usable = [traces[name] for name in moved if name in traces and len(traces[name][0]) > 1]
    if not usable:
        return None, 0
    first = min(int(t_ns[0]) for t_ns, _ in usable)
    last = max(int(t_ns[-1]) for t_ns, _ in usable)
    active = np.zeros(int((last - first) * 1e-9 / _BIN_S) + 1, bool)
    for t_ns, value in usable:
        before = value[t_ns < first + round(_REST_S * 1e9)]
        if len(before) < 3:
            continue
        away = np.abs(value - np.median(before))
        noise = float(np.std(before)) + float(np.ptp(value)) * 1e-3
        largest = float(away.max())
        if largest > 8.0 * noise:
            far = t_ns[away > max(8.0 * noise, 0.2 * largest)]
            active[((far - first) * 1e-9 / _BIN_S).astype(int)] = True
    bins = np.flatnonzero(active)
    cuts = np.flatnonzero(np.diff(bins) > _QUIET_S / _BIN_S) + 1  # with little rest it is one push
    bin_ns, margin_ns = round(_BIN_S * 1e9), round(_QUIET_S / 2 * 1e9)
    spans = [
        (first + int(p[0]) * bin_ns - margin_ns, first + int(p[-1] + 1) * bin_ns + margin_ns)
        for p in np.split(bins, cuts)  # the bins of one push
        if len(p) and (p[-1] + 1 - p[0]) * _BIN_S >= 0.15  # s, the shortest push
    ]
    if len(spans) != len(ORDER):
        return None, len(spans)
    return Pushes(dict(zip(ORDER, spans, strict=True)), traces), len(spans)
