"""Reads the names of signals: words, wheel, axis, and the kind of quantity."""

from __future__ import annotations

import re

from ..vehicle import Corner

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


def words(text: str) -> set[str]:
    """Return the words of a name in any case style, in lower case."""
    parts = {part.lower() for part in _WORD.findall(text)}
    return parts | {part.lower() for part in re.split(r"[^A-Za-z0-9]+", text) if part}


_CORNERS = {
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
_SUSPENSION = words(
    "travel stroke susp suspension damper shock pot potentiometer string lvdt federweg"
)
TRAVEL = _SUSPENSION | words(
    "weg hub pos position height ride level deflection compression displacement laser"
)
NO_TRAVEL = words(
    """radar lidar distance dist range object obj target lead gap obstacle parking park ultrasonic
    uss trip odometer altitude gps gnss lane road curve curvature wheelbase track tracker"""
)
NO_VALUE = words("valid validity accuracy status sta state flag error quality alive temp")
"""Words of signals that describe a measurement and are not one themselves."""
BODY = {"body", "chassis", "sprung", "cg", "aufbau", "imu"}
_ACCELERATION = {"acc", "accel", "acceleration", "beschleunigung"}
_RATE = {"gyro", "gyr", "rate", "omega", "angular", "drehrate"}
PITCH, ROLL, YAW = {"pitch", "nick"}, {"roll", "wank"}, {"yaw", "gier"}


def plain_name(text: str, fallback: str) -> str:
    """Return a name of ASCII letters, digits and underscores that begins with a letter."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in text).strip("_") or fallback
    return plain if plain[0].isalpha() else f"s_{plain}"


def corner_by_name(name: str, message: str, comment: str) -> tuple[Corner, str] | None:
    """Return the wheel that a name, a message's name or a comment states, and which of them."""
    places = {
        "name": words(name),
        "end of the name": {name.lower()[-2:]},
        "message": words(message),
        "comment": words(comment),
    }
    for place, said in places.items():
        stated = [c for c, groups in _CORNERS.items() if any(group <= said for group in groups)]
        if len(stated) == 1:
            return stated[0], place
    return None


def axis_by_name(name: str, comment: str) -> str | None:
    """Return x, y or z if the name, or else the comment, states exactly one of them."""
    for said in (words(name), words(comment)):
        stated = [axis for axis, known in _AXES.items() if said & known]
        if len(stated) == 1:
            return stated[0]
    last = name[-1:].lower()
    return last if last in _AXES else None


def kind_by_name(name: str, message: str) -> str | None:
    """Return m/s2, rad/s or m for a signal without a unit; None if its name states no quantity.

    A length is only a travel at a corner.
    """
    said = words(name)
    if said & _RATE:
        return "rad/s"
    if said & _ACCELERATION:
        return "m/s2"
    is_travel = said & _SUSPENSION and not (said | words(message)) & NO_TRAVEL
    return "m" if is_travel and corner_by_name(name, "", "") else None
