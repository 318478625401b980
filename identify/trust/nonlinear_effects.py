"""Forces that a linear model lacks: friction, and dampers that differ in compression and rebound.

They act along the fitted motion; what they add to it is computed to first order, by driving the
fitted vehicle with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE

from ..decays.decay import Recording
from ..fit.estimation import Estimation
from ..fit.varpro import Evaluated
from ..model.exponentials import real_part, waves
from ..model.matrices import loaded_model, travel_rows
from .linear_effects import Effect, Effects, Traces, modal_start
from .score_test import FittedDecay

_GRID_S = 0.001
_FRICTION_SPEED_M_S = 0.005
"""Speed, m/s, over which friction changes its sign: a bushing deforms before a seal slides."""
_AXLES = (slice(0, 2), slice(2, 4))


@dataclass(frozen=True, slots=True)
class _Drives:
    """One unit of each of q forces, on the two corners of an axle."""

    force: NDArray[np.float64]
    """Forces over the time grid, N, shape (q, n, 2)."""
    push: NDArray[np.float64]
    """Acceleration of the degrees of freedom by 1 N at either corner, shape (q, 7, 2)."""
    modal: NDArray[np.complex128]
    """State of the vehicle in modal coordinates, driven from rest, one for each conjugate pair,
    shape (n, q, m)."""
    V: NDArray[np.complex128]
    """Matrix from modal coordinates to the state, which is the real part of the product, shape (14,
    m)."""


def suspension_forces(estimation: Estimation) -> Effects:
    """Return friction, N, and excess of rebound damping over compression, N s/m, of each axle.

    Their traces are sampled, (n_samples, n_channels, 4).
    """
    friction = "friction in the suspension"
    one_sided = "dampers stronger in rebound than in compression"
    effects = (
        *(Effect(friction, axle, "N") for axle in ("front", "rear")),
        *(Effect(one_sided, axle, "N s/m", 2.0) for axle in ("front", "rear")),
    )
    full = estimation.full
    travel = travel_rows(full.astype(complex)).real
    push = {
        state.name: np.asarray(-np.linalg.solve(loaded_model(full, state.added).M, travel.T), float)
        for state in estimation.box.mass_states
    }

    def trace_of(one: FittedDecay) -> Traces:
        at = one.at
        end = max(float(at.time_s(r)[-1]) for r in one.decay.recordings)
        grid = np.arange(0.0, end + 2.0 * _GRID_S, _GRID_S)
        speed = _speeds(one, grid) @ travel.T
        forces = (np.tanh(speed / _FRICTION_SPEED_M_S), -np.abs(speed))
        pushed = push[one.decay.mass_state]
        drives = _drives(
            at,
            np.stack([force[:, axle] for force in forces for axle in _AXLES]),
            np.stack([pushed[:, axle] for _ in forces for axle in _AXLES]),
        )
        return tuple(_seen(at, r, grid, drives) for r in one.decay.recordings)

    return Effects(effects, trace_of)


def _speeds(one: FittedDecay, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the fitted velocities of the degrees of freedom, (n, 7)."""
    modes = one.at.modes
    z = modal_start(one)
    upper = modes.poles.imag >= 0
    share = np.where(modes.poles[upper].imag > 0, 2.0, 1.0)  # a conjugate pair counts twice
    wave = waves(time_s, modes.poles[upper])
    return real_part(wave, modes.V[7:, upper] * (z[upper] * share))


def _drives(at: Evaluated, force: NDArray[np.float64], push: NDArray[np.float64]) -> _Drives:
    """Drive the vehicle from rest with forces, (q, n, 2), linear between the points of the grid."""
    # One of a conjugate pair represents both.
    upper = at.modes.poles.imag >= 0.0
    poles, W = at.modes.poles[upper], at.modes.W[upper, 7:]
    V = at.modes.V[:, upper] * np.where(poles.imag > 0.0, 2.0, 1.0)
    inward = (W @ push).swapaxes(1, 2)  # (q, 2, m)
    s = poles * _GRID_S
    step = np.exp(s)
    now, before = (step - 1.0 - s) / s**2 * _GRID_S, (step * (s - 1.0) + 1.0) / s**2 * _GRID_S
    gains = np.ascontiguousarray(np.concatenate([now * inward, before * inward], axis=1))
    pushed = np.zeros((*force.shape[:2], 4))
    pushed[:, 1:, :2], pushed[:, 1:, 2:] = force[:, 1:], force[:, :-1]
    gained = (pushed @ gains.view(np.float64)).view(np.complex128).swapaxes(0, 1)
    return _Drives(force, push, _driven(gained, step), V)


def _driven(gained: NDArray[np.complex128], step: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return ``z[k] = step z[k - 1] + gained[k]``, (n, q, len(step)), from rest.

    Segments of the grid are driven from rest in parallel; then each continues the one before.
    """
    n, width = len(gained), isqrt(len(gained))
    stretches = -(-n // width)
    z = np.zeros((stretches * width, *gained.shape[1:]), dtype=complex)
    z[:n] = gained
    z = z.reshape(stretches, width, *gained.shape[1:])
    for k in range(1, width):
        z[:, k] += step * z[:, k - 1]
    carried = step ** np.arange(1, width + 1)[:, None]  # (width, len(step))
    for i in range(1, stretches):
        z[i] += carried[:, None] * z[i - 1, -1]
    return z.reshape(stretches * width, *gained.shape[1:])[:n]


def _seen(
    at: Evaluated, recording: Recording, grid: NDArray[np.float64], drives: _Drives
) -> NDArray[np.float64]:
    """Return the driven motions in each channel, (n_samples, n_channels, q)."""
    time = at.time_s(recording)
    channels = recording.group.channels
    rows = np.array([at.system.rows[c.name] for c in channels])
    # An accelerometer senses the force itself, not only the motion that the force causes.
    accelerations = np.array([TIME_DERIVATIVE[c.quantity] == 2 for c in channels])
    displaced = rows[:, :7] @ np.linalg.inv(at.system.A[7:, :7]) * accelerations[:, None]
    at_once = drives.force @ (displaced @ drives.push).swapaxes(1, 2)  # (q, n, n_channels)
    on_grid = real_part(drives.modal, rows @ drives.V) + at_once.swapaxes(0, 1)
    before = np.clip(np.searchsorted(grid, time) - 1, 0, len(grid) - 2)
    share = ((time - grid[before]) / _GRID_S)[:, None, None]
    between = on_grid[before] * (1.0 - share) + on_grid[before + 1] * share
    return np.asarray(between.swapaxes(1, 2))
