"""Parameters that are undetermined, implausible, or at odds with what was stated."""

from __future__ import annotations

import numpy as np

from dbc.finding import Finding, Severity

from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED
from ..fit.uncertainty import estimates
from ..model.derived import derived_quantities

DOUBTFUL_SHARE = 0.025
"""Beyond this one the 95 % interval is wider than 5 % to either side."""
_PRIOR_SIGMAS = 4.0
_LEAST_REDUNDANCY = 1e-5
"""Share of a fact's variance that other data must leave to it; the fit is no more exact."""
_REFUSED_SHIFT = 0.1
"""Relative change of a parameter by a fact that is contradicted, from which on none is used."""
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
    """Return the parameters that the data must determine and do not.

    What may be zero (a bar, tyre damping) may stay open, as long as its variance is finite: it is
    printed as not determined, and the others hold.
    """
    found = estimates(estimation.box, estimation.fit)
    return tuple(
        name
        for name, e in found.items()
        if not e.determined and (name not in SIGNED or not np.isfinite(e.std))
    )


def parameter_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Judge what the fit says of the parameters."""
    vague = undetermined(estimation)
    if vague:
        text = (
            f"these runs do not determine {', '.join(vague)}: record bounce, pitch and roll (warp "
            "helps most) in both mass states, with sensors on body and wheels"
        )
        return (Finding("undetermined", Severity.ERROR, text),)
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
    return (Finding("wide", Severity.WARNING, text),)


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
    return (Finding("implausible", Severity.WARNING, text),)


def _contradicted(estimation: Estimation) -> tuple[Finding, ...]:
    """Name facts and stated places, delays and weights that the runs contradict.

    One that is stated with great certainty drags the fit along and lies close to it.  So its misfit
    is judged by the standard deviation of the misfit (Baarda 1968), which is smaller than its own
    by what the fit owes to it; what the fit owes to it alone cannot be contradicted.
    """
    box, eta, C = estimation.box, estimation.fit.eta, estimation.fit.covariance
    misfits, slopes = box.fact_misfits(eta)
    n, pulls = len(box.parameters), box.pulls(eta)
    stated = np.zeros((len(pulls), len(eta)))  # elements may follow the unknowns of the grey box
    stated[np.arange(len(pulls)), n + np.arange(len(pulls))] = (
        1.0 / box.prior_sigma[n : n + len(pulls)]
    )
    labels = [f"{fact.quantity} = {fact.value:g} ± {fact.sigma:g}" for fact in box.facts]
    rows, left = np.vstack([slopes, stated]), np.concatenate([misfits, -pulls])
    owed = np.einsum("ip,pq,iq->i", rows, C, rows)
    spread = np.sqrt(np.maximum(1.0 - owed, _LEAST_REDUNDANCY))
    size = np.abs(left) / spread * (1.0 - owed > _LEAST_REDUNDANCY)
    odd = np.flatnonzero(size > _PRIOR_SIGMAS)
    if not len(odd):
        return ()
    loose = [i for i, name in enumerate(box.parameters) if name not in SIGNED]
    moved = float(np.max(np.abs(C[loose] @ (rows * (left / spread**2)[:, None])[odd].T)))
    named = [f"{(*labels, *box.corrections)[i]} by {size[i]:.1f} sigma" for i in odd]
    text = (
        f"the runs contradict what is stated: {'; '.join(named)} (limit {_PRIOR_SIGMAS:g}; moves a "
        f"parameter by about {min(moved, 1.0) * 100:.1f} %): measure it again"
    )
    severity = Severity.ERROR if moved > _REFUSED_SHIFT else Severity.WARNING
    return (Finding("contradiction", severity, text),)
