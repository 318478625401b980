"""Fits the linear part of free decays at one point of the unknowns, and returns normal blocks.

The initial state of a run, a constant per channel (sensor bias, gravity) and the transients of a
sensor's low-pass enter linearly.  They are fitted exactly and projected out, so that only the
unknowns of the grey box are iterated (variable projection).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..model.exponentials import Change, Outputs, Spectrum, spectrum
from ..model.low_pass import LowPass, low_pass_of
from .grey_box import GreyBox, System
from .products import Alike, Products, laid_out, products, residuals

_N = 14  # states of the vehicle
_RANK = 1e-12  # directions of the linear part below this, relative, are not observed


@dataclass(frozen=True, slots=True)
class GroupAt:
    """A channel group at one point of the unknowns: what all its recordings have in common."""

    outputs: Outputs
    """Its channels in modal coordinates."""
    d_outputs: NDArray[np.complex128]
    """Change of rows times gain with each unknown, shape (n_channels, h, P); h as in `Spectrum`."""
    on_state: NDArray[np.float64]
    """Matrices from the initial state to the basis, shape (n_channels, 28, 14)."""
    low_pass: LowPass
    """Low-pass of each channel."""
    weight: NDArray[np.float64]
    """Inverse variance of each channel, shape (n_channels,)."""
    late_s: float
    """Lateness beyond the nominal one, s."""
    late: int | None
    """Index of the unknown that is this lateness; None if it is exact."""


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
    groups: tuple[GroupAt, ...]
    """Channel groups in the order of `box.groups`."""

    def group(self, group: ChannelGroup) -> GroupAt:
        """Return the group at this point."""
        return self.groups[self.box.groups.index(group)]

    def time_s(self, recording: Recording) -> NDArray[np.float64]:
        """Return the times at which the motion was as sampled, with the lateness as estimated."""
        return recording.time_s - self.group(recording.group).late_s

    def basis(self, recording: Recording) -> NDArray[np.float64]:
        """Return the functions that the recording consists of, (n_samples, 28 + order + 1)."""
        time = self.time_s(recording)
        own = self.group(recording.group).low_pass.transients(time)
        out = self.modes.basis(time, own.shape[1] + 1)
        out[:, 2 * _N : -1] = own
        out[:, -1] = 1.0
        return out

    def weights(self, group: ChannelGroup) -> NDArray[np.float64]:
        """Return the inverse variance of each channel of a group."""
        return self.group(group).weight


def evaluate(
    box: GreyBox,
    eta: NDArray[np.float64],
    mass_state: str,
    sigma: Mapping[str, float],
    modes: Spectrum | None = None,
) -> Evaluated:
    """Evaluate a mass state at the unknowns `eta`.

    `sigma`: standard deviation of the noise, SI.  `modes`: those of the same state matrix from
    another structure, if the results of both need one basis.
    """
    return _at(box, eta, box.system(eta, mass_state), sigma, modes)


def evaluate_each(
    box: GreyBox, eta: NDArray[np.float64], mass_states: Collection[str], sigma: Mapping[str, float]
) -> dict[str, Evaluated]:
    """Evaluate some mass states at the unknowns `eta`, what they share once."""
    systems = box.systems(eta, mass_states)
    return {name: _at(box, eta, system, sigma) for name, system in systems.items()}


def _at(
    box: GreyBox,
    eta: NDArray[np.float64],
    system: System,
    sigma: Mapping[str, float],
    modes: Spectrum | None = None,
) -> Evaluated:
    modes = spectrum(system.A) if modes is None else modes
    change = modes.change(system.dA)
    late_s = box.delays_s(eta).tolist()
    groups = tuple(
        _group_at(box, i, system, modes, change, sigma, late_s[i]) for i in range(len(box.groups))
    )
    return Evaluated(box, system, modes, change, groups)


def _group_at(
    box: GreyBox,
    index: int,
    system: System,
    modes: Spectrum,
    change: Change,
    sigma: Mapping[str, float],
    late_s: float,
) -> GroupAt:
    channels = box.groups[index].channels
    low_pass = low_pass_of(channels[0])
    rows = np.array([system.rows[c.name] for c in channels]) @ modes.V
    d_rows = np.array([system.d_rows[c.name] for c in channels]) @ modes.V
    outputs = modes.outputs(rows, change, low_pass)
    filtered = rows * outputs.gain
    return GroupAt(
        outputs,
        np.ascontiguousarray((d_rows * outputs.gain)[..., modes.half].swapaxes(1, 2)),
        (modes.to_real[:, :_N] @ (filtered[..., None] * modes.W)).real,
        low_pass,
        _weights(box.groups[index], sigma),
        late_s,
        box.delay_index(index),
    )


def _weights(group: ChannelGroup, sigma: Mapping[str, float]) -> NDArray[np.float64]:
    return np.array([sigma[c.name] ** -2 for c in group.channels])


@dataclass(frozen=True, slots=True)
class LinearPart:
    """The linear part of one decay, fitted."""

    products: tuple[Products, ...]
    """Products of each recording with its basis."""
    coefficients: tuple[NDArray[np.float64], ...]
    """Matrices from the linear unknowns to the basis of each recording, each (n_channels, m,
    n_linear)."""
    normal_inverse: NDArray[np.float64]
    """Covariance of the linear unknowns with all others known, shape (n_linear, n_linear)."""
    solution: NDArray[np.float64]
    """Initial state, then the channels' own unknowns, shape (n_linear,)."""


def linear_parts(
    points: Mapping[str, Evaluated], decays: Sequence[FreeDecay]
) -> tuple[LinearPart, ...]:
    """Fit the linear part of some decays; `points`: the model, for each mass state."""
    seen = products_of(points, decays, laid_out(decays))
    return tuple(linear for _, linear in blocks_of(points, decays, seen))


def products_of(
    points: Mapping[str, Evaluated], decays: Sequence[FreeDecay], layout: Sequence[Alike]
) -> list[list[Products]]:
    """Return the products of each recording of some decays.

    `points`: the model, for each mass state.  `layout`: layout of the decays, by `laid_out`.
    """
    seen: list[dict[int, Products]] = [{} for _ in decays]
    for alike in layout:
        at = points[alike.mass_state]
        found = products(alike, at.modes.poles, _late_s(at, alike))
        for (d, r), one in zip(alike.places, found, strict=True):
            seen[d][r] = one
    return [[one[r] for r in range(len(one))] for one in seen]


def residuals_left(
    points: Mapping[str, Evaluated], layout: Sequence[Alike], parts: Sequence[LinearPart]
) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Return the residuals of each recording, (n_channels, n), by decay and place in it.

    `points`, `layout`: as in `products_of`.  `parts`: the fitted linear parts of the decays.
    """
    found: dict[tuple[int, int], NDArray[np.float64]] = {}
    for alike in layout:
        at = points[alike.mass_state]
        fitted = np.stack([parts[d].coefficients[r] @ parts[d].solution for d, r in alike.places])
        left = residuals(alike, at.modes.poles, _late_s(at, alike), fitted)
        found |= dict(zip(alike.places, left, strict=True))
    return found


def _late_s(at: Evaluated, alike: Alike) -> NDArray[np.float64]:
    return np.array([at.group(group).late_s for group in alike.groups])


def linear_part(at: Evaluated, decay: FreeDecay) -> LinearPart:
    """Fit the linear part of a decay."""
    return linear_parts({decay.mass_state: at}, [decay])[0]


def linear_coefficients(at: Evaluated, decay: FreeDecay) -> tuple[NDArray[np.float64], ...]:
    """Return each linear unknown's contribution to each channel, on its recording's basis.

    Returns
    -------
    tuple of (n_channels, m, n_linear) float64
        One for each recording.
    """
    groups = [at.group(r.group) for r in decay.recordings]
    own = [1 + len(group.low_pass.poles) for group in groups]
    total = sum(n * len(group.weight) for n, group in zip(own, groups, strict=True))
    result = []
    column = _N
    for n_own, group in zip(own, groups, strict=True):
        stack = np.zeros((len(group.weight), 2 * _N + n_own, _N + total))
        stack[:, : 2 * _N, :_N] = group.on_state
        for c in range(len(stack)):
            stack[c, 2 * _N :, column : column + n_own] = np.eye(n_own)
            column += n_own
        result.append(stack)
    return tuple(result)


def pseudo_inverse(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert normal matrices, (.., n, n); directions that the data do not determine stay zero."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 1e-300))
    scales = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.pinv(normal * scales, _RANK, hermitian=True) * scales)


@dataclass(frozen=True, slots=True)
class NormalBlock:
    """Contribution of one decay to the normal equations, its linear part eliminated."""

    cost: float
    """Squared residuals in units of sigma."""
    information: NDArray[np.float64]
    """Normal matrix, shape (P, P)."""
    gradient: NDArray[np.float64]
    """Right-hand side, shape (P,)."""


def slopes(at: Evaluated, group: ChannelGroup, z: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return each channel's derivative by each unknown on the real basis, (.., n_channels, 28, P).

    `z`, (.., 14): initial state of one decay, or of several, in modal coordinates.
    """
    modes, one = at.modes, at.group(group)
    plain, timed = modes.propagator_slope(one.outputs, at.change, z)  # (.., n_channels, h, P)
    plain += one.d_outputs * z[..., None, modes.half, None]
    if one.late is not None:
        moving = (modes.poles * z)[..., None, modes.half]
        plain[..., one.late] -= one.outputs.gained * moving
    return modes.on_real_basis(plain, timed)


def motion(
    at: Evaluated, group: ChannelGroup, z: NDArray[np.complex128], derivative: int
) -> NDArray[np.float64]:
    """Return the vehicle's motion in each channel, on the real basis, (n_channels, 28).

    `z`, (14,): initial state in modal coordinates.  `derivative`: of the motion by time, 0 or 1.
    """
    modes = at.modes
    seen = at.group(group).outputs
    on_exp = seen.rows * (seen.gain * z * modes.poles**derivative)
    return np.asarray((on_exp @ modes.to_real[:, :_N].T).real)


def over_two(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply (n, m, p) with (n, m, q), summed over the first two axes."""
    return np.asarray(left.reshape(-1, left.shape[-1]).T @ right.reshape(-1, right.shape[-1]))


# Normal equations of many decays at one point of the unknowns -------------------------------------
#
# The runs of a mass state differ only in their samples and initial states: everything that belongs
# to the model is computed once, and numbers of one kind are arrays whose first axis is the decay.


def blocks_of(
    points: Mapping[str, Evaluated],
    decays: Sequence[FreeDecay],
    seen: Sequence[Sequence[Products]],
) -> list[tuple[NormalBlock, LinearPart]]:
    """Return the share of each decay in the normal equations, and its fitted linear part.

    `points`: the model, for each mass state.  `seen`: products of each decay (`products_of`).
    """
    alike: dict[tuple[object, ...], list[int]] = {}
    for d, decay in enumerate(decays):
        groups = tuple(points[decay.mass_state].box.groups.index(r.group) for r in decay.recordings)
        alike.setdefault((decay.mass_state, *groups), []).append(d)
    found: dict[int, tuple[NormalBlock, LinearPart]] = {}
    for members in alike.values():
        first = decays[members[0]]
        blocks = _together(points[first.mass_state], first, [seen[d] for d in members])
        found |= dict(zip(members, blocks, strict=True))
    return [found[d] for d in range(len(decays))]


def _together(
    at: Evaluated, first: FreeDecay, seen: Sequence[Sequence[Products]]
) -> Iterator[tuple[NormalBlock, LinearPart]]:
    """Yield the shares and linear parts of decays with the same channels as the first."""
    stacks = linear_coefficients(at, first)
    n, size, P = len(seen), stacks[0].shape[-1], len(at.box.prior_sigma)
    normal, right, cost = np.zeros((n, size, size)), np.zeros((n, size)), np.zeros(n)
    parts = []
    for i, (recording, stack) in enumerate(zip(first.recordings, stacks, strict=True)):
        weight = at.weights(recording.group)
        gram = np.stack([one[i].gram for one in seen])[:, None]  # (n, 1, m, m)
        cross = np.stack([one[i].cross.T for one in seen])  # (n, n_channels, m)
        weighted = (stack * weight[:, None, None]).reshape(-1, size)
        normal += weighted.T @ (gram @ stack).reshape(n, -1, size)
        right += cross.reshape(n, -1) @ weighted
        cost += np.stack([one[i].power for one in seen]) @ weight
        parts.append((recording.group, stack, weight, weighted, gram, cross))
    inverse = pseudo_inverse(normal)
    solution = (inverse @ right[..., None])[..., 0]
    z = solution[:, :_N] @ at.modes.W.T
    H, mixed, g = np.zeros((n, P, P)), np.zeros((n, size, P)), np.zeros((n, P))
    for group, stack, weight, weighted, gram, cross in parts:
        fitted = np.moveaxis(stack @ solution.T, 2, 0)  # (n, n_channels, m)
        left = cross - (fitted[:, :, None] @ gram)[:, :, 0]
        J = slopes(at, group, z)  # (n, n_channels, 28, P)
        k = J.shape[2]
        GJ = gram[..., :k] @ J
        by_weight = (J * weight[:, None, None]).reshape(n, -1, P)
        cost -= np.sum(fitted * (cross + left), axis=2) @ weight
        H += by_weight.swapaxes(1, 2) @ GJ[:, :, :k].reshape(n, -1, P)
        mixed += weighted.T @ GJ.reshape(n, -1, P)
        g += (left[:, :, :k].reshape(n, 1, -1) @ by_weight)[:, 0]
    H -= mixed.swapaxes(1, 2) @ inverse @ mixed
    for i, one in enumerate(seen):
        linear = LinearPart(tuple(one), stacks, inverse[i], solution[i])
        yield NormalBlock(float(cost[i]), H[i], g[i]), linear
