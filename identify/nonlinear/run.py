"""One run: the model's prediction of its samples, and its normal equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE

from ..decays.decay import FreeDecay, Recording
from ..model.complex_step import COMPLEX_STEP, stepped
from ..model.low_pass import low_pass_of
from . import integrator
from .car import Car, Model
from .level import Grade
from .path import InitialState, Path, Sampled
from .tangent import plan_of, sampled_channels, start_of

_LATE_S = 2e-4
"""Step, s, of the derivative of a channel by time."""
_EARLY_SIGMAS = 4.0


@dataclass(frozen=True)
class Run:
    """A free decay, with all that it needs from the problem."""

    decay: FreeDecay
    weights: tuple[NDArray[np.float64], ...]
    """Inverse standard deviation of each channel of each recording."""
    early_s: float
    """Time by which the path begins before the window, s, for sensors that may be late."""

    @cached_property
    def bases(self) -> tuple[NDArray[np.float64], ...]:
        """Orthonormal basis of the channels' own functions in each recording, (n, k)."""
        result = []
        for r in self.decay.recordings:
            own = low_pass_of(r.group.channels[0]).transients(r.time_s)
            result.append(np.linalg.qr(np.hstack([np.ones((len(r.time_s), 1)), own]))[0])
        return tuple(result)

    @property
    def freedom(self) -> float:
        """Number of samples less that of the channels' own unknowns."""
        pairs = zip(self.decay.recordings, self.bases, strict=True)
        return float(sum((len(q) - q.shape[1]) * r.values.shape[1] for r, q in pairs))

    @property
    def end_s(self) -> float:
        """Length of the path, s."""
        last = max(float(r.time_s[-1]) for r in self.decay.recordings)
        return last + 2.0 * self.early_s + 2e-3


def run_of(model: Model, decay: FreeDecay, sigma: Mapping[str, float]) -> Run:
    """Return a decay ready to be fitted."""
    weights = tuple(
        np.array([1.0 / sigma[c.name] for c in r.group.channels]) for r in decay.recordings
    )
    unsure = max((group.delay_sigma_s for group in model.box.groups), default=0.0)
    return Run(decay, weights, _EARLY_SIGMAS * unsure + 2.0 * _LATE_S * (unsure > 0.0))


@dataclass(frozen=True, slots=True)
class Rows:
    """Output rows of all channels on the seven motions at one point, with their derivatives."""

    rows: Mapping[str, NDArray[np.float64]]
    """(7,) of each channel."""
    slopes: Mapping[str, NDArray[np.float64]]
    """(F, 7)."""
    delays_s: NDArray[np.float64]
    """Lateness of each clock beyond its nominal one, s."""
    late: tuple[int | None, ...]
    """Index, among the free unknowns, of that lateness."""


def rows_of(model: Model, eta: NDArray[np.float64], free: NDArray[np.intp]) -> Rows:
    """Return the output rows at `eta`, (P,), and their derivatives by the unknowns at `free`."""
    points = stepped(eta)[np.concatenate([[0], 1 + free])]
    found = model.box.motion_rows(points)
    box = model.box
    late = []
    for i in range(len(box.groups)):
        p = box.delay_index(i)
        late.append(int(np.flatnonzero(free == p)[0]) if p is not None and p in free else None)
    return Rows(
        {name: row[0].real for name, row in found.items()},
        {name: row[1:].imag / COMPLEX_STEP for name, row in found.items()},
        box.delays_s(eta),
        tuple(late),
    )


@dataclass(frozen=True, slots=True)
class Predicted:
    """A run's path, and the residuals that it leaves."""

    path: Path
    left: tuple[NDArray[np.float64], ...]
    """Measured less predicted of each recording, (n, channels) in units of sigma; the channels' own
    functions are projected out."""
    cost: float


def _times(run: Run, rows: Rows, model: Model, r: Recording) -> NDArray[np.float64]:
    return np.asarray(r.time_s - rows.delays_s[model.box.groups.index(r.group)] + run.early_s)


def predict(model: Model, rows: Rows, run: Run, car: Car, path: Path) -> Predicted:
    """Return a run's path and residuals."""
    left = []
    for r, weight, basis in zip(run.decay.recordings, run.weights, run.bases, strict=True):
        values = _values(car, rows, path, r, _times(run, rows, model, r))
        error = (r.values - values) * weight
        left.append(error - basis @ (basis.T @ error))
    return Predicted(path, tuple(left), float(sum(np.sum(e * e) for e in left)))


def _values(
    car: Car, rows: Rows, path: Path, r: Recording, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    low_pass = low_pass_of(r.group.channels[0])
    if not len(low_pass.poles):
        return _seen(rows, r, integrator.sample(car, path, times))
    nodes = Sampled(np.zeros(0), path.states, path.slopes, path.speeds)
    return integrator.filtered(low_pass, _seen(rows, r, nodes), path.step_s, times)


def _seen(rows: Rows, r: Recording, sampled: Sampled) -> NDArray[np.float64]:
    columns = [
        sampled.motion(TIME_DERIVATIVE[c.quantity]) @ rows.rows[c.name] for c in r.group.channels
    ]
    return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True)
class Block:
    """Normal equations of one run: its own unknowns, then the free ones of the car."""

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    own: NDArray[np.float64]
    """Right-hand side of the run's own unknowns."""
    shared: NDArray[np.float64]
    jacobian: tuple[NDArray[np.float64], ...]
    """Jacobian of each recording, (n, channels, own + free), in units of sigma."""


def block(
    model: Model,
    run: Run,
    car: Car,
    rows: Rows,
    own: InitialState,
    predicted: Predicted,
    acts: NDArray[np.intp],
    grade: Grade,
) -> Block:
    """Return the normal equations of a run at the point of `predicted`."""
    path = predicted.path
    start, plan = start_of(car, own, acts, grade.path), plan_of(car, path, grade)
    n_own = start.matrix.shape[1] - len(acts)
    size = n_own + car.d_corner.shape[2]
    trace = integrator.tangents(car, acts, path, start, plan)
    grid = np.arange(0.0, path.end_s + 1e-9, grade.filter_s)
    grid = grid[: len(grid) - (len(grid) + 1) % 2]
    at_grid = integrator.sample(car, path, grid)
    jacobian = []
    normal, right = np.zeros((size, size)), np.zeros(size)
    for r, weight, basis, left in zip(
        run.decay.recordings, run.weights, run.bases, predicted.left, strict=True
    ):
        low_pass = low_pass_of(r.group.channels[0])
        asked = _times(run, rows, model, r)
        times = grid if len(low_pass.poles) else asked
        sampled = at_grid if len(low_pass.poles) else integrator.sample(car, path, asked)
        orders = np.array([TIME_DERIVATIVE[c.quantity] for c in r.group.channels])
        channels = sampled_channels(
            plan,
            path.step_s,
            times,
            orders,
            np.stack([rows.rows[c.name] for c in r.group.channels]),
        )
        part = np.zeros((len(times), len(orders), n_own + len(acts)))
        integrator.add_sampled(trace, channels, part)
        J = np.zeros((len(times), len(orders), size))
        J[:, :, :n_own] = part[:, :, :n_own]
        J[:, :, n_own + acts] = part[:, :, n_own:]
        for c, channel in enumerate(r.group.channels):
            moves = np.flatnonzero(rows.slopes[channel.name].any(axis=1))
            motion = sampled.motion(int(orders[c]))
            J[:, c, n_own + moves] += motion @ rows.slopes[channel.name][moves].T
        if len(low_pass.poles):
            J = integrator.filtered(low_pass, J, grade.filter_s, asked)
        late = rows.late[model.box.groups.index(r.group)]
        if late is not None:
            both = np.concatenate([asked + _LATE_S, asked - _LATE_S])
            after, before = np.split(_values(car, rows, path, r, both), 2)
            J[:, :, n_own + late] -= (after - before) / (2.0 * _LATE_S)
        J *= weight[:, None]
        flat = J.reshape(len(J), -1)
        flat -= basis @ (basis.T @ flat)
        jacobian.append(J)
        flat = J.reshape(-1, size)
        normal += flat.T @ flat
        right += flat.T @ left.ravel()
    return Block(
        normal[:n_own, :n_own], normal[:n_own, n_own:], normal[n_own:, n_own:],
        right[:n_own], right[n_own:], tuple(jacobian),
    )  # fmt: skip
