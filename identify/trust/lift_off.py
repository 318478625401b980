"""Lift-off: wheels in the air when the free decay should begin.

The fitted motion shows how far each tyre is relieved.  A tyre can only push; where it pulls in the
linear model, the wheel was in the air and the model does not hold.  The fit detects this and begins
a decay when the wheels are down: the decay then begins late, with hardly any load on a tyre.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import Corner
from dbc.finding import Finding, Severity

from ..decays.decay import FreeDecay, Record
from ..decays.onset import onset_s
from ..fit.estimation import Estimation, linearised_at
from ..fit.varpro import Evaluated, LinearPart
from ..model.matrices import N_DOF, PhysicalModel, loaded_model
from .format import listed

GRAVITY_M_S2 = 9.80665
PULL_LIMIT = 0.1
"""Share of the static load that a tyre may seem to pull.  The start of the decay lies up to one
sample before the first that is fitted, and in that time a landing tyre gains as much."""
LANDING_LIMIT = 0.2
"""Share of the static load below which a tyre has just landed, for the same reason."""
LATE_S = 0.005
"""Delay after the stated end of the bump, s, above which a decay was not free before its start."""
_SURE = 3.0  # standard deviations
_STEP_S = 1e-3
_LONGEST_S = 1.0  # wheels that have not lifted by then will not


@dataclass(frozen=True, slots=True)
class _Light:
    """A wheel that is nearly or wholly relieved in a run."""

    place: str
    """Wheel and run."""
    load_n: float
    static_n: float
    """`load_n`, `static_n`: its least load in the decay, and its load at rest, N."""
    late_s: float
    """Delay of the decay's start after the stated end of the bump, s; NaN if that is not known."""

    @property
    def in_the_air(self) -> bool:
        """True if the wheel was off the road for longer than a landing takes."""
        return self.load_n < -PULL_LIMIT * self.static_n or self.late_s > LATE_S


def lift_off_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Find the wheels that leave the road over the bump and land during the decay.

    `estimation`: the fit; tyre loads follow from its parameters and the fitted initial state of
    each run.
    """
    light = sorted(_light(estimation), key=lambda wheel: wheel.load_n)
    flying = [wheel for wheel in light if wheel.in_the_air]
    if not light:
        return ()
    worst = (flying or light)[0]
    load = f"{worst.load_n:.0f} N (at rest {worst.static_n:.0f} N)"
    places = listed(wheel.place for wheel in flying or light)
    if not flying:
        text = (
            f"a wheel just lands as the decay begins, tyre load {load}: {places}; harmless if "
            "nothing else is found, a lower bump is safer"
        )
        return (Finding("lift_off", Severity.NOTE, text),)
    late_s = np.nanmax([wheel.late_s for wheel in flying] + [0.0])
    waited = f", {late_s * 1e3:.0f} ms after the bump at the latest" if late_s > LATE_S else ""
    text = (
        f"wheels lift off the road: least tyre load in the fitted decay {load}: {places}; the "
        f"linear model holds only once they are down{waited}, when their motion has died away in "
        "part: use a lower bump"
    )
    return (Finding("lift_off", Severity.WARNING, text),)


def _light(estimation: Estimation) -> Iterator[_Light]:
    """Return the wheels whose tyres would have to pull, or have only the load of a late landing."""
    full = estimation.full
    tyres = full[11:15]
    there = linearised_at(estimation)
    records = {record.label: record for record in estimation.records}
    for state in estimation.box.mass_states:
        if state.name not in there.points:
            continue
        static = static_loads_n(loaded_model(full, state.added), tyres)
        at = there.points[state.name]
        for decay, linear in zip(estimation.decays, there.linear, strict=True):
            if decay.mass_state != state.name:
                continue
            least, sigma = least_loads_n(at, decay, linear, static, tyres)
            late_s = _late_s(records[decay.label], decay)
            limit = LANDING_LIMIT * static if late_s > LATE_S else np.zeros(len(Corner))
            for corner in Corner:
                i = corner.position
                if least[i] < limit[i] - _SURE * sigma[i]:
                    place = f"wheel {corner} in {decay.label}"
                    yield _Light(place, float(least[i]), float(static[i]), late_s)


def _late_s(record: Record, decay: FreeDecay) -> float:
    onset = onset_s(record)
    return decay.start_s - (onset + record.bump_s) if onset is not None else float("nan")


def static_loads_n(model: PhysicalModel, tyre_n_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the load under each wheel at rest on a flat road, (4,) N.

    Gravity acts as if everything were accelerated upwards by g, so its forces are a column of the
    mass matrix, added weights included; the springs distribute them.
    """
    heave = np.concatenate([[1.0, 0.0, 0.0], np.ones(4)])
    sunk = np.linalg.solve(model.K, GRAVITY_M_S2 * (model.M @ heave))
    return np.asarray(tyre_n_m * sunk[3:])


def least_loads_n(
    at: Evaluated,
    decay: FreeDecay,
    linear: LinearPart,
    static_n: NDArray[np.float64],
    tyre_n_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least load of each wheel and its standard deviation by the noise, (4,) N each."""
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
