"""Computes in closed form how a car sags under added weights, and which weight that contradicts.

Positions are those of `daq.vehicle`: from the middle of the front axle, x forward, y left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dbc.units import G_M_S2
from dbc.words import Finding, Severity

from .vehicle import (
    FORD_GRANADA,
    BodyWeight,
    Corner,
    FactQuantity,
    HubWeight,
    Vehicle,
    VehicleParameters,
)

Weight = BodyWeight | HubWeight

WEIGHT_SAG = "weight_sag"
"""Code of the finding on a weight that the sag contradicts."""
_CONTRADICTED = 8.0
"""Drop of chi2 by one changed weight from which the stated one is contradicted (2.8 sigma)."""


def axle_loads(body: Sequence[BodyWeight], wheelbase_m: float) -> tuple[float, float]:
    """Return the load that weights on the body add to the front and the rear axle, kg."""
    rear_kg = sum(w.mass_kg * -w.x_m / wheelbase_m for w in body)
    return sum(w.mass_kg for w in body) - rear_kg, rear_kg


def wrong_weights(
    weights: Sequence[Weight],
    car: VehicleParameters,
    sag_m: Mapping[Corner, float],
    sigma_m: float = 1.5e-3,
    spread: float = 0.4,
    axle_spread: float = 0.25,
) -> tuple[Finding, ...]:
    """Return the one weight on the body that the sag contradicts, if changing it alone explains it.

    It tries each weight with another mass, the other sign of x or of y, and front for rear.  An
    axle sinks by its load over its springs; the body rolls by the moment over all springs and a
    usual car's bars.  `sag_m`: change of suspension travel at rest, m, positive in compression; an
    axle without both is not used.  `sigma_m`: its standard uncertainty.  `spread`, `axle_spread`:
    of the logarithm of all springs, and of each axle's; the defaults are for the springs of
    `expected_car`.
    """
    body = [(i, w) for i, w in enumerate(weights) if isinstance(w, BodyWeight)]
    axles = [
        [sag_m[c] for c in Corner if c.front is front and c in sag_m] for front in (True, False)
    ]
    axle_known = np.array([len(pair) == 2 for pair in axles])
    if not body or not axle_known.any():
        return ()
    wheelbase_m, half_m = car.a + car.b, np.array([car.t_f, car.t_r])
    axle_n_m = 2.0 * np.array([car.k_sf, car.k_sr])
    mean_m = np.array([sum(pair) / 2 if len(pair) == 2 else 0.0 for pair in axles])
    left_m = np.array([pair[0] - pair[1] if len(pair) == 2 else 0.0 for pair in axles])
    roll = float(left_m @ half_m) / (2 * float(half_m**2 @ axle_known))
    measured = np.array([*mean_m, roll])  # front and rear sag, m, and roll, rad
    sigma = np.array(
        [
            *np.where(axle_known, sigma_m / np.sqrt(2.0), np.inf),
            sigma_m / np.sqrt(2.0 * float(half_m**2 @ axle_known)),
        ]
    )
    # Because of its bars a usual car is 1.3 times as stiff in roll as its springs alone; the
    # logarithm of that ratio spreads by 0.3.
    roll_n_m = 1.3 * float(axle_n_m @ half_m**2)
    share = np.array([axle_spread, axle_spread, np.hypot(axle_spread, 0.3)])

    def sag(w: Weight) -> NDArray[np.float64]:
        """Return the sag of the axles and the roll that one weight causes."""
        assert isinstance(w, BodyWeight)  # hub weights are never changed
        front_kg, rear_kg = axle_loads([w], wheelbase_m)
        by_kg = [front_kg / axle_n_m[0], rear_kg / axle_n_m[1], w.mass_kg * w.y_m / roll_n_m]
        return G_M_S2 * np.array(by_kg)

    total = np.sum([sag(w) for _, w in body], axis=0)
    stated = float(_misfit(total[None], measured, sigma, spread, share)[0])
    if stated < _CONTRADICTED:
        return ()
    changes: list[tuple[int, str, BodyWeight]] = []
    for i, w in body:
        for factor in np.logspace(-1.5, 1.5, 121).tolist():
            other = replace(w, mass_kg=w.mass_kg * factor)
            text = f"{w.mass_kg:g} kg; the body sank as for {other.mass_kg:.2g} kg"
            changes.append((i, text, other))
        for x_m in (-w.x_m, -wheelbase_m - w.x_m):
            text = f"x = {w.x_m:+.2f} m; the body sank as for {x_m:+.2f} m"
            changes.append((i, text, replace(w, x_m=x_m)))
        text = f"y = {w.y_m:+.2f} m; the body sank as for {-w.y_m:+.2f} m"
        changes.append((i, text, replace(w, y_m=-w.y_m)))
    sags = np.array([total + sag(other) - sag(weights[i]) for i, _, other in changes])
    misfit = _misfit(sags, measured, sigma, spread, share).tolist()
    least = min(misfit)
    # The three motions of the body (bounce of each axle, roll) agree up to a chi2 of 9.
    if stated - least < _CONTRADICTED or least > 9.0:
        return ()
    best: dict[int, str] = {}
    for chi2, (i, text, _) in sorted(zip(misfit, changes, strict=True), key=lambda t: t[0]):
        if chi2 < least + 4.0:  # it explains the sag as well
            best.setdefault(i, text)
    text = ", or ".join(f"weight {i + 1} says {what}" for i, what in best.items())
    subject = f"weight {next(iter(best)) + 1}"
    advice = "weigh it and measure its place again, then correct it"
    return (Finding(WEIGHT_SAG, Severity.ERROR, text, subject, advice, stated, _CONTRADICTED),)


def _misfit(
    expected: NDArray[np.float64],
    measured: NDArray[np.float64],
    sigma: NDArray[np.float64],
    spread: float,
    share: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return chi2, (n,), of expected sags, (n, 3), whose springs are uncertain.

    The least over the logarithm of a factor of all springs, and of one of each motion, in units of
    their standard uncertainties.
    """
    steps, grid = np.linspace(-3.0, 3.0, 31), np.linspace(-6.0, 6.0, 49)[:, None, None, None]
    stiff = expected * np.exp(spread * steps)[:, None, None]
    cost = ((measured - stiff * np.exp(share * grid)) / sigma) ** 2 + grid**2
    shift = grid.ravel()[cost.argmin(axis=0)]
    least = cost.min(axis=0)
    for _ in range(4):  # Gauss-Newton from the best point of the grid
        sag = stiff * np.exp(share * shift)
        slope = share * sag / sigma
        shift = np.clip(
            slope * ((measured - sag) / sigma + slope * shift) / (1.0 + slope**2), -9.0, 9.0
        )
        sag = stiff * np.exp(share * shift)
        least = np.minimum(least, ((measured - sag) / sigma) ** 2 + shift**2)
    return np.asarray((least.sum(axis=2) + steps[:, None] ** 2).min(axis=0))


def expected_car(vehicle: Vehicle) -> VehicleParameters:
    """Return a typical car: that of the paper, scaled to the weighed and measured facts.

    Masses, springs and dampers are proportional to the total mass, so that the frequencies are
    those of a usual car; inertias are also proportional to the square of the lengths.
    """
    known = {fact.quantity: fact.value for fact in vehicle.facts}
    usual = FORD_GRANADA
    usual_kg = usual.m_s + 2.0 * (usual.m_uf + usual.m_ur)
    corners_kg = [known.get(f"corner_{corner}_kg", 0.0) for corner in ("fl", "fr", "rl", "rr")]
    weighed = all(corners_kg)
    front_kg = sum(corners_kg[:2]) if weighed else known.get(FactQuantity.FRONT_AXLE)
    rear_kg = sum(corners_kg[2:]) if weighed else known.get(FactQuantity.REAR_AXLE)
    axles_kg = front_kg + rear_kg if front_kg and rear_kg else usual_kg
    size = known.get(FactQuantity.TOTAL_MASS, axles_kg) / usual_kg
    given = vehicle.geometry
    long_m = known.get(FactQuantity.WHEELBASE, given.a + given.b if given else usual.a + usual.b)
    m_uf, m_ur, m_s = size * usual.m_uf, size * usual.m_ur, size * usual.m_s
    share = usual.a / (usual.a + usual.b)
    if front_kg and rear_kg:
        share = min(max((rear_kg - 2.0 * m_ur) / (axles_kg - 2.0 * (m_uf + m_ur)), 0.1), 0.9)
    a, b = share * long_m, (1.0 - share) * long_m
    t_f = known.get(FactQuantity.FRONT_TRACK, 2.0 * usual.t_f) / 2.0
    t_r = known.get(FactQuantity.REAR_TRACK, 2.0 * usual.t_r) / 2.0
    if given:
        a, b, t_f, t_r = given.a, given.b, given.t_f, given.t_r
    wide, deep = (t_f + t_r) / (usual.t_f + usual.t_r), (a * b) / (usual.a * usual.b)
    # The springs of an axle are scaled by the axle's load relative to that of the usual car.
    front = size * (b / (a + b)) / (usual.b / (usual.a + usual.b))
    rear = size * (a / (a + b)) / (usual.a / (usual.a + usual.b))
    return replace(
        usual,
        m_s=m_s,
        I_yy=size * deep * usual.I_yy,
        I_xx=size * wide**2 * usual.I_xx,
        m_uf=m_uf,
        m_ur=m_ur,
        k_sf=front * usual.k_sf,
        k_sr=rear * usual.k_sr,
        k_tf=front * usual.k_tf,
        k_tr=rear * usual.k_tr,
        c_sf=front * usual.c_sf,
        c_sr=rear * usual.c_sr,
        a=a,
        b=b,
        t_f=t_f,
        t_r=t_r,
    )
