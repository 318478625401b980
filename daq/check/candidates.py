"""Lists the signals that may be channels, with the facts that names and traffic at rest show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dbc.layout import MessageLayout, SignalLayout
from dbc.units import known_si

from ..channels import sensor_of
from ..vehicle import Corner
from .guess_map import (
    NO_UNIT,
    axis_by_name,
    guess_corner,
    guess_quantity,
    is_no_value,
    kind_by_name,
)
from .propose_message import FEWEST, Seen


@dataclass(frozen=True, slots=True)
class Candidate:
    """A signal that may be a channel."""

    full: str
    """Name with that of its message."""
    message: str
    """Name of its message."""
    layout: SignalLayout
    """Its position in the frame."""
    comment: str
    """Its description in the database."""
    kind: str
    """SI unit of the measured quantity."""
    corner: Corner | None
    """Wheel stated in its name."""
    level: float | None
    """Value at rest, in its own unit."""
    peak: float | None
    """Largest magnitude that was seen, in its own unit."""

    @property
    def axis(self) -> str | None:
        """The axis of the sensor stated in its name."""
        return axis_by_name(self.layout.name, self.comment)


def candidates(
    messages: Sequence[MessageLayout],
    comments: Mapping[tuple[str, int, str], str],
    seen: Seen | None,
) -> list[Candidate]:
    """Return the signals that may be channels; parameters as `daq.check.guess_sensor`."""
    found = []
    for message in messages:
        if seen is not None and message.name not in seen.known:
            continue
        owner = sensor_of(message.name)
        number = message.can_id | message.is_extended << 31
        for signal in message.signals:
            kind = kind_of(message.name, signal)
            if kind not in ("m/s2", "rad/s", "rad/s2", "m") or is_no_value(signal.name):
                continue
            full = f"{message.name}.{signal.name}"
            comment = comments.get((owner, number, signal.name), "")
            level = peak = None
            if seen is not None:
                _, value = seen.good(full)
                if len(value) >= FEWEST:
                    level, peak = float(np.median(value)), float(np.abs(value).max())
            corner = guess_corner(signal.name, message.name, comment)
            place = corner[0] if corner else None
            found.append(Candidate(full, message.name, signal, comment, kind, place, level, peak))
    return found


def shows_push_by_unit(message: str, signal: SignalLayout) -> bool:
    """Return whether a push by hand moves this kind of signal: a rate of turn, or a length."""
    kind = kind_of(message, signal)
    return kind == "rad/s" or (
        kind == "m"
        and (signal.unit in NO_UNIT or guess_quantity(message, signal, "", None) is not None)
    )


def kind_of(message: str, signal: SignalLayout) -> str | None:
    """Return the SI unit of the quantity that a signal measures; None if it is not known."""
    known = known_si(signal.unit)
    if known is None:
        return None
    return kind_by_name(message, signal) if known.unit == "1" else known.unit
