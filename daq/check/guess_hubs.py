"""Guesses which accelerations are those of hubs: AC-coupled ones, and those shown by kicks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from dbc.units import G_M_S2, to_si

from ..channels import Quantity
from ..signal_names import sensor_of
from ..vehicle import Corner
from .candidates import Candidate
from .guess_map import Asked, Guess, is_body
from .mounting import pushed_corner
from .pushes import Push

_NO_GRAVITY_G = 0.1
"""Largest reading at rest, g, of an AC-coupled accelerometer."""
ON_HUB = "is it on the body, or on which hub? A kick against each tyre shows it (--push)"


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
    groups: Mapping[tuple[str, Corner | None], Sequence[Candidate]],
    guesses: Mapping[str, Guess],
    push: Push | None,
) -> dict[str, Guess]:
    """Return accelerations with the hubs that kicks against the tyres show.

    The user is asked about an acceleration without gyroscopes in its sensor whose name states no
    place.
    """
    accelerations = [s for group in groups.values() for s in group if s.kind == "m/s2"]
    turning = {sensor for (sensor, _), group in groups.items() if any(_turns_too(s) for s in group)}
    kicks = (
        {
            s.full: push.pushes.kicks(push.traces[s.full])
            for s in accelerations
            if s.full in push.traces
        }
        if push is not None
        else {}
    )
    found = {}
    for signal in accelerations:
        guess = guesses[signal.full]
        alone = signal.axis is None or sensor_of(signal.message) not in turning
        on_hub = guess.quantity is Quantity.HUB_ACCELERATION
        on_body = guess.quantity is Quantity.BODY_ACCELERATION and alone
        names = f"{signal.layout.name} {signal.message}"
        if is_body(names, or_imu=False) or not (on_hub or on_body):
            continue
        others = [each for name, each in kicks.items() if name != signal.full]
        place = pushed_corner(kicks[signal.full], others) if signal.full in kicks else None
        if place is not None:
            ask = f"its name says {guess.corner}: are plugs swapped?"
            ask = ask if guess.corner not in (None, place[0]) else guess.ask
            why = f"{guess.why}; shaken most by the kick at {place[0]}"
            found[signal.full] = replace(
                guess,
                quantity=Quantity.HUB_ACCELERATION,
                corner=place[0],
                why=why,
                ask=ask,
                asked=Asked.CORNER if guess.corner not in (None, place[0]) else guess.asked,
            )
        elif on_body and not guess.ask and not is_body(names):
            found[signal.full] = replace(guess, ask=ON_HUB, asked=Asked.CORNER)
    return found


def _turns_too(signal: Candidate) -> bool:
    return signal.kind in ("rad/s", "rad/s2")
