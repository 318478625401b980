"""Guesses which accelerations are those of hubs: AC-coupled ones; the user is asked for others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from dbc.units import G_M_S2, to_si

from ..channels import Quantity, sensor_of
from ..vehicle import Corner
from .candidates import Candidate
from .guess_map import Asked, Guess, is_body

_NO_GRAVITY_G = 0.1
"""Largest reading at rest, g, of an AC-coupled accelerometer."""
_ON_HUB = "is it on the body, or on which hub?"


def without_gravity(
    groups: Mapping[tuple[str, Corner | None], Sequence[Candidate]], guesses: Mapping[str, Guess]
) -> dict[str, Guess]:
    """Return accelerations at wheels whose sensors read gravity on no axis: AC-coupled sensors.

    A single axis is taken as vertical; of several axes, the one with z in its name.
    """
    found = {}
    for (_, corner), signals in groups.items():
        at_rest = {s.full: _gravity_g(s, guesses[s.full]) for s in signals if s.kind == "m/s2"}
        shown = [g for g in at_rest.values() if g is not None]
        if corner is None or not shown or max(map(abs, shown)) > _NO_GRAVITY_G:
            continue
        for signal in signals:
            vertical = signal.axis == "z" or (signal.axis is None and len(at_rest) == 1)
            names = f"{signal.layout.name} {signal.message}"
            if signal.full in at_rest and vertical and not is_body(names):
                why = f"reads {at_rest[signal.full]:+.2f} g at rest; vertical and {corner} by name"
                ask = "it reads no gravity: is it AC-coupled, and does it point up?"
                unit = guesses[signal.full].unit
                hub = Quantity.HUB_ACCELERATION
                found[signal.full] = Guess(hub, corner, 1, why, ask, unit=unit)
    return found


def _gravity_g(signal: Candidate, guess: Guess) -> float | None:
    if signal.level is None:
        return None
    return signal.level * to_si(guess.unit or signal.layout.unit).factor / G_M_S2


def hubs(
    groups: Mapping[tuple[str, Corner | None], Sequence[Candidate]], guesses: Mapping[str, Guess]
) -> dict[str, Guess]:
    """Return accelerations of which the user is asked whether they are on a hub.

    Those without gyroscopes in their sensor whose name states no place.
    """
    accelerations = [s for group in groups.values() for s in group if s.kind == "m/s2"]
    turning = {sensor for (sensor, _), group in groups.items() if any(_turns_too(s) for s in group)}
    found = {}
    for signal in accelerations:
        guess = guesses[signal.full]
        alone = signal.axis is None or sensor_of(signal.message) not in turning
        on_body = guess.quantity is Quantity.BODY_ACCELERATION and alone
        if on_body and not guess.ask and not is_body(f"{signal.layout.name} {signal.message}"):
            found[signal.full] = replace(guess, ask=_ON_HUB, asked=Asked.CORNER)
    return found


def _turns_too(signal: Candidate) -> bool:
    return signal.kind in ("rad/s", "rad/s2")
