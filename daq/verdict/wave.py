"""Fits one damped wave to the body's motion, for display to the operator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..channels import Quantity
from .motion import of_quantity
from .window import Trace

_STEP_S = 0.02
_FREQUENCY_HZ = (0.4, 5.0)
_DAMPING = (0.01, 0.7)
_TURNS = 3
"""Number of searches, each on the two grid cells around the best point of the previous one."""
_CLEAR = 5.0
"""Least ratio of peak to noise at which a wave is searched for."""
_CLEAREST_FIRST = (
    (Quantity.SUSPENSION_TRAVEL,),
    (Quantity.PITCH_RATE, Quantity.ROLL_RATE, Quantity.BODY_ACCELERATION),
    (Quantity.BODY_DISPLACEMENT,),
    (Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION),
)
"""Quantities that show the body."""


def body_wave(signals: tuple[Trace, ...], bump_s: float) -> tuple[float, float] | None:
    """Fit a damped wave to the strongest motion of the body after the bump.

    `bump_s`: duration of the bump; the wave begins when the wheels are at rest again.  Returns the
    undamped natural frequency, Hz, and the damping ratio; None if nothing shows the body.
    """
    record = _record(signals, bump_s + 0.2)
    if record is None:
        return None
    frequencies = np.geomspace(*_FREQUENCY_HZ, 24)
    dampings = np.linspace(*_DAMPING, 12)
    best = (0.0, 0.0)
    for _ in range(_TURNS):
        misfit = _misfit(record, frequencies, dampings)
        i, j = divmod(int(np.argmin(misfit)), len(dampings))
        best = float(frequencies[i]), float(dampings[j])
        frequencies, dampings = _finer(frequencies, i), _finer(dampings, j)
    return best


def _finer(grid: NDArray[np.float64], place: int) -> NDArray[np.float64]:
    """Return nine points between the neighbours of the best one."""
    return np.linspace(grid[max(place - 1, 0)], grid[min(place + 1, len(grid) - 1)], 9)


def _record(signals: tuple[Trace, ...], start_s: float) -> NDArray[np.float64] | None:
    """Return the clearest record of the body, (n,), on an equidistant grid."""
    for quantities in _CLEAREST_FIRST:
        clear = [
            t
            for t in of_quantity(signals, *quantities)
            if t.peak > _CLEAR * t.noise and t.time_s[-1] > start_s + 1.0
        ]
        if not clear:
            continue
        edges = np.arange(start_s, min(t.time_s[-1] for t in clear), _STEP_S)
        rows = np.array([_means(trace, edges) for trace in clear])
        if quantities[0] is Quantity.SUSPENSION_TRAVEL:
            u, _, _ = np.linalg.svd(rows, full_matrices=False)
            return np.asarray(u[:, 0] @ rows)
        noise = np.array([max(t.noise, 1e-12) for t in clear])
        return np.asarray(rows[int(np.argmax(np.std(rows, axis=1) / noise))])
    return None


def _means(trace: Trace, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of each step, or the value between two samples if it has none."""
    first = np.searchsorted(trace.time_s, edges)
    last = np.append(first[1:], np.searchsorted(trace.time_s, edges[-1] + _STEP_S))
    total = np.concatenate([[0.0], np.cumsum(trace.value)])
    straight = np.interp(edges + _STEP_S / 2, trace.time_s, trace.value)
    mean = (total[last] - total[first]) / np.maximum(last - first, 1)
    return np.where(last > first, mean, straight)


def _misfit(
    record: NDArray[np.float64], frequencies: NDArray[np.float64], dampings: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the residual sum of squares of each wave with the best amplitude, phase and level.

    The sum of squares of the record, which is the same for all, is left out.
    """
    time_s = np.arange(len(record)) * _STEP_S
    omega = 2 * np.pi * frequencies[:, None]
    envelope = np.exp(-(omega * dampings)[..., None] * time_s)
    phase = (omega * np.sqrt(1.0 - dampings**2))[..., None] * time_s
    ones = np.ones_like(envelope)
    basis = np.stack([envelope * np.cos(phase), envelope * np.sin(phase), ones], axis=-1)
    normal = np.einsum("fdti,fdtj->fdij", basis, basis)
    projection = np.einsum("fdti,t->fdi", basis, record)
    solution = np.linalg.solve(normal, projection[..., None])[..., 0]
    return np.asarray(-np.einsum("fdi,fdi->fd", projection, solution))
