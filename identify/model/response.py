"""Computes the response of the linear model to half-sine bumps, the data of the paper's studies.

Two integrators: `exact_response`, whose error is rounding at any rate, and `wilson_response`, the
Wilson-theta method that the paper used and whose error is the error of its Table 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.bumps import BUMPS
from daq.runs import Excitation

from .matrices import N_DOF, PhysicalModel

WILSON_THETA = 1.4
"""Unconditionally stable above 1.37; the usual choice."""


@dataclass(frozen=True, slots=True)
class Bump:
    """Half-sine bump ``height sin(pi (t - start) / duration)`` (Eq. 34, whose values these are)."""

    height_m: float = 0.09
    start_s: float = 0.1
    duration_s: float = 0.2

    @property
    def end_s(self) -> float:
        """Time at which the wheels leave the bump."""
        return self.start_s + self.duration_s


@dataclass(frozen=True, slots=True)
class Response:
    """Motion of the seven degrees of freedom on a grid that starts at rest at t = 0."""

    time_s: NDArray[np.float64]
    """The grid, s, shape (n,)."""
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    """`displacement`, `velocity`, `acceleration`: m and rad, and their derivatives in s, order
    `daq.vehicle.DOF`, shape (n, 7)."""


def exact_response(
    model: PhysicalModel, excitation: Excitation, bump: Bump, rate_hz: float, duration_s: float
) -> Response:
    """Return the response to a bump without discretisation error, at ``k / rate_hz`` from t = 0.

    On the bump, two more states generate the half sine (``g'' = -(pi / duration)^2 g``), so that
    response and road are one autonomous system; its matrix exponential takes the state to each
    sample, and over both corners of the bump wherever they lie between samples.
    """
    time = _grid_s(rate_hz, duration_s)
    tolerance = 1e-9 / rate_hz  # of a sample's time: rounding
    on_bump = (time > bump.start_s + tolerance) & (time <= bump.end_s + tolerance)
    after = time > bump.end_s + tolerance

    omega = np.pi / bump.duration_s
    n = 2 * N_DOF
    with_road = np.zeros((n + 2, n + 2))
    with_road[:n, :n] = model.A
    with_road[N_DOF:n, -2] = np.linalg.solve(model.M, _road_force(model, excitation))
    with_road[-2, -1] = 1.0
    with_road[-1, -2] = -(omega**2)
    start_state = np.zeros(n + 2)  # of the bump
    start_state[-1] = bump.height_m * omega

    state = np.zeros((len(time), n + 2))
    state[on_bump] = _free_motion(with_road, start_state, time[on_bump] - bump.start_s)
    (end_state,) = _free_motion(with_road, start_state, np.array([bump.duration_s]))
    state[after, :n] = _free_motion(model.A, end_state[:n], time[after] - bump.end_s)
    rate_of_change = state @ with_road.T
    return Response(time, state[:, :N_DOF], state[:, N_DOF:n], rate_of_change[:, N_DOF:n])


def wilson_response(
    model: PhysicalModel, excitation: Excitation, bump: Bump, rate_hz: float, duration_s: float
) -> Response:
    """Return the response by the Wilson-theta method with one step a sample (theta = 1.4).

    The acceleration varies linearly over ``theta dt``, and equilibrium holds at the end of that
    stretch, for a road force extrapolated linearly.
    """
    time = _grid_s(rate_hz, duration_s)
    on_bump = (time >= bump.start_s) & (time <= bump.end_s)
    shape = np.where(on_bump, np.sin(np.pi * (time - bump.start_s) / bump.duration_s), 0.0)
    force = bump.height_m * shape[:, None] * _road_force(model, excitation)

    M, C, K = model.M, model.C, model.K
    dt = 1.0 / rate_hz
    theta_dt = WILSON_THETA * dt
    # Solved for the acceleration: solved for the displacement, as textbooks print it, the same
    # equation divides by dt^2 and loses three digits at 1 kHz.
    inverse = np.linalg.inv(M + theta_dt / 2.0 * C + theta_dt**2 / 6.0 * K)
    x, v, accel = (np.zeros((len(time), N_DOF)) for _ in range(3))
    for k in range(len(time) - 1):
        rhs = force[k] + WILSON_THETA * (force[k + 1] - force[k])
        rhs = rhs - C @ (v[k] + theta_dt / 2.0 * accel[k])
        rhs = rhs - K @ (x[k] + theta_dt * v[k] + theta_dt**2 / 3.0 * accel[k])
        accel[k + 1] = accel[k] + (inverse @ rhs - accel[k]) / WILSON_THETA
        v[k + 1] = v[k] + 0.5 * dt * (accel[k + 1] + accel[k])
        x[k + 1] = x[k] + dt * v[k] + dt**2 / 6.0 * (accel[k + 1] + 2.0 * accel[k])
    return Response(time, x, v, accel)


def _grid_s(rate_hz: float, duration_s: float) -> NDArray[np.float64]:
    """Return the time of every sample from 0 to the duration, both included, s."""
    return np.arange(int(duration_s * rate_hz + 1e-6) + 1) / rate_hz  # 1e-6: rounding


def _road_force(model: PhysicalModel, excitation: Excitation) -> NDArray[np.float64]:
    """Return the force on the degrees of freedom per metre of bump (Eq. 6), (7,).

    A heave of the whole vehicle strains the tyres only, so K times that heave is their stiffness.
    """
    heave = np.array([1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    tyres = model.K @ heave
    return np.concatenate([np.zeros(3), tyres[3:] * np.array(BUMPS[excitation].height_ratios)])


def _free_motion(
    A: NDArray[np.float64], start: NDArray[np.float64], time_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return ``expm(A t) start`` at some times, (n, len(A)), by the eigenvectors of A."""
    poles, vectors = np.linalg.eig(A)
    amplitudes = np.linalg.solve(vectors, start.astype(complex))
    return np.asarray((np.exp(np.multiply.outer(time_s, poles)) * amplitudes @ vectors.T).real)
