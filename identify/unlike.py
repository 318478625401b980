"""Names what the sessions of a comparison state differently although a car has only one of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot

from daq.channels import AT_CORNER, ON_BODY, Channel
from daq.vehicle import FactQuantity

from .identification import Identification

EXACT_M = 0.001
"""Difference of two lengths that is never reported, m: a tape measure shows no less."""
SIGMAS = 3.0
"""Difference of two lengths that their stated uncertainties explain, in standard deviations."""
_LENGTHS = {
    FactQuantity.WHEELBASE: "wheelbase",
    FactQuantity.FRONT_TRACK: "front track",
    FactQuantity.REAR_TRACK: "rear track",
}


@dataclass(frozen=True, slots=True)
class _Stated:
    """A statement of one session, such as a length."""

    text: str
    lengths_m: tuple[float, ...] = ()
    """Compared as numbers; if there are none, the text is compared."""
    sigma_m: float = 0.0

    def agrees(self, other: _Stated) -> bool:
        """Return whether both can be true of one car."""
        if not self.lengths_m or len(self.lengths_m) != len(other.lengths_m):
            return self.text == other.text
        limit_m = max(EXACT_M, SIGMAS * hypot(self.sigma_m, other.sigma_m))
        pairs = zip(self.lengths_m, other.lengths_m, strict=True)
        return all(abs(a - b) <= limit_m * (1.0 + 1e-9) for a, b in pairs)


def stated_unlike(labels: Sequence[str], results: Sequence[Identification]) -> tuple[str, ...]:
    """Return one text for each statement in which sessions differ, such as the vehicle's name.

    Loads and masses are not compared: they may change between two campaigns.  What only one session
    states differs from nothing.
    """
    each = [_statements(result) for result in results]
    subjects = dict.fromkeys(subject for own in each for subject in own)
    texts = []
    for subject in subjects:
        kinds: list[tuple[_Stated, list[str]]] = []
        for label, own in zip(labels, each, strict=True):
            if subject not in own:
                continue
            stated = own[subject]
            for first, like in kinds:
                if stated.agrees(first):
                    like.append(label)
                    break
            else:
                kinds.append((stated, [label]))
        if len(kinds) > 1:
            parts = (f"{stated.text} in {', '.join(like)}" for stated, like in kinds)
            texts.append(f"{subject} {'; '.join(parts)}")
    return tuple(texts)


def _statements(result: Identification) -> Mapping[str, _Stated]:
    found: dict[str, _Stated] = {}
    if result.vehicle:
        found["vehicle"] = _Stated(result.vehicle)
    if result.estimation is None:
        return found
    box = result.estimation.box
    if (known := box.geometry) is not None:
        whole = {"wheelbase": known.a + known.b, "front track": 2 * known.t_f}
        whole["rear track"] = 2 * known.t_r
        found |= {name: _length(value_m, 0.0) for name, value_m in whole.items()}
    for fact in box.facts:
        if fact.quantity in _LENGTHS:
            found[_LENGTHS[FactQuantity(fact.quantity)]] = _length(fact.value, fact.sigma)
    for channel in (c for group in box.groups for c in group.channels):
        if channel.quantity in AT_CORNER | ON_BODY:
            found[f"place of {channel.name}"] = _place(channel)
    return found


def _length(value_m: float, sigma_m: float) -> _Stated:
    return _Stated(f"{value_m:.4g} m", (value_m,), sigma_m)


def _place(channel: Channel) -> _Stated:
    if channel.quantity in AT_CORNER:
        return _Stated(str(channel.corner))
    if channel.at_cg:
        return _Stated("at the CG")
    place_m = (channel.x_m, channel.y_m)
    return _Stated(f"({channel.x_m:g}, {channel.y_m:g}) m", place_m, channel.position_sigma_m)
