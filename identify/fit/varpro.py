"""One free decay at one point of the unknowns: its linear part fitted, its share of the problem.

The initial state of a run, a constant per channel (sensor bias, gravity) and the transients of a
sensor's low-pass enter linearly.  They are fitted exactly and projected out, so that only the
unknowns of the grey box are iterated (variable projection).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..model.exponentials import Change, Products, Spectrum, products, spectrum
from ..model.low_pass import low_pass_of
from .grey_box import GreyBox, System

_N = 14  # states of the vehicle
_RANK = 1e-12  # directions of the linear part below this, relative, are not observed
_CERTAIN = 0.01
"""Condition in units of 1 / `_RANK` below which every direction is shown: that by column sums is
never below that by eigenvalues."""


@dataclass(frozen=True, slots=True)
class Evaluated:
    """A mass state at one point of the unknowns."""

    box: GreyBox
    """Structure of the problem."""
    system: System
    """State matrix and output rows with their derivatives."""
    modes: Spectrum
    """Eigenvalues and eigenvectors of the state matrix."""
    change: Change
    """Change of the state matrix with each unknown."""
    delays_s: NDArray[np.float64]
    """Lateness of each group beyond its nominal one, shape (n_groups,)."""
    sigma: Mapping[str, float]
    """Standard deviation of the noise, SI."""

    def time_s(self, recording: Recording) -> NDArray[np.float64]:
        """Return when the motion was as sampled, lateness as estimated."""
        late = float(self.delays_s[self.box.groups.index(recording.group)])
        return recording.time_s - late

    def basis(self, recording: Recording) -> NDArray[np.float64]:
        """Return the functions that the recording consists of, (n_samples, 28 + order + 1)."""
        time = self.time_s(recording)
        own = low_pass_of(recording.group.channels[0]).transients(time)
        return np.hstack([self.modes.basis(time), own, np.ones((len(time), 1))])

    def weights(self, group: ChannelGroup) -> NDArray[np.float64]:
        """Return the inverse variance of each channel of a group."""
        return np.array([self.sigma[channel.name] ** -2 for channel in group.channels])


def evaluate(
    box: GreyBox, eta: NDArray[np.float64], mass_state: str, sigma: Mapping[str, float]
) -> Evaluated:
    """Evaluate a mass state at the unknowns `eta`."""
    system = box.system(eta, mass_state)
    modes = spectrum(system.A)
    return Evaluated(box, system, modes, modes.change(system.dA), box.delays_s(eta), sigma)


@dataclass(frozen=True, slots=True)
class LinearPart:
    """The linear part of one decay, fitted."""

    products: tuple[Products, ...]
    """Products of each recording with its basis."""
    coefficients: tuple[NDArray[np.float64], ...]
    """From the linear unknowns to the basis, for each recording, each shape (n_channels, m,
    n_linear)."""
    normal_inverse: NDArray[np.float64]
    """Their covariance with everything else known, shape (n_linear, n_linear)."""
    solution: NDArray[np.float64]
    """Initial state, then what is the channels' own, shape (n_linear,)."""


def linear_part(at: Evaluated, decay: FreeDecay) -> LinearPart:
    """Fit the linear part of a decay."""
    seen = tuple(products(at.basis(r), r.values) for r in decay.recordings)
    coefficients = linear_coefficients(at, decay)
    size = coefficients[0].shape[-1]
    normal, right = np.zeros((size, size)), np.zeros(size)
    for recording, product, stack in zip(decay.recordings, seen, coefficients, strict=True):
        weight = at.weights(recording.group)
        weighted = stack * weight[:, None, None]
        normal += _over_channels(weighted, product.gram @ stack)
        right += np.einsum("cms,mc->s", weighted, product.cross)
    inverse = pseudo_inverse(normal)
    return LinearPart(seen, coefficients, inverse, inverse @ right)


def linear_coefficients(at: Evaluated, decay: FreeDecay) -> tuple[NDArray[np.float64], ...]:
    """Return what each linear unknown contributes to each channel, on the basis of its recording.

    Returns
    -------
    tuple of (n_channels, m, n_linear) float64
        One for each recording.
    """
    modes = at.modes
    own = [1 + len(low_pass_of(r.group.channels[0]).poles) for r in decay.recordings]
    total = sum(n * len(r.group.channels) for n, r in zip(own, decay.recordings, strict=True))
    result = []
    column = _N
    for n_own, recording in zip(own, decay.recordings, strict=True):
        group = recording.group
        gain = low_pass_of(group.channels[0]).gain(modes.poles)
        rows = _modal_rows(at, group) * gain
        stack = np.zeros((len(rows), 2 * _N + n_own, _N + total))
        stack[:, : 2 * _N, :_N] = (modes.to_real[:, :_N] @ (rows[..., None] * modes.W)).real
        for c in range(len(rows)):
            stack[c, 2 * _N :, column : column + n_own] = np.eye(n_own)
            column += n_own
        result.append(stack)
    return tuple(result)


def pseudo_inverse(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert a normal matrix; directions that the data do not show stay zero."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * np.outer(scale, scale)
    inverse = _plain_inverse(scaled)
    if inverse is None:
        values, vectors = np.linalg.eigh(scaled)
        good = values > _RANK * values[-1]
        inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    return np.asarray(inverse * np.outer(scale, scale))


def _plain_inverse(scaled: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the inverse where the data show every direction, in a tenth of the time, else None."""
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return None
    condition = np.linalg.norm(scaled, 1) * np.linalg.norm(inverse, 1)
    return 0.5 * (inverse + inverse.T) if condition < _CERTAIN / _RANK else None


def _modal_rows(at: Evaluated, group: ChannelGroup) -> NDArray[np.complex128]:
    rows = np.array([at.system.rows[c.name] for c in group.channels])
    return np.asarray(rows @ at.modes.V)


@dataclass(frozen=True, slots=True)
class NormalBlock:
    """Contribution of one decay to the normal equations, its linear part eliminated."""

    cost: float
    """Squared residuals in units of sigma."""
    information: NDArray[np.float64]
    """Normal matrix, shape (P, P)."""
    gradient: NDArray[np.float64]
    """Right-hand side, shape (P,)."""


def normal_block(at: Evaluated, decay: FreeDecay) -> NormalBlock:
    """Return the share of one decay in cost, normal matrix and right-hand side."""
    linear = linear_part(at, decay)
    P = len(at.box.prior_sigma)
    H, g = np.zeros((P, P)), np.zeros(P)
    mixed = np.zeros((len(linear.solution), P))
    z = at.modes.W @ linear.solution[:_N]
    cost = 0.0
    for recording, product, stack in zip(
        decay.recordings, linear.products, linear.coefficients, strict=True
    ):
        weight = at.weights(recording.group)
        fitted = stack @ linear.solution
        J = slopes(at, recording.group, z)
        GJ = product.gram[:, : 2 * _N] @ J  # (n_channels, m, P)
        left = product.cross.T - fitted @ product.gram
        cost += _squares(product, fitted, weight)
        weighted = J * weight[:, None, None]
        H += _over_channels(weighted, GJ[:, : 2 * _N])
        mixed += _over_channels(stack * weight[:, None, None], GJ)
        g += np.einsum("cmp,cm->p", weighted, left[:, : 2 * _N])
    return NormalBlock(cost, H - mixed.T @ linear.normal_inverse @ mixed, g)


def slopes(at: Evaluated, group: ChannelGroup, z: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return each channel's derivative by each unknown on the real basis, (n_channels, 28, P).

    Parameters
    ----------
    at : Evaluated
        Where.
    group : ChannelGroup
        Whose channels.
    z : (14,) complex128
        Initial state in modal coordinates.
    """
    modes, low_pass = at.modes, low_pass_of(group.channels[0])
    rows = _modal_rows(at, group)
    d_rows = np.array([at.system.d_rows[c.name] for c in group.channels]) @ modes.V
    gain = low_pass.gain(modes.poles)
    on = modes.propagator_slope(rows, at.change, z, low_pass)  # (P, n_channels, 28)
    on[..., :_N] += (d_rows * gain * z).swapaxes(0, 1)
    late = at.box.delay_index(at.box.groups.index(group))
    if late is not None:
        on[late, :, :_N] -= rows * gain * modes.poles * z
    return np.asarray((on @ modes.to_real.T).real.transpose(1, 2, 0))


def motion(
    at: Evaluated, group: ChannelGroup, z: NDArray[np.complex128], derivative: int
) -> NDArray[np.float64]:
    """Return what the vehicle's motion gives in each channel, on the real basis, (n_channels, 28).

    Parameters
    ----------
    at : Evaluated
        Where.
    group : ChannelGroup
        Whose channels.
    z : (14,) complex128
        Initial state in modal coordinates.
    derivative : int
        Of the motion by time: 0 for the motion itself, 1 for its rate of change.
    """
    modes = at.modes
    gain = low_pass_of(group.channels[0]).gain(modes.poles)
    on_exp = _modal_rows(at, group) * (gain * z * modes.poles**derivative)
    return np.asarray((on_exp @ modes.to_real[:, :_N].T).real)


def _over_channels(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply (n_channels, m, p) with (n_channels, m, q), summed over channels and functions."""
    return np.asarray(left.reshape(-1, left.shape[-1]).T @ right.reshape(-1, right.shape[-1]))


def _squares(product: Products, fitted: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Return the weighted squared residuals of one recording; `fitted` is (n_channels, m)."""
    left = product.cross.T - fitted @ product.gram
    explained = np.einsum("cm,mc->c", fitted, product.cross) + np.einsum("cm,cm->c", fitted, left)
    return float(weight @ (product.power - explained))
