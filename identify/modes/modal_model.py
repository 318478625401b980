"""Modes of vibration: classes, measures of similarity, and the shape at the degrees of freedom.

A mode is a conjugate pair of poles; the pole with a positive imaginary part represents both.
Frequency is ``|lambda| / 2 pi`` and damping ratio ``-Re(lambda) / |lambda|``, which are the
undamped natural frequency and the damping ratio of a single oscillator with that pole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel
from daq.vehicle import DOF, VehicleGeometry
from dbc.frames import read_only
from dbc.words import InputError

from ..model.exponentials import low_pass_of
from ..model.matrices import N_DOF, motion_row

_MOST_DAMPING, _MOST_GROWTH = 0.98, 0.005
"""Largest damping ratio of a mode, and the largest below zero: noise makes a mode that hardly
decays grow by less, and a pair that grows faster follows a drift of the record."""


@dataclass(frozen=True, slots=True)
class ModalModel:
    """The modes of a structure, in order of frequency.

    Each shape is scaled so that its largest entry is 1.
    """

    poles: NDArray[np.complex128]
    """Eigenvalues with positive imaginary part, rad/s, shape (m,)."""
    shapes: NDArray[np.complex128]
    """One column a mode, shape (n_channels, m)."""
    frequency_std_hz: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    damping_ratio_std: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """`frequency_std_hz`, `damping_ratio_std`: standard deviations by the noise of the records
    (Cramer-Rao bound), shape (m,); 0 for records without noise, NaN where it is not known, as for
    the modes of a matrix."""

    def __post_init__(self) -> None:
        if self.shapes.ndim != 2 or self.poles.shape != self.shapes.shape[1:]:
            raise ValueError(f"poles {self.poles.shape} do not fit shapes {self.shapes.shape}")
        order = np.argsort(np.abs(self.poles), kind="stable")
        for name in ("frequency_std_hz", "damping_ratio_std"):
            std = getattr(self, name)
            std = std[order] if len(std) else np.full(len(order), np.nan)
            object.__setattr__(self, name, read_only(std))
        poles = np.asarray(self.poles, dtype=np.complex128)[order]
        shapes = np.asarray(self.shapes, dtype=np.complex128)[:, order]
        if shapes.size:
            size = np.abs(shapes)
            # The first of equal entries: rounding must not decide between entries of a symmetric
            # shape.
            largest = np.argmax(size > (1.0 - 1e-6) * size.max(axis=0), axis=0)
            shapes = shapes / shapes[largest, np.arange(len(poles))]
        object.__setattr__(self, "poles", read_only(poles))
        object.__setattr__(self, "shapes", read_only(shapes))

    def __len__(self) -> int:
        return len(self.poles)

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Undamped natural frequencies, (m,)."""
        return np.asarray(np.abs(self.poles) / (2.0 * np.pi))

    @property
    def damping_ratios(self) -> NDArray[np.float64]:
        """Shares of critical damping, (m,)."""
        return np.asarray(-self.poles.real / np.abs(self.poles))


def modes_of(A: NDArray[np.float64]) -> ModalModel:
    """Return the modes of a state matrix (2n, 2n) for the state (X, dX/dt), shapes in X (Eq. 12).

    Overdamped motion (real eigenvalues) is no vibration and is left out.
    """
    eigenvalues, eigenvectors = np.linalg.eig(A)
    upper = eigenvalues.imag > 0.0
    return ModalModel(eigenvalues[upper], eigenvectors[: len(A) // 2, upper])


def vibrates(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Return which poles represent a mode; of a pair, the one with positive imaginary part."""
    decay_rate, size = -poles.real, np.abs(poles)
    is_in_range = (decay_rate > -_MOST_GROWTH * size) & (decay_rate < _MOST_DAMPING * size)
    return np.asarray((poles.imag > 0.0) & is_in_range)


def mac(shapes: NDArray[np.complex128], others: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the modal assurance criterion of shapes (n, m) and others (n, k), (m, k) float64.

    1 for shapes that are equal except for a complex factor, 0 for orthogonal ones and for a zero
    shape.  A single shape (n,) has no axis in the result.
    """
    product = np.abs(shapes.conj().T @ others) ** 2
    size = np.multiply.outer(*(np.sum(np.abs(each) ** 2, axis=0) for each in (shapes, others)))
    return np.asarray(np.divide(product, size, out=np.zeros_like(product), where=size > 0.0))


def sensor_rows(channels: Sequence[Channel], geometry: VehicleGeometry) -> NDArray[np.float64]:
    """Return each sensor's row on `daq.vehicle.DOF`, (n_channels, 7), without its time derivative.

    `geometry` places the CG (positions are counted from the front axle) and, for a suspension
    travel, the corners of the body.
    """
    g = geometry
    rows = []
    for channel in channels:
        x, y = (0.0, 0.0) if channel.at_cg else (channel.x_m + g.a, channel.y_m)
        rows.append(motion_row(channel, x, y, (g.a, g.b, g.t_f, g.t_r)).real)
    return np.array(rows).reshape(-1, N_DOF)


def displacement_shapes(
    sensed: ModalModel, channels: Sequence[Channel], geometry: VehicleGeometry
) -> ModalModel:
    """Return shapes (7, m) as displacements of `daq.vehicle.DOF`, from those at some sensors.

    In a mode everything moves as ``exp(lambda t)``, so an acceleration is ``lambda^2`` and a rate
    ``lambda`` times a displacement: the division is exact.  A sensor's low-pass multiplies it by
    its gain at lambda.  Several sensors of one degree of freedom are reconciled by least squares.
    Raises InputError if a degree of freedom is not seen.
    """
    rows = sensor_rows(channels, geometry)
    _, strength, directions = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.sum(strength > 1e-9 * strength.max(initial=0.0)))  # the others are rounding
    if rank < len(DOF):
        unseen = np.max(np.abs(directions[rank:]), axis=0) > 1e-6  # above rounding
        names = ", ".join(name for name, is_unseen in zip(DOF, unseen, strict=True) if is_unseen)
        reason = f"the sensors do not determine {names}"
        raise InputError("modal conversion", reason, "add a sensor that sees them")
    derivative = np.array([TIME_DERIVATIVE[channel.quantity] for channel in channels])
    gain = np.array([low_pass_of(channel).gain(sensed.poles) for channel in channels])
    displacement = sensed.shapes / (gain * sensed.poles ** derivative[:, None])
    return replace(sensed, shapes=np.linalg.pinv(rows) @ displacement)


# Pairs the entries of two lists, each at most once, with the largest sum of values ----------------


def best_pairs(worth: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the pairs with the largest sum, (min(n, m),) each.

    `worth`: value of each pair, (n, m).
    """
    if worth.size and len(worth) <= worth.shape[1]:
        columns = np.argmax(worth, axis=1)
        # Where no two rows want the same column, nothing can be worth more.
        if len(set(columns.tolist())) == len(columns):
            return np.arange(len(worth)), columns
    from scipy.optimize import linear_sum_assignment  # a third of a second to import

    rows, columns = linear_sum_assignment(worth, maximize=True)
    return rows, columns


# Names for the modes of a vehicle by what moves in them -------------------------------------------

MODE_NAMES = (
    "body bounce",
    "body pitch",
    "body roll",
    "front wheels symmetric",
    "front wheels antisymmetric",
    "rear wheels symmetric",
    "rear wheels antisymmetric",
)
"""Names of the modes of a vehicle of seven degrees of freedom."""


def mode_names(model: ModalModel, geometry: VehicleGeometry) -> tuple[str, ...]:
    """Return a name for each mode by the motion with the largest share: one of `MODE_NAMES`.

    `model`: displacement shapes (7, m), order `daq.vehicle.DOF`.  The body counts by the motion of
    its four corners, the wheels by their own.  No two modes have one name, and the sum of the named
    shares is largest; modes beyond seven are each a ``"further mode"``.
    """
    heave, pitch, roll, front_left, front_right, rear_left, rear_right = model.shapes
    wheelbase = geometry.a + geometry.b
    mean_track = geometry.t_f + geometry.t_r  # they are half tracks
    # Lengths of the vectors of the four corners' and of the wheels' displacements, each (.., m).
    body = np.array([2.0 * heave, pitch * wheelbase, roll * mean_track])
    front = np.array([front_left + front_right, front_left - front_right]) / np.sqrt(2.0)
    rear = np.array([rear_left + rear_right, rear_left - rear_right]) / np.sqrt(2.0)
    shares = np.abs(np.vstack([body, front, rear])) ** 2  # (7 motions, m modes)
    shares /= shares.sum(axis=0)
    names = ["further mode"] * len(model)
    for motion, mode in zip(*best_pairs(shares), strict=True):
        names[mode] = MODE_NAMES[motion]
    return tuple(names)


# Pairs the modes of a vehicle with those of the same vehicle with added mass ----------------------
#
# They are paired by shape, never by frequency: the mass lowers nearly equal frequencies by
# different amounts, and modes change places.


@dataclass(frozen=True, slots=True)
class Pairing:
    """Modes of two mass states, paired."""

    baseline: NDArray[np.intp]
    added: NDArray[np.intp]
    """Indices of the paired modes in either model, the baseline's ascending."""
    mac: NDArray[np.float64]
    """MAC of each pair, 0 to 1, shape (k,)."""
    swapped: tuple[tuple[int, int], ...]
    """Pairs of baseline modes whose partners are in the opposite order of frequency."""


def pair_modes(baseline: ModalModel, added: ModalModel) -> Pairing:
    """Return the pairs of modes of two mass states whose sum of MAC is largest.

    `baseline` and `added`: modes with shapes in the same channels; if one has more modes, some have
    no partner.
    """
    likeness = mac(baseline.shapes, added.shapes)
    rows, columns = best_pairs(likeness)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    swapped = tuple(
        (row, later_row)
        for (row, column), (later_row, later_column) in combinations(pairs, 2)
        if column > later_column
    )
    return Pairing(rows, columns, likeness[rows, columns], swapped)


# Finds copies: poles that a fit keeps separate although they are one mode -------------------------
#
# A mode whose frequency differs a little from record to record (another hammer, another
# temperature) is fitted better by two adjacent poles than by one, and by far more than noise would
# explain.  Both poles have its shape.  Two modes that nearly coincide differ in shape.


def originals(
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    amplitudes: NDArray[np.complex128],
) -> NDArray[np.intp]:
    """Return the indices of the modes that are no copies of others, ascending.

    Of several poles that are one mode the strongest stays.  With one channel there is no shape, and
    no pole is a copy.  `poles` (m,) rad/s; `shapes` (n_channels, m), all channels scaled alike;
    `amplitudes` (n_runs, m) at the start of each run.
    """
    m = len(poles)
    if m < 2 or len(shapes) < 2:
        return np.arange(m)
    power = np.sum(np.abs(shapes) ** 2, axis=0) * np.sum(np.abs(amplitudes) ** 2, axis=0)
    energy = power / np.maximum(np.abs(poles.real), np.finfo(float).tiny)
    size = np.abs(poles)
    is_near = np.abs(poles[:, None] - poles) < 0.02 * np.maximum(size[:, None], size)
    is_pair = poles.imag > 0.0
    # Two random shapes in three channels have a MAC above 0.98 in one of 100 cases.
    is_copy = is_near & (mac(shapes, shapes) > 0.98) & is_pair[:, None] & is_pair
    kept: list[int] = []
    for mode in np.argsort(-energy, kind="stable").tolist():
        if not is_copy[mode, kept].any():
            kept.append(mode)
    return np.sort(kept)
