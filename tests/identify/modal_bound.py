"""Cramer-Rao bound of the modes by brute force: every column of the Jacobian written out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from identify.model.matrices import physical_model
from identify.model.response import Bump, exact_response
from identify.modes.modal_model import modes_of

from .bumps import CASES


def unstructured_bound(
    rate_hz: float, noise_db: float, cases: tuple[Excitation, ...] = CASES
) -> NDArray[np.float64]:
    """Return relative standard deviations of seven frequencies and seven damping ratios, (14,).

    Nothing is known of the structure but that it has seven modes: 7 poles, a shape each in seven
    accelerations, an amplitude each in every run.  Noise as docs/method.md, "Noise and the
    bound", defines it, on records from the end of the bump.
    """
    model = physical_model(FORD_GRANADA)
    truth = modes_of(model.A)
    poles, shapes = truth.poles, truth.shapes * truth.poles**2
    runs = [exact_response(model, case, Bump(), rate_hz, 3.0) for case in cases]
    power = np.mean([np.mean(run.acceleration**2, axis=0) for run in runs], axis=0)
    sigma = np.sqrt(power) * 10.0 ** (-noise_db / 20.0)
    decays = [run.time_s > 0.3 + 1e-9 for run in runs]
    time = runs[0].time_s[decays[0]] - runs[0].time_s[decays[0]][0]
    wave = np.exp(np.outer(time, poles))

    both = np.vstack([truth.shapes, truth.shapes * poles])
    states = [
        np.concatenate([run.displacement[decay][0], run.velocity[decay][0]])
        for run, decay in zip(runs, decays, strict=True)
    ]
    full = np.linalg.solve(np.hstack([both, both.conj()]), np.array(states).T.astype(complex))
    amplitudes = 2.0 * full[:7].T  # (n_runs, 7)

    by_pole = np.einsum("rj,tj,cj->jrtc", amplitudes, time[:, None] * wave, shapes)
    by_shape = np.einsum("rj,tj,ck->jkrtc", amplitudes, wave, np.eye(7)).reshape(
        49, *by_pole[0].shape
    )
    by_amplitude = np.einsum("rs,tj,cj->jsrtc", np.eye(len(runs)), wave, shapes)
    by_amplitude = by_amplitude.reshape(-1, *by_pole[0].shape)
    complex_columns = np.concatenate([by_pole, by_shape, by_amplitude]) / sigma
    columns = np.stack([complex_columns.real, (1j * complex_columns).real], axis=1)
    jacobian = columns.reshape(2 * len(complex_columns), -1).T
    size = np.linalg.norm(jacobian, axis=0)
    _, strength, directions = np.linalg.svd(jacobian / size, full_matrices=False)
    free = strength > 1e-9 * strength[0]  # the scale of each shape is not
    half = directions[free].T / strength[free]
    covariance = half @ half.T / np.outer(size, size)

    bound = np.empty((2, 7))
    for j, pole in enumerate(poles):
        a, b, omega = pole.real, pole.imag, abs(pole)
        frequency = np.array([a, b]) / omega**2
        damping = np.array([-1.0 / omega + a**2 / omega**3, a * b / omega**3]) / (-a / omega)
        block = covariance[2 * j : 2 * j + 2, 2 * j : 2 * j + 2]
        bound[:, j] = np.sqrt([frequency @ block @ frequency, damping @ block @ damping])
    return bound.ravel()
