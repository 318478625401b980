"""Guesses what a signal measures, from unit, name, comment and gravity."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

from dbc.layout import SignalLayout
from dbc.units import G_M_S2, known_si, to_si

from ..channels import Quantity
from ..vehicle import Corner

_COMMENT = re.compile(r'\bCM_\s+SG_\s+(\d{1,10})\s+(\w{1,128})\s+"([^"]{0,2000})"')
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")

_CORNERS = {
    Corner.FRONT_LEFT: ({"fl"}, {"lf"}, {"vl"}, {"front", "left"}, {"vorn", "links"}),
    Corner.FRONT_RIGHT: ({"fr"}, {"rf"}, {"vr"}, {"front", "right"}, {"vorn", "rechts"}),
    Corner.REAR_LEFT: ({"rl"}, {"lr"}, {"hl"}, {"rear", "left"}, {"hinten", "links"}),
    Corner.REAR_RIGHT: ({"rr"}, {"hr"}, {"rear", "right"}, {"hinten", "rechts"}),
}
_BODY = {"body", "chassis", "sprung", "cg", "aufbau"}
_IMU = {"imu"}
_X = {"x", "ax", "accx", "long", "longitudinal", "forward", "roll", "wx", "gyrx"}
_Y = {"y", "ay", "accy", "lat", "lateral", "pitch", "nick", "wy", "gyry"}
_Z = {"z", "az", "accz", "vert", "vertical", "up", "down", "upwards", "heave", "yaw", "wz", "gyrz"}
_NAMES = {
    "travel": """
        travel stroke susp suspension damper shock pot potentiometer string lvdt federweg weg hub
        pos position height ride level deflection compression displacement laser""",
    "no travel": """
        radar lidar distance dist range object obj target lead gap obstacle parking park ultrasonic
        uss trip odometer altitude gps gnss lane road curve curvature wheelbase track tracker""",
    "no value": "valid validity accuracy status sta state flag error quality alive temp",
}
_TRAVEL = frozenset(_NAMES["travel"].split())
_NO_TRAVEL = frozenset(_NAMES["no travel"].split())
_SUSPENSION = {"travel", "stroke", "susp", "suspension", "damper", "shock", "pot", "string", "lvdt"}
_SUSPENSION |= {"potentiometer", "federweg"}
_NO_VALUE = frozenset(_NAMES["no value"].split())
_ACCELERATION = {"acc", "accel", "acceleration", "beschleunigung"}
_RATE = {"gyro", "gyr", "rate", "omega", "angular", "drehrate"}
_UNIT_1_G = {"g": 1.0, "m/s2": G_M_S2, "mg": 1000.0, "mm/s2": 1000.0 * G_M_S2}
NO_UNIT = ("", "-", "none", "None", "n/a", "Unit_None")
"""Texts in databases that mean no unit."""
FARTHEST_M = 1.0
"""Largest reading of a suspension travel at rest, m."""
_PITCH, _ROLL, _YAW = {"pitch", "nick"}, {"roll", "wank"}, {"yaw", "gier"}


class Asked(StrEnum):
    """Kind of the answer to a question of a proposal."""

    RIGHT = "whether it is right"
    CORNER = "corner of an acceleration, or body"
    WHEEL = "wheel of a travel, which is guessed"
    WHERE = "wheel of a travel, which nothing shows"
    FORWARD = "axis that points forward"
    UNIT = "unit"
    OURS = "whether the sensor is one of this bench"


@dataclass(frozen=True, slots=True)
class Guess:
    """A guess at what a signal measures."""

    quantity: Quantity
    """Guessed quantity."""
    corner: Corner | None
    """Guessed wheel."""
    sign: int
    """Sign, -1 if gravity shows that the sensor is upside down."""
    why: str
    """Reasons for the guess."""
    ask: str = ""
    """Question to the user about an uncertain guess; empty if it is certain."""
    asked: Asked = Asked.RIGHT
    """Kind of the answer."""
    unit: str = ""
    """Unit of the signal if the database states none."""
    is_proven: bool = False
    """True if pushes on the corners have proven corner and sign."""
    tare: float | None = None
    """Travel at rest, SI, with the sign; None if it was not measured."""


def words(text: str) -> set[str]:
    """Return the words of a name in any case style, in lower case."""
    parts = [part.lower() for part in _WORD.findall(text)]
    plain = {part.lower() for part in re.split(r"[^A-Za-z0-9]+", text) if part}
    return set(parts) | plain


def signal_comments(dbc_text: str) -> dict[tuple[int, str], str]:
    """Return the comments on signals, by identifier (as written in the DBC) and name."""
    return {(int(number), name): text for number, name, text in _COMMENT.findall(dbc_text)}


def guess_corner(name: str, message: str, comment: str) -> tuple[Corner, str] | None:
    """Return the wheel that a name, a message's name or a comment states, and which of them."""
    texts = {"name": words(name), "end of the name": {name.lower()[-2:]}}
    for place, said in (texts | {"message": words(message), "comment": words(comment)}).items():
        found = [c for c, groups in _CORNERS.items() if any(group <= said for group in groups)]
        if len(found) == 1:
            return found[0], place
    return None


def guess_quantity(
    message: str, signal: SignalLayout, comment: str, level: float | None
) -> Guess | None:
    """Return a guess at what a signal measures, or None if the method does not use it.

    `message`: name of its message.  `comment`: its comment in the DBC.  `level`: its value at rest
    in its own unit, if it was measured.
    """
    si = known_si(signal.unit)
    if si is None:
        return None
    corner = guess_corner(signal.name, message, comment)
    unit = f"unit {signal.unit}"
    if is_no_value(signal.name):
        return None
    if si.unit == "m/s2":
        share = None if level is None else level * si.factor / G_M_S2
        return _acceleration(message, signal.name, comment, corner, share, unit)
    if si.unit in ("rad/s", "rad/s2"):
        return _turn(message, signal.name, comment, si.unit == "rad/s", unit)
    if si.unit != "m" or not is_travel(message, signal, comment, level):
        return None
    if corner is not None:
        return Guess(Quantity.SUSPENSION_TRAVEL, corner[0], 1, f"{unit}, corner by its {corner[1]}")
    if words(signal.name) & _TRAVEL:
        why, ask = f"{unit}, a travel by its name", "at which corner?"
        return Guess(Quantity.UNUSED, None, 1, why, ask, Asked.WHERE)
    return None


def is_travel(message: str, signal: SignalLayout, comment: str, level: float | None) -> bool:
    """Return whether a length may be a suspension travel, not one of a radar or the road.

    Arguments as in `guess_quantity`.
    """
    found_words = words(signal.name) | words(message) | words(comment)
    if found_words & _NO_TRAVEL:
        return False
    factor = to_si(signal.unit).factor
    if level is not None:
        return abs(level * factor) <= FARTHEST_M
    low, high = signal.minimum, signal.maximum
    return low is None or high is None or (high - low) * factor <= 2.0 * FARTHEST_M


def unit_by_gravity(size: float) -> str | None:
    """Return the unit in which this magnitude at rest is 1 g; None if there is none."""
    return next((u for u, one in _UNIT_1_G.items() if abs(size / one - 1) <= 0.1), None)


def kind_by_name(message: str, signal: SignalLayout) -> str | None:
    """Return m/s2, rad/s or m for a signal without a unit, from its name; None if it has none.

    A length is accepted only for a travel at a corner.
    """
    name_words = words(signal.name)
    if signal.unit not in NO_UNIT or signal.length < 8 or name_words & _NO_VALUE:
        return None
    if name_words & _RATE:
        return "rad/s"
    if name_words & _ACCELERATION:
        return "m/s2"
    other = words(message) & _NO_TRAVEL
    is_travel = name_words & _SUSPENSION and not name_words & _NO_TRAVEL and not other
    return "m" if is_travel and guess_corner(signal.name, "", "") else None


def unit_by_peak(peak: float) -> str:
    """Return the probable unit of travels whose largest magnitude is `peak`: m below one, else mm.

    At rest one of them alone may read next to nothing in any unit.
    """
    return "m" if 0.005 <= peak <= FARTHEST_M else "mm"


def is_no_value(name: str) -> bool:
    """Return whether a name says that a signal describes a measurement and is not one itself."""
    return bool(words(name) & _NO_VALUE)


def is_body(text: str, *, or_imu: bool = True) -> bool:
    """Return whether a name says that a sensor is on the body.

    An IMU usually is on the body; with `or_imu` False, the name must state it.
    """
    return bool(words(text) & (_BODY | _IMU if or_imu else _BODY))


def _acceleration(
    message: str,
    name: str,
    comment: str,
    corner: tuple[Corner, str] | None,
    share: float | None,
    unit: str,
) -> Guess:
    axis = axis_by_name(name, comment)
    if share is not None:
        if abs(abs(share) - 1) > 0.1:
            if axis == "z" or (axis is None and corner is not None):
                why = f"{unit}; named like a vertical one, but reads {share:+.2f} g at rest"
                return Guess(Quantity.UNUSED, None, 1, why)
            return Guess(Quantity.UNUSED, None, 1, f"{unit}, reads {share:+.2f} g: not vertical")
        proof, vertical = f"reads {share:+.2f} g at rest: vertical", True
    else:
        vertical = axis == "z" or (axis is None and corner is not None)
        proof = "vertical by its name" if axis == "z" else "assumed to be vertical"
    if not vertical:
        return Guess(Quantity.UNUSED, None, 1, f"{unit}, not vertical by its name")
    sign = -1 if share is not None and share < 0 else 1
    if corner is not None and not is_body(f"{name} {message}"):
        why = f"{unit}, {proof}, corner by its {corner[1]}"
        return Guess(Quantity.HUB_ACCELERATION, corner[0], sign, why)
    return Guess(Quantity.BODY_ACCELERATION, None, sign, f"{unit}, {proof}")


def _turn(message: str, name: str, comment: str, is_rate: bool, unit: str) -> Guess:
    pitch = Quantity.PITCH_RATE if is_rate else Quantity.PITCH_ACCELERATION
    roll = Quantity.ROLL_RATE if is_rate else Quantity.ROLL_ACCELERATION
    for text, place in ((name, "name"), (comment, "comment"), (message, "message")):
        text_words = words(text)
        if text_words & _YAW:
            break
        if text_words & _PITCH:
            return Guess(pitch, None, 1, f"{unit}, pitch by its {place}; positive is nose down")
        if text_words & _ROLL:
            why = f"{unit}, roll by its {place}; positive lifts the left side"
            return Guess(roll, None, 1, why)
    axis = axis_by_name(name, "")
    if axis == "y":
        return Guess(pitch, None, 1, f"{unit}, about y by its name; positive is nose down")
    if axis == "x":
        return Guess(roll, None, 1, f"{unit}, about x by its name; positive lifts the left side")
    return Guess(Quantity.UNUSED, None, 1, f"{unit}, neither pitch nor roll by its name")


def axis_by_name(name: str, comment: str) -> str | None:
    """Return x, y or z if the name, or else the comment, states exactly one of them."""
    for said in (words(name), words(comment)):
        found = [axis for axis, known in (("x", _X), ("y", _Y), ("z", _Z)) if said & known]
        if len(found) == 1:
            return found[0]
    last = name[-1:].lower()
    return last if last in ("x", "y", "z") else None
