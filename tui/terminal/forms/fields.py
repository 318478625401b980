"""Forms as data: fields, limits, and the reasons of the limits.

Values are the text that a person typed.  Checking never changes them, and every error names the
field, the limit and the reason.  The forms are in `tui.terminal.forms.vehicle_form` and
`tui.terminal.forms.weight_form`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Values = Mapping[str, str]
YES, NO = "yes", "no"


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a form."""

    name: str
    """Key of the value."""
    label: str
    """Label on the screen."""
    unit: str = ""
    """Unit of a number; empty for text."""
    low: float = -math.inf
    high: float = math.inf
    """Limits of a number; `high` is included, and `low` too unless `above_low`."""
    reason: str = ""
    """Reason of the limits."""
    help: str = ""
    """Help text on what to enter."""
    needed: bool = False
    """True if the field must not stay empty."""
    choices: tuple[str, ...] = ()
    """The values to choose from; empty for free text."""
    whole: bool = False
    """True for a whole number."""
    most: int = 60
    """Largest number of characters of a text."""
    above_low: bool = False
    """True if a number must be above `low`; False if it may equal it."""

    @property
    def is_number(self) -> bool:
        """True if the value is a number."""
        return bool(self.unit)

    @property
    def limit(self) -> str:
        """The limits in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if not self.is_number:
            return f"{'1' if self.needed else '0'} to {self.most} characters"
        kind = "a whole number " if self.whole else ""
        low = f"above {self.low:g}, up" if self.above_low else f"{self.low:g}"
        return f"{kind}{low} to {self.high:g} {self.unit}".strip()

    @property
    def advice(self) -> str:
        """Help on the entry, its limits, and the keys that change a choice."""
        keys = "; left and right change it" if self.choices else ""
        return f"{self.help} ({self.limit}{keys})"


@dataclass(frozen=True, slots=True)
class FieldError:
    """An error in a field: its name and label, the limit, and the reason."""

    field: str
    label: str
    limit: str
    reason: str

    def __str__(self) -> str:
        """Return the error as one line."""
        return f"{self.label}: {self.reason} (limit: {self.limit})"


def check_fields(fields: Sequence[Field], values: Values) -> tuple[FieldError, ...]:
    """Check each field by itself."""
    return tuple(e for field in fields if (e := _checked(field, values.get(field.name, ""))))


def _checked(field: Field, typed: str) -> FieldError | None:
    def wrong(reason: str) -> FieldError:
        return FieldError(field.name, field.label, field.limit, reason)

    text = typed.strip()
    if not text:
        return wrong("is empty, and is needed") if field.needed else None
    if field.choices:
        return None if text in field.choices else wrong(f"{text!r} is not on the list")
    if not field.is_number:
        if len(text) > field.most:
            return wrong(f"has {len(text)} characters")
        return None if text.isprintable() else wrong("has characters that cannot be printed")
    value = number(text)
    if value is None:
        return wrong(f"{text!r} is not a number")
    if field.whole and value != round(value):
        return wrong(f"{text} is not a whole number")
    if field.above_low and value == field.low:
        return wrong(f"{text} {field.unit} is not above {field.low:g}")
    if not field.low <= value <= field.high:
        side = "below" if value < field.low else "above"
        return wrong(f"{text} {field.unit} is {side} the limit: {field.reason}")
    return None


def number(text: str) -> float | None:
    """Return the typed number, with decimal point or comma; None if it is not a number."""
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in text else None


def stated(typed: str) -> float:
    """Return the number in a field that has been checked."""
    value = number(typed)
    assert value is not None  # check_fields guarantees it
    return value
