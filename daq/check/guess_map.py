"""Guesses of what a signal measures, by unit, name, comment and gravity."""

from __future__ import annotations

import re
from dataclasses import dataclass

from dbc.errors import InputError
from dbc.layout import SignalLayout
from dbc.units import G_M_S2, to_si

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
_BODY = {"body", "chassis", "sprung", "imu", "cg", "aufbau"}
_X = {"x", "ax", "accx", "long", "longitudinal", "forward", "roll", "wx", "gyrx"}
_Y = {"y", "ay", "accy", "lat", "lateral", "pitch", "nick", "wy", "gyry"}
_Z = {"z", "az", "accz", "vert", "vertical", "up", "down", "upwards", "heave", "yaw", "wz", "gyrz"}
_PITCH, _ROLL, _YAW = {"pitch", "nick"}, {"roll", "wank"}, {"yaw", "gier"}


@dataclass(frozen=True, slots=True)
class Guess:
    """A guess of what a signal measures."""

    quantity: Quantity
    """Its kind."""
    corner: Corner | None
    """Its wheel."""
    sign: int
    """-1 if gravity shows that it is upside down."""
    why: str
    """The grounds of the guess."""


def words(text: str) -> set[str]:
    """Return the words of a name in any case style, in lower case."""
    parts = [part.lower() for part in _WORD.findall(text)]
    plain = {part.lower() for part in re.split(r"[^A-Za-z0-9]+", text) if part}
    return set(parts) | plain


def signal_comments(dbc_text: str) -> dict[tuple[int, str], str]:
    """Return the comments on signals, by identifier (as written in the DBC) and name."""
    return {(int(number), name): text for number, name, text in _COMMENT.findall(dbc_text)}


def guess_corner(name: str, message: str, comment: str) -> tuple[Corner, str] | None:
    """Return the wheel that a name, a message's name or a comment states, and the place of it."""
    texts = {"name": words(name), "end of the name": {name.lower()[-2:]}}
    for place, said in (texts | {"message": words(message), "comment": words(comment)}).items():
        found = [c for c, groups in _CORNERS.items() if any(group <= said for group in groups)]
        if len(found) == 1:
            return found[0], place
    return None


def guess_quantity(
    message: str, signal: SignalLayout, comment: str, level: float | None
) -> Guess | None:
    """Return what a signal may be, or None if it measures nothing that the method knows.

    `message`: name of its message.  `comment`: what the DBC says of it.  `level`: its value at rest
    in its own unit, if that was seen.
    """
    try:
        si = to_si(signal.unit)
    except InputError:
        return None
    corner = guess_corner(signal.name, message, comment)
    unit = f"unit {signal.unit}"
    if si.unit == "m/s2":
        share = None if level is None else level * si.factor / G_M_S2
        return _acceleration(message, signal.name, comment, corner, share, unit)
    if si.unit in ("rad/s", "rad/s2"):
        return _turn(message, signal.name, comment, si.unit == "rad/s", unit)
    if si.unit == "m" and corner is not None:
        return Guess(Quantity.SUSPENSION_TRAVEL, corner[0], 1, f"{unit}, corner by its {corner[1]}")
    return None


def _acceleration(
    message: str,
    name: str,
    comment: str,
    corner: tuple[Corner, str] | None,
    share: float | None,
    unit: str,
) -> Guess:
    axis = _axis(name, comment)
    if share is not None:
        if abs(abs(share) - 1) > 0.1:
            if axis == "z" or (axis is None and corner is not None):
                why = f"{unit}; named like a vertical one, but reads {share:+.2f} g at rest"
                return Guess(Quantity.UNUSED, None, 1, why)
            return Guess(Quantity.UNUSED, None, 1, f"{unit}, reads {share:+.2f} g: not vertical")
        proof, vertical = f"reads {share:+.2f} g at rest: vertical", True
    else:
        vertical = axis == "z" or (axis is None and corner is not None)
        proof = "vertical by its name" if axis == "z" else "taken for vertical"
    if not vertical:
        return Guess(Quantity.UNUSED, None, 1, f"{unit}, not vertical by its name")
    sign = -1 if share is not None and share < 0 else 1
    if corner is not None and not (words(name) | words(message)) & _BODY:
        why = f"{unit}, {proof}, corner by its {corner[1]}"
        return Guess(Quantity.HUB_ACCELERATION, corner[0], sign, why)
    return Guess(Quantity.BODY_ACCELERATION, None, sign, f"{unit}, {proof}")


def _turn(message: str, name: str, comment: str, is_rate: bool, unit: str) -> Guess:
    for text, place in ((name, "name"), (comment, "comment"), (message, "message")):
        said = words(text)
        if said & _YAW:
            break
        if said & _PITCH:
            kind = Quantity.PITCH_RATE if is_rate else Quantity.PITCH_ACCELERATION
            return Guess(kind, None, 1, f"{unit}, pitch by its {place}; positive is nose down")
        if said & _ROLL:
            kind = Quantity.ROLL_RATE if is_rate else Quantity.ROLL_ACCELERATION
            return Guess(
                kind, None, 1, f"{unit}, roll by its {place}; positive lifts the left side"
            )
    axis = _axis(name, "")
    if axis == "y":
        kind = Quantity.PITCH_RATE if is_rate else Quantity.PITCH_ACCELERATION
        return Guess(kind, None, 1, f"{unit}, about y by its name; positive is nose down")
    if axis == "x":
        kind = Quantity.ROLL_RATE if is_rate else Quantity.ROLL_ACCELERATION
        return Guess(kind, None, 1, f"{unit}, about x by its name; positive lifts the left side")
    return Guess(Quantity.UNUSED, None, 1, f"{unit}, neither pitch nor roll by its name")


def _axis(name: str, comment: str) -> str | None:
    """Return x, y or z where the name, or else the comment, says one of them only."""
    for said in (words(name), words(comment)):
        found = [axis for axis, known in (("x", _X), ("y", _Y), ("z", _Z)) if said & known]
        if len(found) == 1:
            return found[0]
    last = name[-1:].lower()
    return last if last in ("x", "y", "z") else None
