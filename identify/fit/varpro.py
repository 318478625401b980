"""Fits the linear part of free decays at one point of the unknowns, and returns normal blocks.

The initial state of a run, a constant per channel (sensor bias, gravity) and the transients of a
sensor's low-pass enter linearly.  They are fitted exactly and projected out, so that only the
unknowns of the grey box are iterated (variable projection).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..model.exponentials import (
    Series,
    Spectrum,
    low_pass_of,
    real_functions,
    series_of,
    spectrum,
    waves_of,
)
from ..model.matrices import Complex, Real
from .grey_box import GreyBox

_N_STATES = 14  # 7 positions, 7 velocities


@dataclass(frozen=True, slots=True)
class GroupModel:
    """A channel group at one point of the unknowns: what all its recordings have in common.

    Its channels are sums of the real functions of p rates (`real_functions`), its basis: the h
    rates of the vehicle (`Spectrum.half`), those of its low-pass, and 0.  `gained`: output rows in
    modal coordinates times the gain of the low-pass.
    """

    rates: Complex
    """All rates, rad/s, shape (p,)."""
    motion: NDArray[np.intp]
    """Indices of the functions that the vehicle's motion consists of, shape (4 h,)."""
    channel_functions: NDArray[np.intp]
    """Indices of the functions that each channel has by itself: the transients of its low-pass and
    a constant."""
    on_state: Real
    """Matrices from the initial state to the functions of the motion, (n_channels, 4 h, 14)."""
    gained: Complex
    """Shape (n_channels, h)."""
    gain_slope: Complex
    """The rows times the derivative of the gain by the pole, s, shape (n_channels, h)."""
    d_gained: Complex
    """Change of `gained` with each unknown, by the rows and by the eigenvectors, shape (n_channels,
    h, P)."""
    weight: Real
    """Inverse variance of each channel's noise, shape (n_channels,)."""
    lateness_s: float
    """Lateness beyond the nominal one, s."""
    lateness_index: int | None
    """Index of the unknown that is this lateness; None if it is exact."""


@dataclass(frozen=True, slots=True)
class StateModel:
    """A mass state at one point of the unknowns."""

    box: GreyBox
    modes: Spectrum
    """Eigenvalues and eigenvectors of the state matrix."""
    mixing: Complex
    shift: Complex
    """`mixing`, `shift`: of the modes and of the poles with each unknown, first and third of
    `Spectrum.change`."""
    groups: tuple[GroupModel, ...]
    """Channel groups in the order of `box.groups`."""

    def group(self, group: ChannelGroup) -> GroupModel:
        """Return a channel group at this point."""
        return self.groups[self.box.groups.index(group)]

    def basis(self, recording: Recording) -> Real:
        """Return the functions that the recording consists of, (n_samples, 4 p).

        They are taken at the times at which the motion was as sampled, by the estimated lateness.
        """
        group = self.group(recording.group)
        return real_functions(recording.time_s - group.lateness_s, group.rates)


def evaluate(
    box: GreyBox, eta: Real, mass_states: Collection[str], sigma: Mapping[str, float]
) -> dict[str, StateModel]:
    """Return some mass states' models at the unknowns `eta`; `sigma`: noise of each channel, SI."""
    points, delays_s = {}, box.delays_s(eta).tolist()
    for name, system in box.systems(eta, mass_states).items():
        modes = spectrum(system.A)
        half, (mixing, mixing_into, shift) = modes.half, modes.change(system.dA)
        groups = []
        for i, (group, lateness_s) in enumerate(zip(box.groups, delays_s, strict=True)):
            low_pass = low_pass_of(group.channels[0])  # all channels of a group have it
            filter_poles = low_pass.poles[low_pass.poles.imag >= 0.0]
            rates = np.concatenate([modes.poles[half], filter_poles, [0.0]])
            # Functions of p rates: Re exp, t Re exp, Im exp, t Im exp; real rates have no Im.
            p, oscillating = len(rates), len(half) + np.flatnonzero(filter_poles.imag > 0.0)
            gain, gain_slope = low_pass.gain(modes.poles), low_pass.gain_slope(modes.poles)
            rows = np.array([system.rows[c.name] for c in group.channels]) @ modes.V
            d_rows = np.array([system.d_rows[c.name] for c in group.channels]) @ modes.V
            gained = (rows * gain)[:, half]
            by_eigenvectors = _along(rows, mixing_into) * gain[half, None]
            groups.append(
                GroupModel(
                    rates=rates,
                    motion=np.add.outer(p * np.arange(4), np.arange(len(half))).ravel(),
                    channel_functions=np.r_[len(half) : p, 2 * p + oscillating],
                    on_state=modes.on_real_functions(gained[..., None] * modes.W[half]),
                    gained=gained,
                    gain_slope=(rows * gain_slope)[:, half],
                    d_gained=(d_rows * gain)[..., half].swapaxes(1, 2) - by_eigenvectors,
                    weight=np.array([sigma[c.name] ** -2 for c in group.channels]),
                    lateness_s=lateness_s,
                    lateness_index=box.delay_index(i),
                )
            )
        points[name] = StateModel(box, modes, mixing, shift, tuple(groups))
    return points


def _along(vectors: Complex, matrices: Complex) -> Complex:
    """Return the products of some vectors, (.., n), with P matrices, (n, h, P): (.., h, P)."""
    product = vectors @ matrices.reshape(len(matrices), -1)
    return product.reshape(*vectors.shape[:-1], *matrices.shape[1:])


# Products of the functions of a fit with each other and with the samples --------------------------


@dataclass(frozen=True, slots=True)
class Products:
    """Products of a recording with the basis."""

    gram: Real
    """Products of the basis functions with each other, summed over the samples, shape (m, m)."""
    cross: Real
    """Products with the samples, shape (m, n_channels)."""
    power: Real
    """Sum of squares of the samples, shape (n_channels,)."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Recordings of one mass state that have one low-pass and are sampled alike."""

    mass_state: str
    groups: tuple[ChannelGroup, ...]
    """Channel group of each."""
    indices: tuple[tuple[int, int], ...]
    """Of each, the index of its decay, and its own among the recordings of this decay."""
    series: Series


def batches_of(decays: Sequence[FreeDecay]) -> tuple[Batch, ...]:
    """Return the recordings of some decays by mass state, low-pass and sampling."""
    indices_of: defaultdict[tuple[str, float, int], list[tuple[int, int]]] = defaultdict(list)
    for d, decay in enumerate(decays):
        for r, recording in enumerate(decay.recordings):
            channel = recording.group.channels[0]  # all channels of a group have its low-pass
            indices_of[decay.mass_state, channel.low_pass_hz, channel.low_pass_order].append((d, r))
    batches = []
    for (mass_state, _, _), indices in indices_of.items():
        recordings = [decays[d].recordings[r] for d, r in indices]
        for series in series_of([r.time_s for r in recordings], [r.values for r in recordings]):
            groups = tuple(recordings[member].group for member in series.members)
            of_series = tuple(indices[member] for member in series.members)
            batches.append(Batch(mass_state, groups, of_series, series))
    return tuple(batches)


# The linear part of a decay -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LinearPart:
    """The linear part of one decay, fitted."""

    products: tuple[Products, ...]
    """Products of each recording with its basis."""
    coefficients: tuple[Real, ...]
    """Matrices from the linear unknowns to the basis of each recording, each (n_channels, m,
    n_linear)."""
    normal_inverse: Real
    """Covariance of the linear unknowns with all others known, shape (n_linear, n_linear)."""
    solution: Real
    """Initial state, then the channels' own unknowns, shape (n_linear,)."""


def _products_of(
    points: Mapping[str, StateModel], decays: Sequence[FreeDecay], batches: Sequence[Batch]
) -> list[list[Products]]:
    """Return the products of each decay's recordings with the basis, in their order."""
    by_recording: list[dict[int, Products]] = [{} for _ in decays]
    for batch in batches:
        point = points[batch.mass_state]
        groups = [point.group(group) for group in batch.groups]
        wave = waves_of(batch.series, groups[0].rates, np.array([g.lateness_s for g in groups]))
        # Twice the products of real and imaginary parts: Re f Re g = Re(conj(f) g + f g) / 2,
        # Re f Im g = Im(conj(f) g + f g) / 2, and Im f Im g = Re(conj(f) g - f g) / 2.
        conjugate, plain = wave.grams()
        total, gap = conjugate + plain, conjugate - plain
        transposed = total.imag.swapaxes(1, 2)
        grams = np.block([[total.real, total.imag], [transposed, gap.real]]) / 2.0
        sums = wave.with_samples()  # (r, n_channels, 2 p)
        crosses = np.concatenate([sums.real, sums.imag], axis=2).swapaxes(1, 2)
        power = batch.series.power
        for (d, r), *products in zip(batch.indices, grams, crosses, power, strict=True):
            by_recording[d][r] = Products(*products)
    return [[of_decay[r] for r in range(len(of_decay))] for of_decay in by_recording]


def linear_coefficients(point: StateModel, decay: FreeDecay) -> tuple[Real, ...]:
    """Return each linear unknown's contribution to each channel, on its recording's basis.

    The linear unknowns are the initial state of the decay, then for each channel of each recording
    the transients of its low-pass and its constant.  Each (n_channels, m, n_linear).
    """
    groups = [point.group(r.group) for r in decay.recordings]
    n_own = sum(len(group.channel_functions) * len(group.weight) for group in groups)
    result = []
    column = _N_STATES
    for group in groups:
        stack = np.zeros((len(group.weight), 4 * len(group.rates), _N_STATES + n_own))
        stack[:, group.motion, :_N_STATES] = group.on_state
        n_functions = len(group.channel_functions)
        for of_channel in stack:  # a column for each function that it has by itself
            of_channel[group.channel_functions, column + np.arange(n_functions)] = 1.0
            column += n_functions
        result.append(stack)
    return tuple(result)


def pseudo_inverse(normal: Real) -> Real:
    """Return inverses of normal matrices, (.., n, n); zero in directions that no data determine."""
    diagonal = np.diagonal(normal, axis1=-2, axis2=-1)
    scale = np.where(diagonal > 0.0, np.where(diagonal > 0.0, diagonal, 1.0) ** -0.5, 0.0)
    scales = scale[..., :, None] * scale[..., None, :]
    # Directions below 1e-12 of the strongest are not observed.
    return np.asarray(np.linalg.pinv(normal * scales, 1e-12, hermitian=True) * scales)


@dataclass(frozen=True, slots=True)
class NormalBlock:
    """Contribution of one decay to the normal equations, its linear part eliminated."""

    cost: float
    """Squared residuals in units of sigma."""
    information: Real
    """Normal matrix, shape (P, P)."""
    gradient: Real
    """Right-hand side, shape (P,)."""


def slopes(point: StateModel, group: GroupModel, z: Complex) -> Real:
    """Return each channel's derivative by each unknown on the motion, (.., n_channels, 4 h, P).

    The propagator ``H(A) exp(A t)`` changes by the divided differences of ``H(l) exp(l t)``
    (Daleckii and Krein).  `z`, (.., 14): initial state of one decay, or of several, in modal
    coordinates.
    """
    modes = point.modes
    by_mixing = _along(z, point.mixing)[..., None, :, :]
    by_shift = _along(z, point.shift)[..., None, :, :]
    half_state = z[..., None, modes.half, None]
    on_exp = group.gained[..., None] * by_mixing
    on_exp += group.gain_slope[..., None] * by_shift
    on_exp += group.d_gained * half_state
    if group.lateness_index is not None:
        speed = (modes.poles * z)[..., None, modes.half]  # what is later shows an earlier motion
        on_exp[..., group.lateness_index] -= group.gained * speed
    return modes.on_real_functions(on_exp, group.gained[..., None] * by_shift)


# Normal equations of many decays at one point of the unknowns -------------------------------------
#
# The runs of a mass state differ only in their samples and initial states: everything that belongs
# to the model is computed once, and numbers of one kind are arrays whose first axis is the decay.


def blocks_of(
    points: Mapping[str, StateModel], decays: Sequence[FreeDecay], batches: Sequence[Batch]
) -> list[tuple[NormalBlock, LinearPart]]:
    """Return the contribution of each decay to the normal equations, and its fitted linear part.

    `points`: the model, for each mass state.  `batches`: the recordings, by `batches_of`.
    """
    of_decays = _products_of(points, decays, batches)
    same_channels: defaultdict[tuple[object, ...], list[int]] = defaultdict(list)
    for d, decay in enumerate(decays):
        groups = tuple(points[decay.mass_state].box.groups.index(r.group) for r in decay.recordings)
        same_channels[decay.mass_state, *groups].append(d)
    by_decay: dict[int, tuple[NormalBlock, LinearPart]] = {}
    for members in same_channels.values():
        first = decays[members[0]]
        blocks = _blocks_of_alike(points[first.mass_state], first, [of_decays[d] for d in members])
        by_decay |= dict(zip(members, blocks, strict=True))
    return [by_decay[d] for d in range(len(decays))]


def _blocks_of_alike(
    point: StateModel, first: FreeDecay, of_decays: Sequence[Sequence[Products]]
) -> Iterator[tuple[NormalBlock, LinearPart]]:
    """Yield the contributions and linear parts of n decays with the same channels as the first.

    The linear part is fitted first; what it leaves then meets the slopes J by the unknowns.  All
    are sums over recordings, channels and the functions of the basis, never over samples.
    """
    stacks = linear_coefficients(point, first)
    n, n_linear, P = len(of_decays), stacks[0].shape[-1], len(point.box.prior_sigma)
    normal, rhs = np.zeros((n, n_linear, n_linear)), np.zeros((n, n_linear))
    cost = np.zeros(n)
    by_recording = []
    for i, (recording, stack) in enumerate(zip(first.recordings, stacks, strict=True)):
        group = point.group(recording.group)
        weight = group.weight
        gram = np.stack([products[i].gram for products in of_decays])[:, None]  # (n, 1, m, m)
        cross = np.stack([products[i].cross.T for products in of_decays])  # (n, n_channels, m)
        weighted_stack = (stack * weight[:, None, None]).reshape(-1, n_linear)
        normal += weighted_stack.T @ (gram @ stack).reshape(n, -1, n_linear)
        rhs += cross.reshape(n, -1) @ weighted_stack
        cost += np.stack([products[i].power for products in of_decays]) @ weight
        by_recording.append((group, stack, weighted_stack, gram, cross))
    inverse = pseudo_inverse(normal)
    solution = (inverse @ rhs[..., None])[..., 0]
    modal_state = solution[:, :_N_STATES] @ point.modes.W.T
    information, mixed, gradient = np.zeros((n, P, P)), np.zeros((n, n_linear, P)), np.zeros((n, P))
    for group, stack, weighted_stack, gram, cross in by_recording:
        fitted = np.moveaxis(stack @ solution.T, 2, 0)  # (n, n_channels, m)
        residual_cross = cross - (fitted[:, :, None] @ gram)[:, :, 0]  # basis times residuals
        J = slopes(point, group, modal_state)  # (n, n_channels, 4 h, P)
        GJ = gram[..., group.motion] @ J
        weighted_J = (J * group.weight[:, None, None]).reshape(n, -1, P)
        cost -= np.sum(fitted * (cross + residual_cross), axis=2) @ group.weight
        information += weighted_J.swapaxes(1, 2) @ GJ[:, :, group.motion].reshape(n, -1, P)
        mixed += weighted_stack.T @ GJ.reshape(n, -1, P)
        gradient += (residual_cross[:, :, group.motion].reshape(n, 1, -1) @ weighted_J)[:, 0]
    information -= mixed.swapaxes(1, 2) @ inverse @ mixed  # the linear part follows the unknowns
    for i, products in enumerate(of_decays):
        linear = LinearPart(tuple(products), stacks, inverse[i], solution[i])
        yield NormalBlock(float(cost[i]), information[i], gradient[i]), linear
