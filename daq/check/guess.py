"""Guesses what signals measure, from names and units and, with traffic, from physics.

A single signal is guessed from its name.  Three accelerations at rest show how their sensor is
mounted, and so which of its gyroscopes is roll, which is pitch, and their signs.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.codec import SignalLayout
from dbc.units import G_M_S2, known_si

from ..channels import Quantity, message_of, sensor_of, signal_of
from ..vehicle import Corner
from .pushes import AXES, NEAR_1_G, Mounting, Pushes, axis_of, mounting, pushed_corner

# Names of signals: words, wheel, axis, and the kind of quantity -----------------------------------

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


def words(text: str) -> set[str]:
    """Return the words of a name in any case style, in lower case."""
    by_case = {word.lower() for word in _WORD.findall(text)}
    return by_case | {word.lower() for word in re.split(r"[^A-Za-z0-9]+", text) if word}


_CORNERS = {  # sets of words of which one must be in the name
    Corner.FRONT_LEFT: ({"fl"}, {"lf"}, {"vl"}, {"front", "left"}, {"vorn", "links"}),
    Corner.FRONT_RIGHT: ({"fr"}, {"rf"}, {"vr"}, {"front", "right"}, {"vorn", "rechts"}),
    Corner.REAR_LEFT: ({"rl"}, {"lr"}, {"hl"}, {"rear", "left"}, {"hinten", "links"}),
    Corner.REAR_RIGHT: ({"rr"}, {"hr"}, {"rear", "right"}, {"hinten", "rechts"}),
}
_AXES = {
    "x": {"x", "ax", "accx", "long", "longitudinal", "forward", "roll", "wx", "gyrx"},
    "y": {"y", "ay", "accy", "lat", "lateral", "pitch", "nick", "wy", "gyry"},
    "z": words("z az accz vert vertical up down upwards heave yaw wz gyrz"),
}
_TRAVEL = words(
    """travel stroke susp suspension damper shock pot potentiometer string lvdt federweg weg hub pos
    position height ride level deflection compression displacement laser"""
)
_NO_TRAVEL = words(
    """radar lidar distance dist range object obj target lead gap obstacle parking park ultrasonic
    uss trip odometer altitude gps gnss lane road curve curvature wheelbase track tracker"""
)


def plain_name(text: str, fallback: str) -> str:
    """Return text as a name of ASCII letters, digits, underscores; `fallback` if none is left."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in text).strip("_") or fallback
    return plain if plain[0].isalpha() else f"s_{plain}"


def corner_by_name(name: str, message: str) -> tuple[Corner, str] | None:
    """Return the wheel that a name or its message's states, and which does; None if unclear."""
    words_of_source = {
        "name": words(name),
        "end of the name": {name.lower()[-2:]},
        "message": words(message),
    }
    for source, name_words in words_of_source.items():
        stated = [
            corner for corner, sets in _CORNERS.items() if any(each <= name_words for each in sets)
        ]
        if len(stated) == 1:
            return stated[0], source
    return None


# Guesses ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Guess:
    """A guess at what a signal measures."""

    quantity: Quantity
    why: str
    corner: Corner | None = None
    """None on the body, and where it is not known."""
    sign: int = 1
    """-1 if gravity shows that the sensor is upside down, or pushes that it is turned."""
    ask: str = ""
    """Question to the user about an uncertain guess; empty if it is certain."""
    of_device: bool = False
    """True if the question is about a device with several channels."""
    is_proven: bool = False
    """True if pushes on the corners have proven corner and sign."""
    tare: float | None = None
    """Travel at rest, SI, with the sign; None if it was not measured."""


FEWEST = 20
"""Fewest samples from which a conclusion is drawn."""
_WHERE, _WHICH_HUB = "at which corner?", "is it on the body, or on which hub?"
_FARTHEST_M = 1.0
"""Largest reading of a suspension travel at rest, m."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A signal that may be a channel: its names, and what it read."""

    full: str
    """Name with that of its message."""
    si_unit: str
    """SI unit of the measured quantity."""
    unit: str
    factor: float
    """`unit`, `factor`: unit that the database states, and its size in `si_unit`."""
    corner: Corner | None
    """Wheel that a name states."""
    corner_source: str
    """Evidence in words: name, end of the name, or message; empty without any."""
    span: float | None
    """Difference of its highest and lowest valid value, SI; None if it is not stated."""
    level: float | None
    """Value at rest, SI; None if it was not measured."""

    @property
    def name(self) -> str:
        """Name within its message."""
        return signal_of(self.full)

    @property
    def sensor(self) -> str:
        """Name of its sensor; empty on a bench with one database."""
        return sensor_of(message_of(self.full))

    @property
    def is_on_body(self) -> bool:
        """True if a name says that the sensor is on the body."""
        name_words = words(f"{self.name} {message_of(self.full)}")
        return bool(name_words & {"body", "chassis", "sprung", "cg", "aufbau", "imu"})

    @property
    def axis(self) -> str | None:
        """Axis of the sensor that the name states: x, y or z."""
        name_words, last_letter = words(self.name), self.name[-1:].lower()
        stated = [axis for axis, axis_words in _AXES.items() if name_words & axis_words]
        if len(stated) == 1:
            return stated[0]
        return last_letter if last_letter in _AXES and "body" not in name_words else None

    @property
    def gravity_g(self) -> float | None:
        """Reading of an acceleration at rest, g."""
        return None if self.level is None else self.level / G_M_S2

    @property
    def shows_push(self) -> bool:
        """True if a push by hand moves it: a rate of turn, or a length that may be a travel."""
        return self.si_unit == "rad/s" or (self.si_unit == "m" and _by_name(self) is not None)


def candidate(full: str, signal: SignalLayout, values: NDArray[np.float64]) -> Candidate | None:
    """Return a signal that may be a channel; None if it measures nothing that the method uses.

    `full`: its name with that of its message.  `values`: its samples, (n,), finite, in its unit.
    """
    si = known_si(signal.unit)
    state_words = words("valid validity accuracy status sta state flag error quality alive temp")
    if si is None or words(signal.name) & state_words:
        return None
    if si.unit not in ("m/s2", "rad/s", "rad/s2", "m"):
        return None
    span = level = None
    if signal.limits is not None:
        span = (signal.limits[1] - signal.limits[0]) * si.factor
    if len(values) >= FEWEST:
        level = float(np.median(values)) * si.factor
    corner, source = corner_by_name(signal.name, message_of(full)) or (None, "")
    return Candidate(full, si.unit, signal.unit, si.factor, corner, source, span, level)


def guess_channels(candidates: Sequence[Candidate], pushes: Pushes | None) -> dict[str, Guess]:
    """Return guesses by full name of the signal; none for a length that is no suspension travel.

    Guesses from names give way to those from gravity, and both to those from `pushes`.
    """
    devices: dict[tuple[str, Corner | None], list[Candidate]] = defaultdict(list)  # by sensor
    for s in candidates:
        devices[s.sensor, s.corner].append(s)
    with_gyroscope = {s.sensor for s in candidates if s.si_unit in ("rad/s", "rad/s2")}
    guesses: dict[str, Guess] = {}
    for (sensor, _), device in devices.items():
        guesses |= {s.full: guess for s in device if (guess := _by_name(s)) is not None}
        guesses |= _by_mounting(device, pushes)
        for s in device:
            # Without gyroscopes or an axis in its name it may be on a hub as well.
            may_be_hub = not s.is_on_body and (s.axis is None or sensor not in with_gyroscope)
            guess = guesses.get(s.full)
            is_body = guess is not None and guess.quantity is Quantity.BODY_ACCELERATION
            if guess is not None and is_body and may_be_hub and not guess.ask:
                guesses[s.full] = replace(guess, ask=_WHICH_HUB, of_device=False)
    lengths = [s for s in candidates if s.si_unit == "m" and s.full in guesses]
    return guesses | _travels(lengths, guesses, pushes)


# One signal, from its name ------------------------------------------------------------------------


class _Rotation(NamedTuple):
    """Pitch or roll: name, words, usual axis of a sensor, and the sense that is positive."""

    name: str
    words: set[str]
    axis: str
    sense: str

    def quantity(self, unit: str) -> Quantity:
        """Return the quantity of a signal with this SI unit."""
        return Quantity(f"{self.name}_{'rate' if unit == 'rad/s' else 'acceleration'}")


_PITCH = _Rotation("pitch", {"pitch", "nick"}, "y", "positive is nose down")
_ROLL = _Rotation("roll", {"roll", "wank"}, "x", "positive lifts the left side")


def _by_name(s: Candidate) -> Guess | None:
    """Return the guess from names and unit."""
    return {"m/s2": _guess_acceleration, "m": _guess_length}.get(s.si_unit, _guess_rotation)(s)


def _guess_acceleration(s: Candidate) -> Guess:
    """Return a guess for an acceleration: on the body, on a hub, or unused if not vertical."""
    unit = f"unit {s.unit}"
    is_vertical = s.axis == "z" or (s.axis is None and s.corner is not None)
    sign, proof = 1, "vertical by its name" if s.axis == "z" else "assumed to be vertical"
    if s.gravity_g is not None:
        reading = f"reads {s.gravity_g:+.2f} g"
        if abs(abs(s.gravity_g) - 1) > NEAR_1_G:
            why = f"{unit}, {reading}: not vertical"
            if is_vertical:
                why = f"{unit}; named like a vertical one, but {reading} at rest"
            return Guess(Quantity.UNUSED, why)
        sign, proof = (-1 if s.gravity_g < 0 else 1), f"{reading} at rest: vertical"
    elif not is_vertical:
        return Guess(Quantity.UNUSED, f"{unit}, not vertical by its name")
    if s.corner is None or s.is_on_body:
        return Guess(Quantity.BODY_ACCELERATION, f"{unit}, {proof}", sign=sign)
    why = f"{unit}, {proof}, corner by its {s.corner_source}"
    return Guess(Quantity.HUB_ACCELERATION, why, s.corner, sign)


def _guess_rotation(s: Candidate) -> Guess:
    """Return a guess for a rate of turn or an angular acceleration: pitch, roll, or unused."""
    unit = f"unit {s.unit}"
    for text, source in ((s.name, "name"), (message_of(s.full), "message")):
        name_words = words(text)
        if name_words & {"yaw", "gier"}:
            break
        for rotation in (_PITCH, _ROLL):
            if name_words & rotation.words:
                why = f"{unit}, {rotation.name} by its {source}; {rotation.sense}"
                return Guess(rotation.quantity(s.si_unit), why)
    for rotation in (_PITCH, _ROLL):
        if s.axis == rotation.axis:
            why = f"{unit}, about {rotation.axis} by its name; {rotation.sense}"
            return Guess(rotation.quantity(s.si_unit), why)
    return Guess(Quantity.UNUSED, f"{unit}, neither pitch nor roll by its name")


def _guess_length(s: Candidate) -> Guess | None:
    """Return a guess for a length; None if it is large, or neither corner nor name say travel."""
    # Twice the reading at rest, because a span has both ends: -1 m to 1 m.
    span_m = s.span if s.level is None else 2.0 * abs(s.level)
    if words(s.full) & _NO_TRAVEL or (span_m or 0.0) > 2 * _FARTHEST_M:
        return None
    if s.corner is not None:
        why = f"unit {s.unit}, corner by its {s.corner_source}"
        return Guess(Quantity.SUSPENSION_TRAVEL, why, s.corner)
    if not words(s.name) & _TRAVEL:
        return None
    return Guess(Quantity.UNUSED, f"unit {s.unit}, a travel by its name", ask=_WHERE)


# The sensors of one device, from gravity and pushes -----------------------------------------------


def _by_mounting(device: Sequence[Candidate], pushes: Pushes | None) -> dict[str, Guess]:
    """Return the guesses for a device by full name of the signal, from how it is mounted.

    Empty unless it read an acceleration at rest on all three axes.  Its gyroscopes are guessed if
    one axis is vertical and it has two or three.
    """
    accelerations = {s.axis: s for s in device if s.si_unit == "m/s2" and s.axis}
    gravity_g = {axis: s.gravity_g for axis, s in accelerations.items() if s.gravity_g is not None}
    if len(gravity_g) < len(AXES):
        return {}
    gyroscopes = {s.axis: s for s in device if s.si_unit in ("rad/s", "rad/s2") and s.axis}
    angles: dict[Corner, dict[str, float]] = defaultdict(dict)  # by pushed corner, then by axis
    for axis, s in gyroscopes.items():
        if pushes is not None and s.si_unit == "rad/s" and s.full in pushes.traces:
            for corner, angle in pushes.angles(s.full).items():
                angles[corner][axis] = angle
    mounted = mounting(gravity_g, angles)
    if mounted is None:
        levels = ", ".join(f"{gravity_g[axis]:+.2f}" for axis in AXES)
        ask = f"is one axis vertical, and the unit right? It reads {levels} g"
        unclear = Guess(Quantity.UNUSED, "no axis reads 1 g", ask=ask, of_device=True)
        return {s.full: unclear for s in accelerations.values()}
    vertical_axis, sign = axis_of(mounted.up)
    guesses = {}
    for axis, s in accelerations.items():
        why = f"reads {gravity_g[axis]:+.2f} g at rest"
        if axis != vertical_axis:
            guesses[s.full] = Guess(Quantity.UNUSED, f"{why}: not vertical")
        elif s.corner is None or s.is_on_body:
            guesses[s.full] = Guess(Quantity.BODY_ACCELERATION, f"{why}: vertical", sign=sign)
        else:
            guesses[s.full] = Guess(Quantity.HUB_ACCELERATION, f"{why}: vertical", s.corner, sign)
    if len(gyroscopes) > 1:
        guesses |= {s.full: _gyroscope(s, axis, mounted, pushes) for axis, s in gyroscopes.items()}
    return guesses


def _gyroscope(s: Candidate, axis: str, mounted: Mounting, pushes: Pushes | None) -> Guess:
    """Return the guess for a rotation about an axis of a sensor: roll, pitch, or unused for yaw.

    `pushes`: only their presence counts here; what they show of the axes is in `mounted`.
    """
    if axis == axis_of(mounted.up)[0]:
        return Guess(Quantity.UNUSED, f"about {axis}, the vertical axis of its sensor: yaw")
    forward_axis, forward_sign = axis_of(mounted.forward)
    rotation, direction = _PITCH, mounted.left
    if axis == forward_axis:
        rotation, direction = _ROLL, mounted.forward
    proof, ask = "proven", ""
    if not mounted.surely_forward:
        proof, plus = "taken", "+" if forward_sign > 0 else "-"
        ask = f"does the sensor's {plus}{forward_axis} axis point forward?"
        ask += "  The pushes did not show it." if pushes is not None else ""
    why = f"about {axis}; {forward_axis} is {proof} for the axis along the car; {rotation.sense}"
    quantity, sign = rotation.quantity(s.si_unit), axis_of(direction)[1]
    return Guess(quantity, why, None, sign, ask, True, mounted.surely_forward)


def _travels(
    lengths: Sequence[Candidate], guesses: Mapping[str, Guess], pushes: Pushes | None
) -> dict[str, Guess]:
    """Return the guesses for lengths; for travels with corner, sign and tare.

    The corner is the one that pushes show, else the one that the name states.  `guesses`: from
    the names.
    """
    traces = pushes.traces if pushes is not None else {}
    peaks = {s.full: pushes.peaks(s.full) for s in lengths if pushes and s.full in traces}
    travels = {s.full: guesses[s.full] for s in lengths}
    for name, peaks_by_corner in peaks.items():
        other_peaks = [of_other for other, of_other in peaks.items() if other != name]
        pushed = pushed_corner(peaks_by_corner, other_peaks)
        if pushed is not None:
            corner, sign = pushed
            named_corner, ask = travels[name].corner, ""
            if named_corner not in (None, corner):
                ask = f"its name says {named_corner}: are plugs swapped?"
            why, kind = f"moved most by the push on {corner}", Quantity.SUSPENSION_TRAVEL
            travels[name] = Guess(kind, why, corner, sign, ask, is_proven=True)
    for s in lengths:
        guess = travels[s.full]
        if guess.quantity is Quantity.SUSPENSION_TRAVEL and s.level is not None:
            tare = guess.sign * s.level  # is subtracted after the sign
            travels[s.full] = replace(guess, tare=tare)
    return travels
