"""Writes the proposed tables that bench.toml and channel map share."""

from __future__ import annotations

import json
from collections.abc import Sequence

from dbc.errors import printable

from ..channels import AT_CORNER, ON_BODY, Quantity
from .guess_map import Guess
from .result import ASK

REST = """
[vehicle]
name = "vehicle"  # FILL IN

[campaign]
excitations = ["bounce", "pitch", "roll"]  # also "rear_pitch", "warp"
repeats = 2
method = "roll_over"  # or "drop", "push"
bump_height_mm = 40.0

[trigger]
level = 3.0  # m/s2 from rest, on any hub
post_s = 2.5  # until the motion has decayed

# The known weights of the state "added": a table for each, on the floor or on a hub.
# [[weight]]  # FILL IN
# mass_kg = 32.5
# x_m = 0.14  # from the middle of the front axle, forward positive
# y_m = 0.55  # left positive
# position_sigma_m = 0.005  # how well you measured its place

# [[weight]]  # FILL IN
# mass_kg = 4.0
# hub = "FL"

# With scales under the wheels there need not be any.
# [[fact]]
# quantity = "total_mass_kg"
# value = 1551.8
# sigma = 1.0""".splitlines()
"""Tables on vehicle, campaign, trigger and weights, for the user to fill in."""
_BY_GRAVITY = frozenset({Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION})


def unique_name(signal: str, message: str, sensor: str, used: set[str]) -> str:
    """Return a channel name: letters, digits and underscores, not used before."""
    plain = (
        "".join(c if c.isascii() and c.isalnum() else "_" for c in signal).strip("_") or "signal"
    )
    name = plain if plain[0].isalpha() else f"s_{plain}"
    long = message.replace(".", "_")
    first = f"{sensor}_{name}" if sensor else name
    tried = [first[:60], f"{long}_{name}"[:60], *(f"{name[:55]}_{i}" for i in range(2, 1000))]
    chosen = next(t for t in tried if t not in used and t[0].isalpha())
    used.add(chosen)
    return chosen


def channel_table(name: str, signal: str, guess: Guess, late: Sequence[str]) -> list[str]:
    """Return a `[[channel]]` table with uncertain guesses marked; `late`: its lines on delay."""
    lines = [
        "",
        "[[channel]]",
        f'name = "{name}"',
        f"signal = {json.dumps(signal)}",
        f'quantity = "{guess.quantity}"  # {printable(guess.why, 200)}',
    ]
    if guess.ask:
        lines.append(f"{ASK}{printable(guess.ask, 200)}")
    if guess.unit:
        lines.append(f'signal_unit = "{guess.unit}"  # none is stated')
    if guess.quantity in AT_CORNER:
        lines.append(f'corner = "{guess.corner}"')
    if guess.sign < 0:
        reason = "  # reads -1 g at rest" if guess.quantity in _BY_GRAVITY else ""
        lines.append(f"sign = -1{reason}")
    if guess.quantity in ON_BODY:
        lines += [
            "x_m = -1.2  # FILL IN: from the middle of the front axle, forward positive",
            "y_m = 0.0  # FILL IN: left positive",
            "position_sigma_m = 0.5  # FILL IN: how well you measured it",
        ]
    if guess.quantity is not Quantity.UNUSED:
        lines += ["gain_sigma = 0.01  # of its scale: see its data sheet or calibration", *late]
    if guess.tare is not None:
        lines.append(f"tare = {guess.tare:.5g}  # at rest, as the car stood")
    if guess.quantity is Quantity.SUSPENSION_TRAVEL and not guess.is_proven:
        lines.append("# sign = -1  # FILL IN if it reads less in compression")
    return lines
