"""Structures with known modes, and their free decays in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm


def oscillators(frequencies_hz: list[float], damping: list[float]) -> NDArray[np.complex128]:
    """Return the pole of each oscillator: ``omega (-zeta + i sqrt(1 - zeta^2))``."""
    omega, zeta = 2.0 * np.pi * np.array(frequencies_hz), np.array(damping)
    return np.asarray(omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2)), dtype=np.complex128)


def chain_poles(n: int, k: float, c: float, m: float) -> NDArray[np.complex128]:
    """Return the poles of n masses between two walls, joined by n + 1 springs and dampers.

    Textbook closed form: ``omega_j = 2 sqrt(k / m) sin(j pi / (2 (n + 1)))`` undamped, and the
    dampers, alike in proportion to the springs, give ``zeta_j = c omega_j / (2 k)``.
    """
    omega = 2.0 * np.sqrt(k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    zeta = c * omega / (2.0 * k)
    return np.asarray(omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2)))


def chain_shapes(n: int) -> NDArray[np.float64]:
    """Return the shapes of that chain, (n, n): standing sine waves."""
    masses = np.arange(1, n + 1)
    return np.sin(np.outer(masses, masses) * np.pi / (n + 1))


def free_decay(
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128] | NDArray[np.float64],
    amplitudes: NDArray[np.complex128] | NDArray[np.float64],
    rate_hz: float,
    duration_s: float,
) -> NDArray[np.float64]:
    """Return ``Re sum amplitude shape exp(pole t)``, (n_samples, n_channels)."""
    time = np.arange(int(duration_s * rate_hz)) / rate_hz
    return np.asarray(((np.exp(np.outer(time, poles)) * amplitudes) @ shapes.T).real)


def with_noise(
    record: NDArray[np.float64], snr_db: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Add white noise to each channel, so much below its own RMS."""
    sigma = 10.0 ** (-snr_db / 20.0) * np.sqrt(np.mean(record**2, axis=0))
    return np.asarray(record + sigma * rng.standard_normal(record.shape))


def random_amplitudes(n: int, rng: np.random.Generator) -> NDArray[np.complex128]:
    """Return amplitudes between 0.5 and 1.5 of any phase."""
    return np.asarray(rng.uniform(0.5, 1.5, n) * np.exp(2j * np.pi * rng.random(n)))


CLOSE_PAIR_HZ = (125.21, 125.58)


def struck_frame(
    n_modes: int,
    n_records: int,
    seed: int,
    *,
    n_samples: int = 1024,
    rate_hz: float = 512.0,
    drift: float = 0.0,
    noise: float = 0.01,
) -> tuple[list[NDArray[np.float64]], NDArray[np.complex128]]:
    """Return records of a frame that is struck at random places, and its poles, (n_modes,).

    As many masses as modes, of 1 kg, on springs and dampers between all of them; two of the modes
    are 0.37 Hz apart, damping ratios are 0.2 to 0.8 %.  Three accelerations, from the matrix
    exponential of the state matrix; `drift` is the standard deviation of the frequencies from
    record to record, relative.
    """
    rng = np.random.default_rng(seed)
    spread = np.linspace(30.0, 225.0, n_modes - 2) + rng.uniform(-3.0, 3.0, n_modes - 2)
    omega = 2.0 * np.pi * np.sort([*spread, *CLOSE_PAIR_HZ])
    zeta = rng.uniform(0.002, 0.008, n_modes)
    turned = np.linalg.qr(rng.standard_normal((n_modes, n_modes)))[0]
    stiffness = turned * omega**2 @ turned.T
    damping = turned * (2.0 * zeta * omega) @ turned.T
    nil, one = np.zeros((n_modes, n_modes)), np.eye(n_modes)
    records = []
    for softer in 1.0 + drift * rng.standard_normal(n_records if drift else 1):
        state = np.block([[nil, one], [-stiffness * softer**2, -damping * softer]])
        blows = 1 if drift else n_records
        motion = np.zeros((2 * n_modes, blows))
        struck = rng.integers(n_modes, size=blows)
        motion[n_modes + struck, np.arange(blows)] = rng.uniform(0.5, 1.5, blows)
        step, seen = (
            expm(state / rate_hz),
            state[n_modes + np.array([0, n_modes // 2, n_modes - 1])],
        )
        series = np.empty((n_samples, 3, blows))
        for i in range(n_samples):
            series[i], motion = seen @ motion, step @ motion
        records += list(np.moveaxis(series, -1, 0))
    sigma = noise * np.sqrt(np.mean(np.concatenate(records) ** 2, axis=0))
    poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    return [r + sigma * rng.standard_normal(r.shape) for r in records], poles
