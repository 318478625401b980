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
from ..samples.mapping import Trace
from ..vehicle import Corner

ORDER = (Corner.FRONT_LEFT, Corner.FRONT_RIGHT, Corner.REAR_LEFT, Corner.REAR_RIGHT)
"""The order in which the corners are pushed."""
_LEAST_PUSH = {
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
    """True if no channel moved in a direction that is wrong."""
    text: str
    """The observation, in words."""
    advice: str = ""
    """The next step for the operator; empty if everything is right."""
    inverted: tuple[str, ...] = ()
    """Channels that moved in the wrong direction."""


class _Move(NamedTuple):
    """The motion of a channel in a push."""

    channel: Channel
    peak: float
    """Largest deviation from rest, SI, without its sign."""
    first_sign: int
    """Sign of the deviation at the beginning of the motion."""


def spoken(corner: Corner) -> str:
    """Return the name of a corner for a person at the car."""
    return f"{'front' if corner.front else 'rear'} {'LEFT' if corner.side > 0 else 'RIGHT'}"


def shows_push(channels: Sequence[Channel]) -> bool:
    """Return whether any channel of a bench shows a push by hand."""
    return any(channel.quantity in _LEAST_PUSH for channel in channels)


def judge_push(
    corner: Corner,
    channels: Sequence[Channel],
    lanes: Mapping[str, Envelope],
    begin: int,
    bin_s: float,
) -> PushResult:
    """Return the result of the push on one corner from the data so far; not done until it is over.

    `lanes`: the last seconds as an envelope, NaN where there is no sample; all have the same bins,
    and most bins are at rest.  `begin`: the first bin that counts: before it another corner may
    have been pushed.  A motion that was there already counts neither, until it has settled.
    `bin_s`: width of a bin.
    """
    deviations = _deviations(channels, lanes)
    ask_for_push = PushResult(corner, False, False, f"push DOWN at the {spoken(corner)}, let go")
    wait_for_rest = PushResult(corner, False, False, "moving: let it come to rest")
    if not deviations:
        return ask_for_push
    is_moving = np.any([np.abs(each) >= least for each, least in deviations.values()], axis=0)
    n_bins, settling_bins = len(is_moving), round(_SETTLED_S / bin_s)
    # Begin after a motion that was there before: its first direction is not seen.
    for moving_bin in np.flatnonzero(is_moving).tolist():
        if begin - settling_bins <= moving_bin < begin:
            begin = min(moving_bin + settling_bins + 1, n_bins)
    moves = []
    for channel, (deviation, least) in deviations.items():
        size = np.abs(deviation[begin:])
        peak = float(np.max(size, initial=0.0))
        if peak >= least:
            # 0.4 of the peak is clearly more than noise, and reached before the swing back.
            onset_bin = begin + int(np.argmax(size >= 0.4 * peak))
            moves.append(_Move(channel, peak, int(np.sign(deviation[onset_bin]))))
    if not moves:
        return wait_for_rest if begin == n_bins and is_moving.any() else ask_for_push
    first_moving_bin, last_moving_bin = begin + np.flatnonzero(is_moving[begin:])[[0, -1]]
    since_onset_s = (n_bins - 1 - first_moving_bin) * bin_s
    quiet_s = (n_bins - 1 - last_moving_bin) * bin_s
    if quiet_s < _SETTLED_S and since_onset_s < 5.0:  # a longer motion is judged without rest
        return wait_for_rest
    return _judged(corner, moves, channels)


def _deviations(
    channels: Sequence[Channel], lanes: Mapping[str, Envelope]
) -> dict[Channel, tuple[NDArray[np.float64], float]]:
    """Return for each channel its deviation from rest in each bin, and the least that is motion.

    Only travels and rates of turn that have a sample: others do not show a push (`_LEAST_PUSH`).
    """
    deviations = {}
    for channel in channels:
        if channel.quantity not in _LEAST_PUSH or channel.name not in lanes:
            continue
        low, high = lanes[channel.name]
        middle = (low + high) / 2.0
        known = middle[np.isfinite(middle)]
        if len(known):
            level = float(np.median(known))
            # A push changes no median; 1.48 makes a standard deviation of normal noise of it.
            noise = 1.48 * float(np.median(np.abs(known - level)))
            least = max(_LEAST_PUSH[channel.quantity], 6.0 * noise)
            deviations[channel] = np.nan_to_num(middle - level), least
    return deviations


def _judged(corner: Corner, moves: Sequence[_Move], channels: Sequence[Channel]) -> PushResult:
    """Return the result of a push that is over, from the channels that moved, at least one."""
    travels = [m for m in moves if m.channel.quantity is Quantity.SUSPENSION_TRAVEL]
    largest = max(travels, key=lambda m: m.peak, default=None)
    names = {c.corner: c.name for c in channels if c.quantity is Quantity.SUSPENSION_TRAVEL}
    name = names.get(corner)  # None if no travel is measured at this corner
    if name is not None and largest is None:
        text, advice = f"{name} did not move", "check its plug and its rod, then push again"
        return PushResult(corner, True, False, text, advice)
    if name is not None and largest is not None and largest.channel.corner is not corner:
        other = largest.channel
        text = f"{other.corner} moved: another corner was pushed, or "
        text += f"{name} and {other.name} are swapped"
        advice = f"press R and push the {spoken(corner)}; if it repeats, swap their plugs"
        return PushResult(corner, True, False, text, advice)
    certain = [m for m in moves if _expected(corner, m.channel) is not None]
    wrong = [m.channel.name for m in certain if _expected(corner, m.channel) != m.first_sign]
    if wrong:
        text = f"{', '.join(wrong)} moved the wrong way"
        advice = f"I inverts the sign of {wrong[0]}"
        return PushResult(corner, True, False, text, advice, tuple(wrong))
    # The travel at this corner, if there is one; those at other corners may go either way.
    move = max(certain or moves, key=lambda m: m.channel.corner is corner)
    deviation, unit = move.first_sign * move.peak, move.channel.unit
    motion = f"{deviation * 1e3:+.0f} mm" if unit == "m" else f"{deviation:+.2g} {unit}"
    judged = ", sign right" if certain else ""
    return PushResult(corner, True, True, f"{move.channel.name} moved {motion}{judged}")


def _expected(corner: Corner, channel: Channel) -> int | None:
    """Return the expected first direction of a channel, +1 or -1; None if it is not certain.

    Roll first lowers the pushed side, pitch the pushed end; another wheel's travel may go either
    way.
    """
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
    largest = int(np.argmax(np.abs(direction)))
    return AXES[largest], 1 if direction[largest] > 0 else -1


def mounting(
    gravity_g: Mapping[str, float], angles: Mapping[Corner, Mapping[str, float]]
) -> Mounting | None:
    """Return how a sensor is mounted; None if no axis is vertical, or it does not read 1 g.

    `gravity_g`: reading of each of the three axes at rest, in g.  `angles`: the angle by which the
    body turned about each axis in a push on each corner, any unit.  If they do not show the forward
    direction, or there are none, x is assumed to be forward, or z or -z if x is vertical.
    """
    reading_g = np.array([gravity_g[axis] for axis in AXES])
    size_g = float(np.linalg.norm(reading_g))
    vertical = int(np.argmax(np.abs(reading_g)))
    # 0.9 is the cosine of a tilt of 26 deg: between two axes it is not known which was meant.
    if abs(size_g - 1) > NEAR_1_G or abs(reading_g[vertical]) < 0.9 * size_g:
        return None
    up = np.zeros(3)
    up[vertical] = np.sign(reading_g[vertical])
    horizontal = [sign * e for e in np.eye(3) if not np.any(up * e) for sign in (1.0, -1.0)]
    if angles:
        fits = [_fit(up, forward, angles) for forward in horizontal]
        best, second = np.argsort(fits)[:-3:-1].tolist()  # the last two, from the last
        if fits[best] > _CLEAR * max(fits[second], 0.0):
            return Mounting(up, horizontal[best], True)
    # x is forward; where x is vertical it is z, or -z if x points up.
    usual = -up[0] * np.eye(3)[2] if up[0] else np.eye(3)[0]
    return Mounting(up, usual, False)


def _fit(up: Vector, forward: Vector, angles: Mapping[Corner, Mapping[str, float]]) -> float:
    """Return how well a forward direction explains pitch and roll in the pushes.

    The sum over the corners, each from -sqrt(2), pitch and roll both of the wrong sign, to sqrt(2).
    """
    left = np.cross(up, forward)
    total = 0.0
    for corner, by_axis in angles.items():
        rotation = np.array([by_axis.get(axis, 0.0) for axis in AXES])
        size = float(np.linalg.norm(rotation))
        if size > 0:
            pitch, roll = float(rotation @ left), float(rotation @ forward)
            # Positive pitch is nose down; positive roll lifts the left side, which a push lowers.
            total += ((1.0 if corner.front else -1.0) * pitch - corner.side * roll) / size
    return total


def pushed_corner(
    peaks: Mapping[Corner, float], others: Sequence[Mapping[Corner, float]]
) -> tuple[Corner, int] | None:
    """Return the corner and the sign of a travel sensor; None if they are not clear.

    `peaks`: its largest deviation from rest in the push on each corner, signed, m.  `others`: those
    of all other travels.  The push on its corner must move it twice as much as any other push, and
    no other travel more.
    """
    best, second = sorted(peaks, key=lambda corner: -abs(peaks[corner]))[:2]
    size = abs(peaks[best])
    another_moves_more = any(abs(of_other[best]) > size for of_other in others)
    if not size or size < _CLEAR * abs(peaks[second]) or another_moves_more:
        return None
    return best, 1 if peaks[best] > 0 else -1


# Cuts a recording of a push on each corner, with rest between them, and measures the signals ------

_BIN_S = 0.05
"""Width of the bins in which motion is found, s."""
_QUIET_S = 0.5
"""Shortest rest between two pushes, s."""
_SHORTEST_PUSH_S = 0.15
_REST_S = 0.5
"""Rest at the beginning, from which level and noise are taken, s."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """A recording of a push on each corner."""

    spans: Mapping[Corner, tuple[int, int]]
    """Start and end of each push, ns."""
    traces: Mapping[str, Trace]
    """Samples of the signals that a push moves, by full name."""

    def peaks(self, name: str) -> dict[Corner, float]:
        """Return the largest deviation of a signal from rest in each push, signed."""
        return {corner: _largest(value) for corner, _, value in self._by_corner(name)}

    def angles(self, name: str) -> dict[Corner, float]:
        """Return the largest angle in each push, from a signal that is a rate, signed."""
        return {
            corner: _largest(np.cumsum(rate[:-1] * np.diff(t_ns)) * 1e-9)
            for corner, t_ns, rate in self._by_corner(name)
        }

    def _by_corner(self, name: str) -> list[tuple[Corner, NDArray[np.int64], NDArray[np.float64]]]:
        """Return for each push its corner, the times, ns, and a signal's deviations from rest."""
        t_ns, value = self.traces[name]
        level = np.median(value[t_ns < t_ns[0] + round(_REST_S * 1e9)])
        inside = {c: (t_ns >= start) & (t_ns < end) for c, (start, end) in self.spans.items()}
        return [(c, t_ns[rows], value[rows] - level) for c, rows in inside.items()]


def _largest(value: NDArray[np.float64]) -> float:
    """Return the value of largest magnitude, with its sign; 0 if there is none."""
    return float(value[np.argmax(np.abs(value))]) if len(value) else 0.0


def find_pushes(traces: Mapping[str, Trace]) -> tuple[Pushes | None, int]:
    """Return the pushes in a recording, and how many it has; None unless there are four.

    `traces`: of the signals that a push by hand moves, by full name, finite, in order of time.  The
    recording is cut into bins of equal width; a bin moves if any of these signals does in it.
    """
    traces = {name: trace for name, trace in traces.items() if len(trace[0]) > 1}
    if not traces:
        return None, 0
    start_ns = min(int(t_ns[0]) for t_ns, _ in traces.values())
    end_ns = max(int(t_ns[-1]) for t_ns, _ in traces.values())
    is_moving = np.zeros(int((end_ns - start_ns) * 1e-9 / _BIN_S) + 1, bool)
    for t_ns, value in traces.values():
        moving_ns = _moving_ns(t_ns, value, start_ns + round(_REST_S * 1e9))
        is_moving[((moving_ns - start_ns) * 1e-9 / _BIN_S).astype(int)] = True
    moving_bins = np.flatnonzero(is_moving)
    # Motions with less rest between them than `_QUIET_S` are one push.
    cuts = np.flatnonzero(np.diff(moving_bins) > _QUIET_S / _BIN_S) + 1
    bin_ns, margin_ns = round(_BIN_S * 1e9), round(_QUIET_S / 2 * 1e9)
    spans_ns = []
    for bins in np.split(moving_bins, cuts):  # those of one push
        if len(bins) and (bins[-1] + 1 - bins[0]) * _BIN_S >= _SHORTEST_PUSH_S:
            begin_ns, stop_ns = (start_ns + int(b) * bin_ns for b in (bins[0], bins[-1] + 1))
            spans_ns.append((begin_ns - margin_ns, stop_ns + margin_ns))
    if len(spans_ns) != len(ORDER):
        return None, len(spans_ns)
    return Pushes(dict(zip(ORDER, spans_ns, strict=True)), traces), len(spans_ns)


def _moving_ns(
    t_ns: NDArray[np.int64], value: NDArray[np.float64], rest_end_ns: int
) -> NDArray[np.int64]:
    """Return the times, ns, at which a signal is clearly away from its rest at the beginning.

    Empty if too few samples show the rest, or nothing is clearly away.
    """
    rest = value[t_ns < rest_end_ns]
    if len(rest) < 3:  # no level and noise can be taken
        return t_ns[:0]
    deviation = np.abs(value - np.median(rest))
    # A thousandth of the span stands for the noise of a signal that is constant at rest.
    noise = float(np.std(rest)) + float(np.ptp(value)) * 1e-3
    # Eight standard deviations: no sample of a long rest is there by chance.  A fifth of the
    # largest motion leaves out what a push on another corner swings on.
    return t_ns[deviation > max(8.0 * noise, 0.2 * float(deviation.max()))]
