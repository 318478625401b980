"""What the axles of the car may carry, as its papers say, and whether the weights are too much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from daq.errors import InputError

from ..state.drafts import read_draft, write_draft
from .fields import FieldError, number

_FILE = "axle_limits.json"
"""Beside the recording: the next vehicle's are told anew."""
_LEAST_KG, _MOST_KG = 100.0, 10_000.0
_AXLES = ("front", "rear")


@dataclass(frozen=True, slots=True)
class AxleLimits:
    """The largest permitted load of each axle, kg."""

    front_kg: float
    rear_kg: float


def parse_limits(text: str) -> AxleLimits:
    """Return the limits that were typed as two numbers.

    Raises
    ------
    InputError
        If they are not.
    """
    told = [number(word) for word in text.replace("/", " ").split()]
    if len(told) != len(_AXLES) or not all(t and _LEAST_KG <= t <= _MOST_KG for t in told):
        advice = "type two numbers in kg, front and rear, as 1050 980 (100 to 10000)"
        raise InputError("axle limits", f"'{text}' does not tell them", advice)
    return AxleLimits(*(t for t in told if t))


def read_limits(folder: Path) -> AxleLimits | None:
    """Return the limits that were told before, if any."""
    told = read_draft(folder / _FILE)
    try:
        return parse_limits(f"{told.get('front_kg')} {told.get('rear_kg')}")
    except InputError:
        return None


def keep_limits(folder: Path, limits: AxleLimits) -> str:
    """Keep the limits for the next start; return why that failed, or nothing."""
    return write_draft(folder / _FILE, asdict(limits))


def check_axles(loads_kg: Sequence[float], limits: AxleLimits | None) -> tuple[FieldError, ...]:
    """Say which axle would carry more than it may."""
    if limits is None:
        return ()
    return tuple(
        FieldError("mass_kg", "Mass", f"{limit:g} kg on the {name} axle", reason)
        for name, load, limit in zip(_AXLES, loads_kg, asdict(limits).values(), strict=True)
        if load > limit
        for reason in (f"the {name} axle carries {load:.0f} kg with the weights",)
    )


def axles_line(loads_kg: Sequence[float], total_kg: float, limits: AxleLimits | None) -> str:
    """Return what the axles carry, of what they may."""
    front, rear = (f"{load:.0f}" for load in loads_kg)
    if limits is None:
        return f"front {front} kg, rear {rear} kg (the car alone {total_kg:.0f} kg)   L = limits"
    return f"front {front} of {limits.front_kg:g} kg, rear {rear} of {limits.rear_kg:g} kg"
