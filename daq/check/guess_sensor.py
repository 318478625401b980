"""Guesses what the signals of all sensors measure: by names and, with traffic, by physics.

A name is believed of one signal; three accelerations at rest show how their sensor is mounted, and
with it which of its gyroscopes is roll, which is pitch, and their signs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from dbc.layout import MessageLayout, SignalLayout
from dbc.units import G_M_S2, to_si

from ..channels import Quantity
from ..signal_names import sensor_of
from ..vehicle import Corner
from .guess_map import (
    NO_UNIT,
    Guess,
    axis_by_name,
    guess_corner,
    guess_quantity,
    is_body,
    is_no_value,
    kind_by_name,
    unit_by_gravity,
)
from .mounting import AXES, Mounting, axis_of, mounting, pushed_corner, up_axis
from .propose_message import FEWEST, Seen
from .push_test import ORDER
from .pushes import Pushes

Traces = Mapping[str, tuple[NDArray[np.int64], NDArray[np.float64]]]
"""Times and values of signals, by full name."""
_NO_GRAVITY_G = 0.1
"""Largest reading at rest, g, of an accelerometer that is AC coupled."""
_TILTED_DEG = 5.0
"""Tilt of an IMU from which on its user is asked."""


@dataclass(frozen=True, slots=True)
class Push:
    """A recording of a push on each corner."""

    pushes: Pushes
    """When they were."""
    traces: Traces
    """Samples decoded from it."""


@dataclass(frozen=True, slots=True)
class _Signal:
    """A signal that may be a channel."""

    full: str
    message: str
    layout: SignalLayout
    comment: str
    kind: str
    """SI unit of what it measures."""
    corner: Corner | None
    level: float | None
    """At rest, in its own unit."""

    @property
    def axis(self) -> str | None:
        """The axis of the sensor that its name states."""
        return axis_by_name(self.layout.name, self.comment)


ON_HUB = "is it on the body, or on which hub? A kick against each tyre shows it (--push)"


def shows_push_by_unit(message: str, signal: SignalLayout) -> bool:
    """Return whether a push by hand moves such a signal: a rate of turn, or a length."""
    kind = _kind(signal)
    return kind == "rad/s" or (
        kind == "m" and guess_quantity(message, signal, "", None) is not None
    )


def _kind(signal: SignalLayout) -> str | None:
    try:
        unit = to_si(signal.unit).unit
    except InputError:
        return None
    return kind_by_name(signal) if unit == "1" else unit


def guess_bench(
    messages: Sequence[MessageLayout],
    comments: Mapping[tuple[str, int, str], str],
    seen: Seen | None,
    push: Push | None,
) -> dict[str, Guess]:
    """Return what each signal may be, by full name; those that are nothing to the method lack.

    `comments`: by sensor, identifier and signal.  `seen`: traffic at rest.  `push`: pushes on the
    corners.
    """
    signals = _signals(messages, comments, seen)
    guesses = {s.full: g for s in signals if (g := _alone(s)) is not None}
    groups: dict[tuple[str, Corner | None], list[_Signal]] = defaultdict(list)
    for signal in signals:
        groups[sensor_of(signal.message), signal.corner].append(signal)
    for own in groups.values():
        guesses |= _together(own, push)
    guesses |= _without_gravity(groups, guesses)
    guesses |= _hubs(groups, guesses, push)
    guesses |= _travels([s for s in signals if s.kind == "m" and s.full in guesses], guesses, push)
    return guesses


def _signals(
    messages: Sequence[MessageLayout],
    comments: Mapping[tuple[str, int, str], str],
    seen: Seen | None,
) -> list[_Signal]:
    found = []
    for message in messages:
        if seen is not None and message.name not in seen.known:
            continue
        owner = sensor_of(message.name)
        number = message.can_id | message.is_extended << 31
        for signal in message.signals:
            kind = _kind(signal)
            if kind not in ("m/s2", "rad/s", "rad/s2", "m") or is_no_value(signal.name):
                continue
            full = f"{message.name}.{signal.name}"
            comment = comments.get((owner, number, signal.name), "")
            level = None
            if seen is not None:
                _, value = seen.good(full)
                level = float(np.median(value)) if len(value) >= FEWEST else None
            corner = guess_corner(signal.name, message.name, comment)
            place = corner[0] if corner else None
            found.append(_Signal(full, message.name, signal, comment, kind, place, level))
    return found


def _alone(signal: _Signal) -> Guess | None:
    """Return what a signal may be by itself, with the unit that it probably has."""
    unit = ""
    if signal.layout.unit in NO_UNIT:
        unit = {"m/s2": unit_by_gravity(abs(signal.level or 0.0)) or "m/s2"}.get(
            signal.kind, "deg/s"
        )
    layout = replace(signal.layout, unit=unit) if unit else signal.layout
    guess = guess_quantity(signal.message, layout, signal.comment, signal.level)
    if guess is None or not unit:
        return guess
    ask = f"the database states no unit: is it {unit}?"
    return replace(guess, unit=unit, ask=guess.ask or ask)


def _together(own: Sequence[_Signal], push: Push | None) -> dict[str, Guess]:
    """Return what the accelerations and rates of one device are, by how it is mounted."""
    accelerations = {s.axis: s for s in own if s.kind == "m/s2" and s.axis is not None}
    levels = {a: s.level for a, s in accelerations.items() if s.level is not None}
    unit = _common_unit(accelerations, levels)
    if len(levels) < len(AXES) or unit is None:
        return {}
    factor = to_si(unit).factor / G_M_S2
    gravity = {axis: level * factor for axis, level in levels.items() if level is not None}
    up = up_axis(gravity)
    stated = (
        "" if any(to_si(s.layout.unit).unit == "m/s2" for s in accelerations.values()) else unit
    )
    if up is None:
        ask = f"no axis is vertical: it reads {', '.join(f'{gravity[a]:+.2f}' for a in AXES)} g"
        return {
            s.full: Guess(Quantity.UNUSED, None, 1, "tilted", ask, stated)
            for s in accelerations.values()
        }
    rates = {s.axis: s for s in own if s.kind in ("rad/s", "rad/s2") and s.axis is not None}
    turns = _turns(rates, push)
    how = mounting(*up, turns)
    found = _accelerations(accelerations, gravity, how, stated)
    return found | (_rates(rates, how, push is not None) if len(rates) > 1 else {})


def _common_unit(
    accelerations: Mapping[str, _Signal], levels: Mapping[str, float | None]
) -> str | None:
    """Return the unit of three accelerations: as stated, or the one in which they read 1 g."""
    stated = {s.layout.unit for s in accelerations.values()}
    if len(stated) == 1 and to_si(next(iter(stated))).unit == "m/s2":
        return next(iter(stated))
    size = float(np.linalg.norm([level or 0.0 for level in levels.values()]))
    return unit_by_gravity(size)


def _turns(
    rates: Mapping[str, _Signal], push: Push | None
) -> dict[Corner, dict[str, float]] | None:
    if push is None or any(s.kind != "rad/s" for s in rates.values()):
        return None
    angles = {
        axis: push.pushes.turns(push.traces[s.full])
        for axis, s in rates.items()
        if s.full in push.traces
    }
    return {c: {axis: each[c] for axis, each in angles.items()} for c in ORDER} if angles else None


def _accelerations(
    accelerations: Mapping[str, _Signal],
    gravity: Mapping[str, float],
    how: Mounting,
    unit: str,
) -> dict[str, Guess]:
    vertical, sign = axis_of(how.up)
    found = {}
    for axis, signal in accelerations.items():
        why = f"reads {gravity[axis]:+.2f} g at rest"
        if axis != vertical:
            found[signal.full] = Guess(Quantity.UNUSED, None, 1, f"{why}: not vertical", unit=unit)
            continue
        on_hub = signal.corner is not None and not is_body(f"{signal.layout.name} {signal.message}")
        quantity = Quantity.HUB_ACCELERATION if on_hub else Quantity.BODY_ACCELERATION
        corner = signal.corner if on_hub else None
        ask = f"mounted {how.tilt_deg:.0f} degrees off the vertical?"
        ask = ask if how.tilt_deg > _TILTED_DEG else ""
        found[signal.full] = Guess(quantity, corner, sign, f"{why}: vertical", ask, unit)
    return found


def _rates(rates: Mapping[str, _Signal], how: Mounting, were_pushes: bool) -> dict[str, Guess]:
    up, _ = axis_of(how.up)
    forward, _ = axis_of(how.forward)
    directions = {
        Quantity.ROLL_RATE: how.forward,
        Quantity.PITCH_RATE: how.left,
    }
    found = {}
    for axis, signal in rates.items():
        unit = "" if to_si(signal.layout.unit).unit != "1" else "deg/s"
        unknown = "is it deg/s?" if unit else ""
        if axis == up:
            why = f"about {axis}, the vertical axis of its sensor: yaw"
            found[signal.full] = Guess(Quantity.UNUSED, None, 1, why, unit=unit)
            continue
        quantity, direction = next((q, d) for q, d in directions.items() if axis_of(d)[0] == axis)
        if signal.kind == "rad/s2":
            quantity = {
                Quantity.ROLL_RATE: Quantity.ROLL_ACCELERATION,
                Quantity.PITCH_RATE: Quantity.PITCH_ACCELERATION,
            }[quantity]
        sense = "positive lifts the left side" if axis == forward else "positive is nose down"
        proof = "by the pushes" if how.surely_forward else "taken"
        why = f"about {axis}; {forward} is {proof} for the axis along the car; {sense}"
        ask = unknown
        if not how.surely_forward:
            ask = f"does the sensor's {_signed(how.forward)} axis point forward?"
            if were_pushes:
                ask += "  The pushes did not show it."
        sign = axis_of(direction)[1]
        found[signal.full] = Guess(
            quantity, None, sign, why, ask, unit, is_proven=how.surely_forward
        )
    return found


def _signed(direction: NDArray[np.float64]) -> str:
    axis, sign = axis_of(direction)
    return f"+{axis}" if sign > 0 else f"-{axis}"


def _without_gravity(
    groups: Mapping[tuple[str, Corner | None], Sequence[_Signal]], guesses: Mapping[str, Guess]
) -> dict[str, Guess]:
    """Return accelerations at wheels of which no axis reads gravity: those of AC coupled sensors.

    A single one is taken for vertical, of several the one with z in its name.
    """
    found = {}
    for (_, corner), own in groups.items():
        at_rest = {s.full: _gravity_g(s, guesses[s.full]) for s in own if s.kind == "m/s2"}
        shown = [g for g in at_rest.values() if g is not None]
        if corner is None or not shown or max(map(abs, shown)) > _NO_GRAVITY_G:
            continue
        for signal in own:
            vertical = signal.axis == "z" or (signal.axis is None and len(at_rest) == 1)
            said = f"{signal.layout.name} {signal.message}"
            if signal.full in at_rest and vertical and not is_body(said):
                why = f"reads {at_rest[signal.full]:+.2f} g at rest; vertical and {corner} by name"
                ask = "it reads no gravity: is it AC coupled, and does it point up?"
                unit = guesses[signal.full].unit
                hub = Quantity.HUB_ACCELERATION
                found[signal.full] = Guess(hub, corner, 1, why, ask, unit)
    return found


def _gravity_g(signal: _Signal, guess: Guess) -> float | None:
    if signal.level is None:
        return None
    return signal.level * to_si(guess.unit or signal.layout.unit).factor / G_M_S2


def _hubs(
    groups: Mapping[tuple[str, Corner | None], Sequence[_Signal]],
    guesses: Mapping[str, Guess],
    push: Push | None,
) -> dict[str, Guess]:
    """Return accelerations with the hubs that kicks against the tyres show.

    One without gyroscopes beside it, of which no name says where it is, is asked for.
    """
    own = [s for group in groups.values() for s in group if s.kind == "m/s2"]
    turning = {sensor for (sensor, _), group in groups.items() if any(_turns_too(s) for s in group)}
    kicks = (
        {s.full: push.pushes.kicks(push.traces[s.full]) for s in own if s.full in push.traces}
        if push is not None
        else {}
    )
    found = {}
    for signal in own:
        guess = guesses[signal.full]
        alone = signal.axis is None or sensor_of(signal.message) not in turning
        on_hub = guess.quantity is Quantity.HUB_ACCELERATION
        on_body = guess.quantity is Quantity.BODY_ACCELERATION and alone
        if is_body(f"{signal.layout.name} {signal.message}") or not (on_hub or on_body):
            continue
        others = [each for name, each in kicks.items() if name != signal.full]
        place = pushed_corner(kicks[signal.full], others) if signal.full in kicks else None
        if place is not None:
            ask = f"its name says {guess.corner}: are plugs swapped?"
            ask = ask if guess.corner not in (None, place[0]) else guess.ask
            why = f"{guess.why}; shaken most by the kick at {place[0]}"
            found[signal.full] = replace(
                guess, quantity=Quantity.HUB_ACCELERATION, corner=place[0], why=why, ask=ask
            )
        elif on_body and not guess.ask:
            found[signal.full] = replace(guess, ask=ON_HUB)
    return found


def _turns_too(signal: _Signal) -> bool:
    return signal.kind in ("rad/s", "rad/s2")


def _travels(
    lengths: Sequence[_Signal], guesses: Mapping[str, Guess], push: Push | None
) -> dict[str, Guess]:
    """Return suspension travels with corners and signs: from pushes, or else the order of ids."""
    peaks = (
        {s.full: push.pushes.peaks(push.traces[s.full]) for s in lengths if s.full in push.traces}
        if push is not None
        else {}
    )
    found = {}
    for signal in lengths:
        own = peaks.get(signal.full)
        others = [each for name, each in peaks.items() if name != signal.full]
        place = pushed_corner(own, others) if own else None
        if place is not None:
            why = f"unit {signal.layout.unit}, moved most by the push on {place[0]}"
            guess = Guess(Quantity.SUSPENSION_TRAVEL, place[0], place[1], why, is_proven=True)
            said = guesses[signal.full].corner
            if said is not None and said is not place[0]:
                guess = replace(guess, ask=f"its name says {said}: are plugs swapped?")
            found[signal.full] = guess
    open_ = [s for s in lengths if s.full not in found and guesses[s.full].corner is None]
    if len(open_) == len(ORDER) and not found:
        for signal, corner in zip(open_, ORDER, strict=True):
            ask = "its corner is by the order of sensors: push the car there, and see"
            why = f"unit {signal.layout.unit}, a travel by its name"
            found[signal.full] = Guess(Quantity.SUSPENSION_TRAVEL, corner, 1, why, ask)
    found |= {s.full: guesses[s.full] for s in lengths if s.full not in found}
    return {s.full: _with_tare(found[s.full], s) for s in lengths}


def _with_tare(guess: Guess, signal: _Signal) -> Guess:
    if guess.quantity is not Quantity.SUSPENSION_TRAVEL or signal.level is None:
        return guess
    si = to_si(signal.layout.unit)
    return replace(guess, tare=guess.sign * (si.factor * signal.level + si.offset))
