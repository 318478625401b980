"""Maximum likelihood on the free decays: physical parameters, their covariance, the residuals.

White Gaussian noise of known level per channel, so the estimate is the weighted least-squares fit
of the free decays of all runs and mass states at once (output error).  The initial state of each
run and a constant per channel and run enter linearly and are projected out exactly; only the
unknowns of the grey box are iterated, by Levenberg-Marquardt.  The inverse of the projected normal
matrix is the covariance; at the optimum it is the Cramer-Rao bound (METHOD, section 5).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .decay import Clock, FreeDecay
from .exponentials import Products, Spectrum, products, spectrum
from .greybox import GreyBox, System

_N = 14  # states of the vehicle
_MAX_STEP = 0.5  # largest change of a logarithm in one iteration
_RANK = 1e-12  # directions of the initial state below this, relative, are not observed


@dataclass(frozen=True, slots=True)
class Fit:
    """The optimum.

    Parameters
    ----------
    eta : (P,) float64
        Unknowns of the grey box.
    covariance : (P, P) float64
        Of `eta`; infinite on the diagonal where the data do not determine it.
    cost : float
        Sum of squared residuals in units of sigma, priors included.
    iterations : int
        Levenberg-Marquardt steps taken.
    converged : bool
        Whether the last step was below the tolerance.
    """

    eta: NDArray[np.float64]
    covariance: NDArray[np.float64]
    cost: float
    iterations: int
    converged: bool


@dataclass(frozen=True, slots=True)
class Residuals:
    """What a fit leaves of one decay.

    Parameters
    ----------
    label : str
        Of the run.
    values : mapping of channel name to (n,) float64
        Measured minus fitted, SI.
    freedom : mapping of channel name to float
        Samples less the share of the fitted constants and initial states.
    """

    label: str
    values: Mapping[str, NDArray[np.float64]]
    freedom: Mapping[str, float]


def fit(
    box: GreyBox,
    decays: tuple[FreeDecay, ...],
    sigma: Mapping[str, float],
    start: NDArray[np.float64],
    tolerance: float = 1e-3,
    max_iterations: int = 60,
) -> Fit:
    """Find the most likely unknowns.

    Parameters
    ----------
    box : GreyBox
        Structure.
    decays : tuple of FreeDecay
        All runs of all mass states.
    sigma : mapping of channel name to float
        Standard deviation of the noise, SI.
    start : (P,) float64
        Where to begin.
    tolerance : float
        Stop when a step changes no unknown by more than this share of its standard deviation
        (that with all others known, the smallest one there is).
    max_iterations : int
        Give up after so many steps.

    Returns
    -------
    Fit
    """
    eta = start.copy()
    cost, normal, gradient = _normal_equations(box, decays, sigma, eta)
    # What rounding leaves of a difference of large sums; a cost can be compared no better.
    rounding = 1e-13 * sum(
        float(np.sum((r.values / [sigma[c.name] for c in r.clock.channels]) ** 2))
        for decay in decays
        for r in decay.recordings
    )
    damping = 1e-3
    converged = False
    iterations = 0
    while iterations < max_iterations and not converged:
        iterations += 1
        diagonal = np.diag(normal)
        scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        H = normal / np.outer(scale, scale)
        step = np.linalg.solve(H + damping * np.eye(len(eta)), gradient / scale) / scale
        step *= min(1.0, _MAX_STEP / max(float(np.max(np.abs(step))), 1e-300))
        trial = _normal_equations(box, decays, sigma, eta + step)
        if np.isfinite(trial[0]) and trial[0] <= cost + rounding:
            converged = damping < 1e-3 and float(np.max(np.abs(step) * scale)) < tolerance
            eta, (cost, normal, gradient) = eta + step, trial
            damping = max(damping / 10, 1e-12)
        elif damping > 1e8:
            break
        else:
            damping *= 10 if damping > 1e-9 else 1e6
    return Fit(eta, _covariance(normal), cost, iterations, converged)


def _covariance(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert the normal matrix; unknowns it leaves undetermined get an infinite variance."""
    diagonal = np.diag(normal)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    good = values > 1e-11 * values[-1]
    inverse = np.where(good, 1 / np.where(good, values, 1.0), 0.0)
    covariance = (vectors * inverse) @ vectors.T * np.outer(scale, scale)
    lost = (np.abs(vectors[:, ~good]) > 1e-3).any(axis=1)
    covariance[lost, lost] = np.inf
    return np.asarray(covariance)


def _normal_equations(
    box: GreyBox,
    decays: tuple[FreeDecay, ...],
    sigma: Mapping[str, float],
    eta: NDArray[np.float64],
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return cost, normal matrix (P, P) and right-hand side (P,), linear parts eliminated."""
    prior = 1 / box.prior_sigma**2
    n = len(box.parameters)
    cost = float(np.sum(eta[n:] ** 2 * prior[n:]))
    normal = np.diag(prior)
    gradient = np.concatenate([np.zeros(n), -eta[n:] * prior[n:]])
    delays = box.delays_s(eta)
    for state in {decay.mass_state for decay in decays}:
        system = box.system(eta, state)
        modes = spectrum(system.A)
        for decay in decays:
            if decay.mass_state == state:
                seen = _seen(box, decay, modes, delays)
                linear = _linear(decay, seen, system, modes, sigma)
                c, H, g = _reduced(box, decay, seen, system, modes, sigma, linear)
                cost += c
                normal += H
                gradient += g
    return cost, normal, gradient


def _seen(
    box: GreyBox, decay: FreeDecay, modes: Spectrum, delays: NDArray[np.float64]
) -> list[Products]:
    return [
        products(modes.basis(r.time_s - delays[box.clocks.index(r.clock)]), r.values)
        for r in decay.recordings
    ]


@dataclass(frozen=True, slots=True)
class _Linear:
    """Solution for the initial state and the constants of one decay."""

    coefficients: list[NDArray[np.float64]]  # per recording (n_channels, m, n_linear)
    normal_inverse: NDArray[np.float64]
    solution: NDArray[np.float64]  # initial state, then a constant per channel


def _linear(
    decay: FreeDecay,
    seen: list[Products],
    system: System,
    modes: Spectrum,
    sigma: Mapping[str, float],
) -> _Linear:
    n_channels = sum(len(r.clock.channels) for r in decay.recordings)
    size = _N + n_channels
    normal = np.zeros((size, size))
    right = np.zeros(size)
    coefficients = []
    column = _N
    for recording, product in zip(decay.recordings, seen, strict=True):
        stack = np.zeros((len(recording.clock.channels), 2 * _N + 1, size))
        for c, channel in enumerate(recording.clock.channels):
            row = system.rows[channel.name] @ modes.V
            stack[c, : 2 * _N, :_N] = (modes.to_real[:-1, :_N] @ (row[:, None] * modes.W)).real
            stack[c, -1, column] = 1.0
            column += 1
            weight = sigma[channel.name] ** -2
            normal += weight * stack[c].T @ product.gram @ stack[c]
            right += weight * stack[c].T @ product.cross[:, c]
        coefficients.append(stack)
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    good = values > _RANK * values[-1]
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T * np.outer(scale, scale)
    return _Linear(coefficients, inverse, inverse @ right)


def _reduced(
    box: GreyBox,
    decay: FreeDecay,
    seen: list[Products],
    system: System,
    modes: Spectrum,
    sigma: Mapping[str, float],
    linear: _Linear,
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the part of one decay in cost, normal matrix and right-hand side."""
    P = len(box.prior_sigma)
    size = len(linear.solution)
    cost = 0.0
    H = np.zeros((P, P))
    mixed = np.zeros((size, P))
    g = np.zeros(P)
    z = modes.W @ linear.solution[:_N]
    for recording, product, stack in zip(decay.recordings, seen, linear.coefficients, strict=True):
        slopes = _slopes(box, recording.clock, system, modes, z)
        cost += _squares(product, stack @ linear.solution, recording.clock, sigma)
        for c, channel in enumerate(recording.clock.channels):
            weight = sigma[channel.name] ** -2
            fitted = stack[c] @ linear.solution
            left = product.cross[:, c] - product.gram @ fitted
            J = slopes[c]
            GJ = product.gram @ J
            H += weight * J.T @ GJ
            mixed += weight * stack[c].T @ GJ
            g += weight * J.T @ left
    return cost, H - mixed.T @ linear.normal_inverse @ mixed, g


def _slopes(
    box: GreyBox, clock: Clock, system: System, modes: Spectrum, z: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return each channel's derivative by each unknown on the real basis, (n_channels, m, P)."""
    rows = np.array([system.rows[c.name] for c in clock.channels]) @ modes.V
    d_rows = np.array([system.d_rows[c.name] for c in clock.channels]) @ modes.V
    on = modes.propagator_slope(rows, system.dA, z)  # (P, n_channels, 2 N)
    on[..., :_N] += (d_rows * z).swapaxes(0, 1)
    late = box.delay_index(box.clocks.index(clock))
    if late is not None:
        on[late, :, :_N] -= rows * modes.poles * z
    slopes = np.zeros((len(clock.channels), 2 * _N + 1, len(on)))
    slopes[:, :-1] = (on @ modes.to_real[:-1, :-1].T).real.transpose(1, 2, 0)
    return slopes


def misfit(
    box: GreyBox,
    decay: FreeDecay,
    sigma: Mapping[str, float],
    eta: NDArray[np.float64],
    system: System,
) -> float:
    """Return the sum of squared residuals of one decay in units of sigma, its linear parts fitted.

    `system` is ``box.system(eta, decay.mass_state)``, handed in because a scan asks often.
    """
    modes = spectrum(system.A)
    seen = _seen(box, decay, modes, box.delays_s(eta))
    linear = _linear(decay, seen, system, modes, sigma)
    return sum(
        _squares(product, stack @ linear.solution, recording.clock, sigma)
        for recording, product, stack in zip(
            decay.recordings, seen, linear.coefficients, strict=True
        )
    )


def _squares(
    product: Products,
    fitted: NDArray[np.float64],
    clock: Clock,
    sigma: Mapping[str, float],
) -> float:
    """Return the weighted squared residuals of one recording; `fitted` is (n_channels, m)."""
    weight = np.array([sigma[channel.name] ** -2 for channel in clock.channels])
    left = product.cross.T - fitted @ product.gram
    explained = np.einsum("cm,mc->c", fitted, product.cross) + np.einsum("cm,cm->c", fitted, left)
    return float(weight @ (product.power - explained))


def residuals(
    box: GreyBox,
    decays: tuple[FreeDecay, ...],
    sigma: Mapping[str, float],
    eta: NDArray[np.float64],
) -> tuple[Residuals, ...]:
    """Return what the model at `eta` leaves of each decay."""
    delays = box.delays_s(eta)
    result = []
    for decay in decays:
        system = box.system(eta, decay.mass_state)
        modes = spectrum(system.A)
        seen = _seen(box, decay, modes, delays)
        linear = _linear(decay, seen, system, modes, sigma)
        values: dict[str, NDArray[np.float64]] = {}
        freedom: dict[str, float] = {}
        for r, product, stack in zip(decay.recordings, seen, linear.coefficients, strict=True):
            basis = modes.basis(r.time_s - delays[box.clocks.index(r.clock)])
            for c, channel in enumerate(r.clock.channels):
                values[channel.name] = r.values[:, c] - basis @ (stack[c] @ linear.solution)
                share = stack[c].T @ product.gram @ stack[c] * linear.normal_inverse
                freedom[channel.name] = (
                    len(r.values) - float(share.sum()) / sigma[channel.name] ** 2
                )
        result.append(Residuals(decay.label, values, freedom))
    return tuple(result)
