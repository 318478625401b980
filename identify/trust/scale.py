"""Judges what no residual shows: the scale of all masses, and sensors that are taken as exact.

Free decays determine ratios of masses only, and a motion that is shown too large looks like one
that is larger.
"""

from __future__ import annotations

from collections.abc import Sequence

from daq.vehicle import FactQuantity, MassState
from dbc.finding import Finding, Severity

from ..fit.grey_box import GreyBox
from .format import listed

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


def weight_findings(mass_states: Sequence[MassState]) -> tuple[Finding, ...]:
    """Return a finding on the added weights whose mass or place is stated without uncertainty."""
    unstated = [
        f"weight {i} of state {state.name}"
        for state in mass_states
        for i, weight in enumerate(state.added.weights, start=1)
        if weight != weight.weighed()
    ]
    if not unstated:
        return ()
    text = (
        f"{listed(unstated)}: stated with ± 0 kg or ± 0 m, but nobody weighs exactly: 0.5 % and "
        "10 mm are assumed; state sigma_kg of the scales and position_sigma_m of the tape measure"
    )
    return (Finding("exact_weights", Severity.NOTE, text),)


def gain_findings(box: GreyBox) -> tuple[Finding, ...]:
    """Return a finding on the channels whose gain is taken as exact."""
    channels = [channel for group in box.groups for channel in group.channels]
    exact = [channel.name for channel in channels if not channel.scale_sigma]
    if not exact:
        return ()
    text = (
        f"no gain_sigma is stated for {listed(exact)}: a sensor that shows 1 % too much can move "
        "half tracks and inertias by 1 to 2 %, more than their intervals, and no fit shows it; "
        "state it from data sheet or calibration"
    )
    return (Finding("gains", Severity.NOTE, text),)
