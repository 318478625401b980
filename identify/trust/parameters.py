"""Whether the parameters are determined, plausible, and in keeping with what was stated."""

from __future__ import annotations

import numpy as np

from ..derived import derived_quantities
from ..estimation import Estimation
from ..greybox import SIGNED
from ..uncertainty import estimates
from .finding import Finding, Verdict

LARGEST_SHARE = 0.25
"""A standard deviation beyond this share of the value says nothing about the parameter."""
DOUBTFUL_SHARE = 0.025
"""Beyond this one the 95 % interval is wider than 5 % to either side."""
_PRIOR_SIGMAS = 4.0
_PLAUSIBLE = {
    "dynamic_index": (0.5, 1.6),
    "front_ride_damping_ratio": (0.03, 1.2),
    "rear_ride_damping_ratio": (0.03, 1.2),
    "front_ride_frequency": (0.5, 5.0),
    "rear_ride_frequency": (0.5, 5.0),
    "front_wheel_hop_frequency": (5.0, 30.0),
    "rear_wheel_hop_frequency": (5.0, 30.0),
}
"""Road vehicles lie well inside; a result outside has a wrong scale or unit somewhere."""


def undetermined(estimation: Estimation) -> tuple[str, ...]:
    """Return the parameters that the data do not determine."""
    found = estimates(estimation.box, estimation.fit)
    return tuple(
        name
        for name, e in found.items()
        if not (e.std <= LARGEST_SHARE * abs(e.value) or (name in SIGNED and np.isfinite(e.std)))
    )


def parameter_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Judge what the fit says of the parameters.

    Parameters
    ----------
    estimation : Estimation
        At its optimum.
    """
    vague = undetermined(estimation)
    if vague:
        text = (
            f"these runs do not determine {', '.join(vague)}: record bounce, pitch and roll (warp "
            "helps most) in both mass states, with sensors on body and wheels"
        )
        return (Finding("undetermined", Verdict.REFUSED, text),)
    return (*_wide(estimation), *_implausible(estimation), *_contradicted(estimation))


def _wide(estimation: Estimation) -> tuple[Finding, ...]:
    found = estimates(estimation.box, estimation.fit)
    wide = {
        name: e.std / abs(e.value)
        for name, e in found.items()
        if name not in SIGNED and e.std > DOUBTFUL_SHARE * abs(e.value)
    }
    if not wide:
        return ()
    worst = max(wide, key=lambda name: wide[name])
    text = (
        f"wide intervals: {', '.join(wide)} (worst {worst} ± {196 * wide[worst]:.0f} %): add "
        "runs, a warp run first, weights on the hubs, or scales as facts"
    )
    return (Finding("wide", Verdict.DOUBTFUL, text),)


def _implausible(estimation: Estimation) -> tuple[Finding, ...]:
    full = estimation.box.full(estimation.fit.eta.astype(complex))
    values = derived_quantities(full)
    odd = []
    for name, (low, high) in _PLAUSIBLE.items():
        value = float(values[name][0].real)
        if not low < value < high:
            odd.append(f"{name} {value:.3g} (usual {low:g} .. {high:g})")
    for name, e in estimates(estimation.box, estimation.fit).items():
        if name in ("k_af", "k_ar", "c_tf", "c_tr") and e.value < -3.0 * e.std:
            odd.append(f"{name} {e.value:.3g} below zero")
    if not odd:
        return ()
    text = f"no usual vehicle: {'; '.join(odd)}: check weights, units and positions"
    return (Finding("implausible", Verdict.DOUBTFUL, text),)


def _contradicted(estimation: Estimation) -> tuple[Finding, ...]:
    """Name facts and stated places, delays and weights that the runs contradict."""
    box, eta = estimation.box, estimation.fit.eta
    misfits, _ = box.fact_misfits(eta)
    odd = [
        f"{fact.quantity} = {fact.value:g} ± {fact.sigma:g} by {misfit:+.1f} sigma"
        for fact, misfit in zip(box.facts, misfits.tolist(), strict=True)
        if abs(misfit) > _PRIOR_SIGMAS
    ]
    odd += [
        f"{label} by {pull:+.1f} sigma"
        for label, pull in zip(box.corrections, box.pulls(eta).tolist(), strict=True)
        if abs(pull) > _PRIOR_SIGMAS
    ]
    if not odd:
        return ()
    text = f"the runs contradict what is stated: {'; '.join(odd)}: measure it again"
    return (Finding("contradiction", Verdict.DOUBTFUL, text),)
