"""Lift-off: a wheel that leaves the road during the free decay.

The fitted motion tells how far each tyre is relieved.  A tyre can only push; where the linear model
has it pull, the wheel was in the air and the model does not hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import Corner

from ..decay import FreeDecay
from ..estimation import Estimation
from ..model import N_DOF, PhysicalModel, loaded_model
from ..projection import Point, linear_part, point
from .finding import Finding, Verdict
from .places import listed

GRAVITY_M_S2 = 9.80665
PULL_LIMIT = 0.1
"""Share of the static load that a tyre may seem to pull.  The start of the decay lies up to one
sample before the first that is fitted, and in that time a landing tyre gains as much."""
_SURE = 3.0  # standard deviations
_STEP_S = 1e-3
_LONGEST_S = 1.0  # wheels that have not lifted by then will not


@dataclass(frozen=True, slots=True)
class _Lift:
    """The least load of a wheel in a run, and its static load, N."""

    place: str
    load_n: float
    static_n: float


def lift_off_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Find the wheels whose tyres would have to pull during a decay.

    Parameters
    ----------
    estimation : Estimation
        The fit; tyre loads follow from its parameters and the fitted initial state of each run.
    """
    lifts = sorted(_lifts(estimation), key=lambda lift: lift.load_n)
    if not lifts:
        return ()
    long = [lift for lift in lifts if lift.load_n < -PULL_LIMIT * lift.static_n]
    worst = (long or lifts)[0]
    facts = (
        f"{worst.load_n:.0f} N (at rest {worst.static_n:.0f} N): "
        f"{listed(lift.place for lift in long or lifts)}"
    )
    if long:
        text = (
            f"tyre load below zero in the fitted decay, down to {facts}; the wheel was in the air, "
            "where the linear model does not hold: use a lower bump"
        )
        return (Finding("lift_off", Verdict.DOUBTFUL, text),)
    text = (
        f"a wheel just lands as the decay begins, tyre load {facts}; harmless if nothing else is "
        "found, a lower bump is safer"
    )
    return (Finding("lift_off", Verdict.OK, text),)


def _lifts(estimation: Estimation) -> Iterator[_Lift]:
    box, eta = estimation.box, estimation.fit.eta
    full = box.full(eta.astype(complex)).real
    tyres = full[11:15]
    present = {decay.mass_state for decay in estimation.decays}
    for state in box.mass_states:
        if state.name not in present:
            continue
        static = static_loads_n(loaded_model(full, state.added), tyres)
        at = point(box, eta, state.name, estimation.noise)
        for decay in estimation.decays:
            if decay.mass_state == state.name:
                least, sigma = least_loads_n(at, decay, static, tyres)
                for corner in Corner:
                    i = corner.position
                    if least[i] < -_SURE * sigma[i]:
                        place = f"wheel {corner} in {decay.label}"
                        yield _Lift(place, float(least[i]), float(static[i]))


def static_loads_n(model: PhysicalModel, tyre_n_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the load under each wheel at rest on a flat road, (4,) N.

    Gravity acts as if everything were accelerated upwards by g, so its forces are a column of the
    mass matrix, added weights included; the springs share them out.
    """
    heave = np.concatenate([[1.0, 0.0, 0.0], np.ones(4)])
    sunk = np.linalg.solve(model.K, GRAVITY_M_S2 * (model.M @ heave))
    return np.asarray(tyre_n_m * sunk[3:])


def least_loads_n(
    at: Point, decay: FreeDecay, static_n: NDArray[np.float64], tyre_n_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least load of each wheel and its standard deviation by the noise, (4,) N each."""
    linear = linear_part(at, decay)
    last_s = max(float(r.time_s[-1]) for r in decay.recordings)
    time = np.arange(0.0, min(last_s, _LONGEST_S), _STEP_S)
    modes = at.modes
    state = linear.solution[: 2 * N_DOF]
    wave = np.exp(np.multiply.outer(time, modes.poles))
    wheels = slice(3, N_DOF)
    heave = ((wave * (modes.W @ state)) @ modes.V[wheels].T).real
    load = static_n - tyre_n_m * heave
    lowest = load.argmin(axis=0)
    # Heave of each wheel at its lowest load, by the initial state.
    rows = tyre_n_m[:, None] * ((modes.V[wheels] * wave[lowest]) @ modes.W).real
    covariance = linear.normal_inverse[: 2 * N_DOF, : 2 * N_DOF]
    return load.min(axis=0), np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows))
