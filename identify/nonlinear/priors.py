"""Weak priors of the elements, which keep them near zero where a test is poor: no car exceeds them.

For the numbers, they replace the choice of terms: a term that is dropped because it does not show
yet biases the others, whereas a term under a weak prior only widens their intervals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..fit.grey_box import CROSS_SCALE_KG
from .car import Model

_PROGRESSION_1_M = 2.5
"""Standard deviation of k_2/k_s and of the tyre's beta, 1/m: 25 % more stiffness after 5 and 10
cm."""
_CUBIC_1_M2 = 60.0
"""Standard deviation of k_3/k_s, 1/m2: 45 % more stiffness after 5 cm."""
_SIDES, _KNEE, _FAST_KNEE = 2.0, 0.7, 0.25
"""Standard deviation of a damper's change of slope over its coefficient: at rest, up to
`_FAST_M_S`, beyond it.

A curve that falls as the speed grows feeds energy into the car and has no finite path on a mount:
where few samples are that fast, these priors keep it from falling."""
_FAST_M_S = 0.2
_TYRE_DAMPING = 0.2
"""Standard deviation of a tyre's damping, over the damper's coefficient."""
_SPLIT = 0.3
"""Standard deviation of the relative difference of the dampers of an axle."""
_FRICTION_SPLIT_N = 30.0
_CORNER_SPLIT = 0.03
"""Standard deviation of half the difference of an axle's springs, tyres and wheels, over their
mean."""
_CG_M = 0.03
_CROSS = 0.1
"""Standard deviation of the cross weight, over a wheel's mean share of the body."""
_MOUNT_M_N = 3e-6
"""Standard deviation of a mount's compliance, m/N: the softest mounts of cars have 3e5 N/m."""


def weak_priors(
    model: Model, eta: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and standard deviation of each unknown, (P,), for a car about as at `eta`."""
    full = model.box.full(eta[: model.first].astype(complex)).real
    k_s, c_s = (
        float(np.exp(np.mean(np.log(full[7:11])))),
        float(np.exp(np.mean(np.log(full[15:19])))),
    )
    size = {
        "k_2": _PROGRESSION_1_M * k_s,
        "k_3": _CUBIC_1_M2 * k_s,
        "b_t": _PROGRESSION_1_M,
        "s_c": _SPLIT,
        "dF_": _FRICTION_SPLIT_N,
        "dk_": _CORNER_SPLIT,
        "dm_": _CORNER_SPLIT,
        "s_m": _MOUNT_M_N,
        "k_b": 6.0 * k_s,
    }
    own = [e.prior for e in model.elements]
    for i, e in enumerate(model.elements):
        kind = next((k for k in size if e.name.startswith(k)), None)
        if kind is not None:
            own[i] = size[kind] / e.scale
    for axle in "fr":
        for j, knot in enumerate(model.knots, start=1):
            share = _SIDES if knot == 0.0 else _KNEE if abs(knot) < _FAST_M_S else _FAST_KNEE
            at = model.names.index(f"h_{axle}{j}") - model.first
            own[at] = share * c_s / model.elements[at].scale
    box = model.box.prior_sigma.copy()
    for i, name in enumerate(model.box.parameters):
        if name.startswith("c_t"):
            box[i] = _TYRE_DAMPING * c_s / 100.0
        elif name == "y_s":
            box[i] = _CG_M / 0.1
    if "cross weight" in model.names:
        box[-1] = _CROSS * full[0] / 4.0 / CROSS_SCALE_KG
    centre = np.concatenate([np.zeros(model.first), [e.unknown(e.rest) for e in model.elements]])
    return centre, np.concatenate([box, own])
