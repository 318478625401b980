"""The permitted axle loads of the car, and a check of the weights against them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from daq import InputError

from ..state.drafts import read_draft, write_draft
from .fields import FieldError, number

_FILE = "axle_limits.json"
"""File in the recorder's folder; each vehicle has its own."""
_LEAST_KG, _MOST_KG = 100.0, 10_000.0
_AXLES = ("front", "rear")


@dataclass(frozen=True, slots=True)
class AxleLimits:
    """The largest permitted load of each axle, kg."""

    front_kg: float
    rear_kg: float


def parse_limits(text: str) -> AxleLimits:
    """Return the limits from two typed numbers.

    Raises InputError if they are not.
    """
    loads = [number(word) for word in text.replace("/", " ").split()]
    if len(loads) != len(_AXLES) or not all(t and _LEAST_KG <= t <= _MOST_KG for t in loads):
        advice = "type two numbers in kg, front and rear, as 1050 980 (100 to 10000)"
        raise InputError("axle limits", f"'{text}' is not a pair of loads", advice)
    return AxleLimits(*(t for t in loads if t))


def read_limits(folder: Path) -> AxleLimits | None:
    """Return the stored limits; None if there are none."""
    stored = read_draft(folder / _FILE)
    try:
        return parse_limits(f"{stored.get('front_kg')} {stored.get('rear_kg')}")
    except InputError:
        return None


def keep_limits(folder: Path, limits: AxleLimits) -> str:
    """Store the limits for the next start; return the reason if that failed, else ""."""
    return write_draft(folder / _FILE, asdict(limits))


def check_axles(loads_kg: Sequence[float], limits: AxleLimits | None) -> tuple[FieldError, ...]:
    """Return an error for each axle that would carry more than permitted."""
    if limits is None:
        return ()
    return tuple(
        FieldError("mass_kg", "Mass", f"{limit:g} kg on the {name} axle", reason)
        for name, load, limit in zip(_AXLES, loads_kg, asdict(limits).values(), strict=True)
        if load > limit
        for reason in (f"the {name} axle carries {load:.0f} kg with the weights",)
    )


def axles_line(loads_kg: Sequence[float], total_kg: float, limits: AxleLimits | None) -> str:
    """Return the axle loads and their limits as text."""
    front, rear = (f"{load:.0f}" for load in loads_kg)
    if limits is None:
        return f"front {front} kg, rear {rear} kg (the car alone {total_kg:.0f} kg)   L = limits"
    return f"front {front} of {limits.front_kg:g} kg, rear {rear} of {limits.rear_kg:g} kg"
