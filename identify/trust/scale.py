"""Judges the source of the scale of all masses: free decays determine ratios only."""

from __future__ import annotations

from daq.vehicle import FactQuantity
from dbc.finding import Finding, Severity

from ..fit.grey_box import GreyBox

_LENGTHS = {
    FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK,
    "a", "b", "t_f", "t_r", "y_s",
}  # fmt: skip
"""Facts that do not depend on the scale."""


def scale_facts(box: GreyBox) -> tuple[str, ...]:
    """Return the stated facts that fix the scale: loads, or a spring that was measured."""
    return tuple(fact.quantity for fact in box.facts if fact.quantity not in _LENGTHS)


def scale_findings(box: GreyBox) -> tuple[Finding, ...]:
    """Return a finding where the scale rests on the added weights alone.

    `box`: structure of a problem that the runs determine.
    """
    if scale_facts(box):
        return ()
    text = (
        "the scale rests on the added weights alone: if all of them are 10 % off, so are all "
        "masses, inertias, stiffnesses and dampers, and no fit shows it; weigh the car as a check"
    )
    return (Finding("scale", Severity.NOTE, text),)
