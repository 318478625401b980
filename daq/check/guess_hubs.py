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
    on_hubs = {}
    for (_, corner), group in groups.items():
        accelerations = [signal for signal in group if signal.kind == "m/s2"]
        gravity_g = {}
        for signal in accelerations:
            if signal.level is not None:
                unit = guesses[signal.full].unit or signal.layout.unit
                gravity_g[signal.full] = signal.level * to_si(unit).factor / G_M_S2
        if corner is None or not gravity_g or max(map(abs, gravity_g.values())) > _NO_GRAVITY_G:
            continue
        for signal in accelerations:
            vertical = signal.axis == "z" or (signal.axis is None and len(accelerations) == 1)
            names = f"{signal.layout.name} {signal.message}"
            if signal.full in gravity_g and vertical and not is_body(names):
                why = (
                    f"reads {gravity_g[signal.full]:+.2f} g at rest; vertical and {corner} by name"
                )
                ask = "it reads no gravity: is it AC-coupled, and does it point up?"
                hub = Quantity.HUB_ACCELERATION
                on_hubs[signal.full] = Guess(
                    hub, corner, 1, why, ask, unit=guesses[signal.full].unit
                )
    return on_hubs


def hubs(
    groups: Mapping[tuple[str, Corner | None], Sequence[Candidate]], guesses: Mapping[str, Guess]
) -> dict[str, Guess]:
    """Return accelerations of which the user is asked whether they are on a hub.

    Those without gyroscopes in their sensor whose name states no place.
    """
    accelerations = [s for group in groups.values() for s in group if s.kind == "m/s2"]
    turning = {
        sensor
        for (sensor, _), group in groups.items()
        if any(signal.kind in ("rad/s", "rad/s2") for signal in group)
    }
    asked = {}
    for signal in accelerations:
        guess = guesses[signal.full]
        alone = signal.axis is None or sensor_of(signal.message) not in turning
        on_body = guess.quantity is Quantity.BODY_ACCELERATION and alone
        if on_body and not guess.ask and not is_body(f"{signal.layout.name} {signal.message}"):
            asked[signal.full] = replace(guess, ask=_ON_HUB, asked=Asked.CORNER)
    return asked
