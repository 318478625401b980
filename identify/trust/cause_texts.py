"""Puts the likely cause in words: what the model lacks or which sensor is wrong, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dbc.finding import Finding, Severity

from ..fit.estimation import Estimation
from .cause_ranking import Suspect
from .contradiction import shift_without_scales
from .linear_effects import TURNED, TYRE_DAMPING, WEIGHTS
from .plausibility import BELOW_SIGMAS
from .refit import Explanation, largest_shift
from .scale import scale_facts
from .sensor_faults import gain_of, sensor_explanations
from .swaps import swap_explanation

_MATTERS = 0.02
"""Relative change of a parameter above which an effect makes the result doubtful."""
_REFUSES = 0.10
"""Relative change of a parameter above which the result must not be used."""
_EXPLAINS = 0.35
"""Share of the misfit above which an effect is called its cause."""
_CLEARLY = 0.9
"""Share of the misfit above which no other cause is sought."""
_PRESENT = 0.5
"""Strength above which tyre damping is named: one in a thousand.  Every tyre has some, so that it
needs less proof than a fault."""
_AHEAD = 0.95
"""Share of a sensor's explanation that an effect of the vehicle must reach to be preferred."""

SCALES = "scales off by a common factor"
"""The cause of weights that disagree with the scales if the weights are right."""

_ADVICE = {
    "anti-roll bars": "set anti_roll_bars = true in [vehicle.structure]",
    TYRE_DAMPING: "set tyre_damping = true in [vehicle.structure]",
    "CG off the middle": "set cg_offset = true in [vehicle.structure]",
    "left and right differ": "set symmetric = false in [vehicle.structure]",
    TURNED: "mount it with its x axis along the car, and record again",
    "a length is wrong": "measure the lengths of [vehicle.geometry] again, or leave them out",
    "friction in the suspension": (
        "bump higher, so that friction counts less, or free the suspension; c_s and k_s hold for "
        "this amplitude only"
    ),
    "dampers stronger in rebound than in compression": (
        "the dampers are not linear: c_s is a mean, and the other parameters suffer"
    ),
}


@dataclass(frozen=True, slots=True)
class Causes:
    """The named cause of a misfit, and all causes that were tried."""

    findings: tuple[Finding, ...] = ()
    """Finding on the named cause, if there is one."""
    tried: tuple[Explanation, ...] = ()
    """Every cause that stands out of the noise, with the changes of parameters that it means."""


def wrong_channel_cause(cause: Explanation) -> Causes:
    """Name a channel that is wrong, and refuse the result: its unit or sign can be corrected."""
    return Causes((replace(_finding(cause), severity=Severity.ERROR),), (cause,))


def causes_of(estimation: Estimation, suspects: Sequence[Suspect]) -> Causes:
    """Name the likely cause of a misfit, or an effect that matters although there is no misfit.

    `suspects`: its causes as `rank_causes` has them.
    """
    ranked = [suspect for suspect in suspects if _counts(suspect)]
    tried = tuple(_explanation(estimation, suspect) for suspect in ranked)
    tried += tuple(_scales_instead(estimation, cause) for cause in tried if cause.name == WEIGHTS)
    if ranked or not estimation.holds:
        swap = swap_explanation(estimation)
        if swap is not None:
            return Causes((_swap_finding(swap),), (*tried, swap))
    if not ranked:
        return Causes()
    first = _in_words(estimation, _preferred(ranked))
    if estimation.holds:
        return Causes((_finding(first),), tried)
    found = [first] if first.explained > _EXPLAINS else []
    if first.explained < _CLEARLY:
        suspected = [s.effects[0].label for s in ranked if s.cause.startswith("gain of ")]
        others = sensor_explanations(estimation, suspected)
        tried += tuple(others)
        found += [other for other in others if other.explained * _AHEAD > first.explained]
    return Causes(tuple(_finding(best) for best in found[-1:]), tried)


def _counts(suspect: Suspect) -> bool:
    if suspect.cause != TYRE_DAMPING:
        return suspect.strength > 1.0
    sizes, stds = suspect.score.sizes, suspect.score.stds
    return suspect.strength > _PRESENT and bool(np.all(sizes > -BELOW_SIGMAS * stds))


def _preferred(ranked: list[Suspect]) -> Suspect:
    """Return the strongest cause; lateness of some is preferred to earliness of the others."""
    best = ranked[0].strength
    equal = [s for s in ranked if s.strength > 0.98 * best]
    return max(equal, key=lambda s: ("late" in s.cause and s.score.sizes[0] > 0, s.strength))


def _in_words(estimation: Estimation, suspect: Suspect) -> Explanation:
    cause, sizes = suspect.cause, suspect.sizes
    advice = _ADVICE.get(cause, "")
    if cause == WEIGHTS:
        weights = _explanation(estimation, suspect)
        worse = max(weights, _scales_instead(estimation, weights), key=lambda one: one.shift)
        facts = " and ".join(scale_facts(estimation.box))
        advice = f"weigh them again, or {facts}: one of the two scales shows too much"
        return replace(worse, name=cause, advice=advice)
    if cause.startswith("gain of "):
        found = gain_of(estimation, suspect.effects[0].label)
        sizes, advice = found.sizes, found.advice
    elif cause.endswith(" late"):
        advice = "state delay_s and delay_sigma_s of these channels, or correct their clock"
    return replace(_explanation(estimation, suspect), sizes=sizes, advice=advice)


def _explanation(estimation: Estimation, suspect: Suspect) -> Explanation:
    explained = 0.0 if estimation.holds else suspect.explained
    moved = suspect.moved(estimation.box.parameters)
    shift = (suspect.shift, suspect.shifted, moved)
    return Explanation(suspect.cause, suspect.sizes, "", explained, *shift)


def _scales_instead(estimation: Estimation, weights: Explanation) -> Explanation:
    """Return the other cause of weights that disagree with the scales: the scales are wrong."""
    moved = shift_without_scales(estimation)
    shift, shifted = largest_shift(moved)
    return replace(weights, name=SCALES, shift=shift, shifted=shifted, moved=moved)


def _finding(cause: Explanation) -> Finding:
    severity = Severity.NOTE
    if cause.shift > _MATTERS:
        severity = Severity.ERROR if cause.shift > _REFUSES else Severity.WARNING
    share = f", explains {min(cause.explained, 1.0) * 100:.0f} % of the misfit"
    text = (
        f"likely cause: {cause.name} ({cause.sizes}{share if cause.explained else ''}; moves "
        f"{cause.shifted} by about {min(cause.shift, 1.0) * 100:.1f} %): {cause.advice}"
    )
    return Finding(cause.name.split(" of ")[0].replace(" ", "_"), severity, text)


def _swap_finding(swap: Explanation) -> Finding:
    """Refuse the result even if it moves little: a label can be corrected, and all else is kept."""
    share = f"{min(swap.explained, 1.0) * 100:.0f} %"
    text = f"likely cause: {swap.name} (explains {share} of the misfit): {swap.advice}"
    return Finding("swapped_labels", Severity.ERROR, text)
