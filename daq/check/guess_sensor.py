"""Guesses what the signals of all sensors measure, from names and, with traffic, from physics.

A single signal is guessed from its name.  Three accelerations at rest show how their sensor is
mounted, and so which of its gyroscopes is roll, which is pitch, and their signs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dbc.layout import MessageLayout
from dbc.units import G_M_S2, to_si

from ..channels import Quantity, sensor_of
from ..vehicle import Corner
from .candidates import Candidate, candidates
from .guess_hubs import hubs, without_gravity
from .guess_map import NO_UNIT, Asked, Guess, guess_quantity, is_body, unit_by_gravity, unit_by_peak
from .mounting import AXES, Mounting, axis_of, mounting, pushed_corner, up_axis
from .propose_message import Seen
from .push_test import ORDER
from .pushes import Push

_TILTED_DEG = 5.0
"""Tilt of an IMU from which the user is asked, deg."""


def guess_bench(
    messages: Sequence[MessageLayout],
    comments: Mapping[tuple[str, int, str], str],
    seen: Seen | None,
    push: Push | None,
    forward: Mapping[str, str],
) -> dict[str, Guess]:
    """Return a guess for each signal, by full name, without signals that the method cannot use.

    `comments`: by sensor, identifier and signal.  `seen`: traffic at rest.  `push`: pushes on the
    corners.  `forward`: axis that points forward, as ``-x``, by sensor, if the user states it.
    """
    signals = candidates(messages, comments, seen)
    peaks = [s.peak for s in signals if s.kind == "m" and s.layout.unit in NO_UNIT and s.peak]
    length_unit = unit_by_peak(max(peaks, default=0.0))
    guesses = {s.full: g for s in signals if (g := _alone(s, length_unit)) is not None}
    groups: dict[tuple[str, Corner | None], list[Candidate]] = defaultdict(list)
    for signal in signals:
        groups[sensor_of(signal.message), signal.corner].append(signal)
    for own in groups.values():
        guesses |= _together(own, push, forward.get(sensor_of(own[0].message), ""))
    guesses |= without_gravity(groups, guesses)
    guesses |= hubs(groups, guesses)
    guesses |= _travels([s for s in signals if s.kind == "m" and s.full in guesses], guesses, push)
    return guesses


def _alone(signal: Candidate, length_unit: str) -> Guess | None:
    """Return the guess for a single signal, with its probable unit.

    `length_unit`: unit of all lengths for which none is stated.
    """
    unit = ""
    if signal.layout.unit in NO_UNIT:
        by_kind = {"m/s2": unit_by_gravity(abs(signal.level or 0.0)) or "m/s2", "m": length_unit}
        unit = by_kind.get(signal.kind, "deg/s")
    layout = replace(signal.layout, unit=unit) if unit else signal.layout
    guess = guess_quantity(signal.message, layout, signal.comment, signal.level)
    if guess is None or not unit:
        return guess
    ask = f"no unit is stated: is it {unit}?"
    return replace(guess, unit=unit, ask=ask, asked=Asked.UNIT)


def _together(device: Sequence[Candidate], push: Push | None, forward: str) -> dict[str, Guess]:
    """Return the guesses for the accelerations and rates of one device, from its mounting."""
    accelerations = {s.axis: s for s in device if s.kind == "m/s2" and s.axis is not None}
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
            s.full: Guess(Quantity.UNUSED, None, 1, "tilted", ask, unit=stated)
            for s in accelerations.values()
        }
    rates = {s.axis: s for s in device if s.kind in ("rad/s", "rad/s2") and s.axis is not None}
    turns = _turns(rates, push)
    how = mounting(*up, turns, forward)
    found = _accelerations(accelerations, gravity, how, stated)
    return found | (_rates(rates, how, push is not None) if len(rates) > 1 else {})


def _common_unit(
    accelerations: Mapping[str, Candidate], levels: Mapping[str, float | None]
) -> str | None:
    """Return the unit of three accelerations: the stated one, or the one in which they read 1 g."""
    stated = {s.layout.unit for s in accelerations.values()}
    if len(stated) == 1 and to_si(next(iter(stated))).unit == "m/s2":
        return next(iter(stated))
    size = float(np.linalg.norm([level or 0.0 for level in levels.values()]))
    return unit_by_gravity(size)


def _turns(
    rates: Mapping[str, Candidate], push: Push | None
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
    accelerations: Mapping[str, Candidate], gravity: Mapping[str, float], how: Mounting, unit: str
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
        found[signal.full] = Guess(quantity, corner, sign, f"{why}: vertical", ask, unit=unit)
    return found


def _rates(rates: Mapping[str, Candidate], how: Mounting, were_pushes: bool) -> dict[str, Guess]:
    up, _ = axis_of(how.up)
    forward, _ = axis_of(how.forward)
    directions = {Quantity.ROLL_RATE: how.forward, Quantity.PITCH_RATE: how.left}
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
        proof = "proven" if how.surely_forward else "taken"
        why = f"about {axis}; {forward} is {proof} for the axis along the car; {sense}"
        ask, asked = unknown, Asked.UNIT
        if not how.surely_forward:
            asked = Asked.FORWARD
            ask = f"does the sensor's {_signed(how.forward)} axis point forward?"
            if were_pushes:
                ask += "  The pushes did not show it."
        sign = axis_of(direction)[1]
        found[signal.full] = Guess(
            quantity, None, sign, why, ask, asked, unit, is_proven=how.surely_forward
        )
    return found


def _signed(direction: NDArray[np.float64]) -> str:
    axis, sign = axis_of(direction)
    return f"+{axis}" if sign > 0 else f"-{axis}"


def _travels(
    lengths: Sequence[Candidate], guesses: Mapping[str, Guess], push: Push | None
) -> dict[str, Guess]:
    """Return suspension travels with corners and signs, from pushes or else the order of ids."""
    peaks = (
        {s.full: push.pushes.peaks(push.traces[s.full]) for s in lengths if s.full in push.traces}
        if push is not None
        else {}
    )
    found = {}
    for signal in lengths:
        signal_peaks = peaks.get(signal.full)
        others = [each for name, each in peaks.items() if name != signal.full]
        place = pushed_corner(signal_peaks, others) if signal_peaks else None
        if place is not None:
            named = guesses[signal.full].corner
            unit = guesses[signal.full].unit or signal.layout.unit
            guess = replace(
                guesses[signal.full],
                quantity=Quantity.SUSPENSION_TRAVEL,
                corner=place[0],
                sign=place[1],
                why=f"unit {unit}, moved most by the push on {place[0]}",
                is_proven=True,
            )
            if guess.asked is Asked.WHERE:
                guess = replace(guess, ask="")
            if named is not None and named is not place[0]:
                ask = f"its name says {named}: are plugs swapped?"
                guess = replace(guess, ask=ask, asked=Asked.WHEEL)
            found[signal.full] = guess
    open_ = [s for s in lengths if s.full not in found and guesses[s.full].corner is None]
    if len(open_) == len(ORDER) and not found:
        for signal, corner in zip(open_, ORDER, strict=True):
            ask = "its corner is guessed from the order of sensors: push the car there to check it"
            why = f"unit {signal.layout.unit}, a travel by its name"
            travel = Quantity.SUSPENSION_TRAVEL
            found[signal.full] = Guess(travel, corner, 1, why, ask, Asked.WHEEL)
    found |= {s.full: guesses[s.full] for s in lengths if s.full not in found}
    return {s.full: _with_tare(found[s.full], s) for s in lengths}


def _with_tare(guess: Guess, signal: Candidate) -> Guess:
    if guess.quantity is not Quantity.SUSPENSION_TRAVEL or signal.level is None:
        return guess
    si = to_si(guess.unit or signal.layout.unit)
    return replace(guess, tare=guess.sign * (si.factor * signal.level + si.offset))
