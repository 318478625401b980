"""Forces that a linear model lacks: friction, and dampers that differ in compression and rebound.

They act along the fitted motion; what they add to it is computed to first order, by driving the
fitted vehicle with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE

from ..decay import Recording
from ..estimation import Estimation
from ..model import loaded_model, travel_rows
from ..projection import Point
from .effects import Effect, Effects, modal_start
from .score import FittedDecay, Trace

_GRID_S = 0.001
_FRICTION_SPEED_M_S = 0.005
"""Friction turns its sign over this speed; a bushing gives way before a seal slides."""
_AXLES = (slice(0, 2), slice(2, 4))


@dataclass(frozen=True, slots=True)
class _Drive:
    """One unit of a force on the two corners of an axle.

    Parameters
    ----------
    force : (n, 2) float64
        Over the time grid, N.
    push : (7, 2) float64
        Acceleration of the degrees of freedom by one newton at either corner.
    state : (n, 14) float64
        What it moves, from rest.
    """

    force: NDArray[np.float64]
    push: NDArray[np.float64]
    state: NDArray[np.float64]


def suspension_forces(estimation: Estimation) -> Effects:
    """Return friction, N, and what rebound has more than compression, N s/m, of each axle."""
    friction = "friction in the suspension"
    one_sided = "dampers stronger in rebound than in compression"
    effects = (
        *(Effect(friction, axle, "N") for axle in ("front", "rear")),
        *(Effect(one_sided, axle, "N s/m", 2.0) for axle in ("front", "rear")),
    )
    full = estimation.box.full(estimation.fit.eta.astype(complex)).real
    travel = travel_rows(full.astype(complex)).real
    push = {
        state.name: np.asarray(-np.linalg.solve(loaded_model(full, state.added).M, travel.T), float)
        for state in estimation.box.mass_states
    }

    def trace_of(one: FittedDecay) -> Trace:
        at = one.at
        end = max(float(at.time_s(r)[-1]) for r in one.decay.recordings)
        grid = np.arange(0.0, end + 2.0 * _GRID_S, _GRID_S)
        speed = _speeds(one, grid) @ travel.T
        forces = (np.tanh(speed / _FRICTION_SPEED_M_S), -np.abs(speed))
        pushed = push[one.decay.mass_state]
        drives = [
            _drive(at, force[:, axle], pushed[:, axle]) for force in forces for axle in _AXLES
        ]
        return tuple(_seen(at, r, grid, drives) for r in one.decay.recordings)

    return Effects(effects, trace_of)


def _speeds(one: FittedDecay, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the fitted velocities of the degrees of freedom, (n, 7)."""
    modes = one.at.modes
    z = modal_start(one)
    upper = modes.poles.imag >= 0
    share = np.where(modes.poles[upper].imag > 0, 2.0, 1.0)  # a conjugate pair counts twice
    wave = np.exp(np.multiply.outer(time_s, modes.poles[upper])) * (z[upper] * share)
    return np.asarray((wave @ modes.V[7:, upper].T).real)


def _drive(at: Point, force: NDArray[np.float64], push: NDArray[np.float64]) -> _Drive:
    """Drive the vehicle from rest with a force that is linear between the points of the grid."""
    from scipy.signal import lfilter  # takes half a second to import

    modes = at.modes
    inward = force @ (modes.W[:, 7:] @ push).T  # (n, 14)
    s = modes.poles * _GRID_S
    step = np.exp(s)
    now, before = (step - 1.0 - s) / s**2 * _GRID_S, (step * (s - 1.0) + 1.0) / s**2 * _GRID_S
    z = np.array(
        [
            lfilter([now[k], before[k]], [1.0, -step[k]], inward[:, k])
            for k in range(len(modes.poles))
        ]
    )
    return _Drive(force, push, (modes.V @ z).real.T)


def _seen(
    at: Point, recording: Recording, grid: NDArray[np.float64], drives: list[_Drive]
) -> NDArray[np.float64]:
    """Return what the driven motions give in each channel, (n_samples, n_channels, q)."""
    time = at.time_s(recording)
    channels = recording.clock.channels
    rows = np.array([at.system.rows[c.name] for c in channels])
    # An acceleration feels the force itself, not only the motion that it makes.
    accelerations = np.array([TIME_DERIVATIVE[c.quantity] == 2 for c in channels])
    displaced = rows[:, :7] @ np.linalg.inv(at.system.A[7:, :7]) * accelerations[:, None]
    trace = np.zeros((len(time), len(rows), len(drives)))
    for q, drive in enumerate(drives):
        on_grid = drive.state @ rows.T + drive.force @ (displaced @ drive.push).T
        trace[..., q] = np.array([np.interp(time, grid, column) for column in on_grid.T]).T
    return trace
