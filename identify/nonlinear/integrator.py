"""Path and tangents of a run as machine code (Numba), with NumPy arrays in and out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.low_pass import LowPass
from . import columns, kernels
from .car import Car
from .lanes import LANES
from .level import Level
from .path import STATES, InitialState, Path, Sampled, first_state
from .tangent import Plan, SampledChannels, Start
from .threads import for_each_run

Array = NDArray[np.float64]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def integrate(
    cars: Sequence[Car],
    initials: Sequence[InitialState],
    ends_s: Sequence[float],
    step_s: float,
    level: Level,
) -> Sequence[Path | None]:
    """Return the path of each run up to its end or just after; None if it does not stay finite."""
    return for_each_run(partial(_integrate, step_s, level), cars, initials, ends_s)


def _integrate(
    step_s: float, level: Level, car: Car, own: InitialState, end_s: float
) -> Path | None:
    x0, speed = first_state(car, own, level)
    steps = int(np.ceil(end_s / step_s / 8.0 - 1e-9)) * 8
    states, slopes = np.empty((steps + 1, STATES)), np.empty((steps + 1, STATES))
    speeds = np.empty((steps + 1, 4))
    reached = kernels.path(
        x0, speed, steps, step_s, *_body(car), level, car.has_mount, states, slopes, speeds
    )
    return Path(step_s, level, states, slopes, speeds) if reached == steps + 1 else None


def sample(car: Car, path: Path, times_s: Array) -> Sampled:
    """Return the states at the given times, s."""
    states, slopes = np.empty((len(times_s), STATES)), np.empty((len(times_s), STATES))
    speeds = np.empty((len(times_s), 4))
    kernels.sample(
        times_s, path.step_s, path.states, path.slopes, path.speeds, *_body(car), path.level,
        car.has_mount, states, slopes, speeds,
    )  # fmt: skip
    return Sampled(times_s, states, slopes, speeds)


def tangents(car: Car, acts: NDArray[np.intp], path: Path, start: Start, plan: Plan) -> Any:
    """Return the tangents along a path, as `add_sampled` takes them."""
    corner, knots, inverse, _ = _body(car)
    count = start.matrix.shape[1]
    assert count == len(acts) + (22 if car.has_mount else 18)
    blocks = -(-count // LANES)
    trace = np.empty((len(plan.starts) + 2, blocks, columns.STATE_ROWS * LANES))
    for b in range(blocks):
        part = start.matrix[:, b * LANES : (b + 1) * LANES]
        rows = np.zeros((columns.STATE_ROWS, LANES))
        rows[:STATES, : part.shape[1]] = part
        trace[0, b] = rows.ravel()
    columns.tangents(
        path.step_s, path.states, path.slopes, path.speeds, corner, knots, inverse,
        car.has_mount, start.sparse, start.body, plan.starts, plan.lengths, plan.fine, plan.levels,
        count, trace,
    )  # fmt: skip
    return trace


def add_sampled(trace: Any, given: SampledChannels, out: Array) -> None:
    """Add the tangents of some channels at some times to `out`, (n, channels, columns)."""
    columns.add_sampled(
        trace, out.shape[2], given.before, given.weights, given.orders, given.first, given.motions,
        given.shares, out,
    )  # fmt: skip


def filtered(low_pass: LowPass, values: Array, step_s: float, times_s: Array) -> Array:
    """Return the output of a low-pass that was at rest before.

    The filter is a sum of first-order filters, one for each pole, each integrated exactly for an
    input that is a parabola over two steps.  Its own transients are left out: they are free
    constants of the channel.

    `values`, (n, ...): its input at 0, `step_s`, ...; n is odd.  `times_s`, (m,): times of the
    output.  Returns (m, ...).
    """
    order = np.argsort(times_s, kind="stable")
    flat = np.ascontiguousarray(values).reshape(len(values), -1)
    found = np.zeros((len(times_s), flat.shape[1]))
    for pole, residue, weights in _pole_terms(low_pass, 2.0 * step_s):
        kernels.filter_pole(flat, 2.0 * step_s, times_s[order], pole, residue, weights, found)
    total = np.empty_like(found)
    total[order] = found
    return total.reshape(len(times_s), *values.shape[1:])


def _pole_terms(
    low_pass: LowPass, h: float
) -> Iterator[tuple[complex, complex, NDArray[np.complex128]]]:
    """Yield each pole without its conjugate, its residue for both, and the weights of its input.

    The weights, (3,), are of the input at the start, the middle and the end of a double step of
    `h` seconds.
    """
    s = (_POINTS + 1.0) / 2.0  # of the double step
    shapes = np.array([(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)])
    poles = low_pass.poles
    for i, pole in enumerate(poles):
        if pole.imag < 0.0:
            continue
        others = np.delete(poles, i)
        residue = np.prod(-poles) / np.prod(pole - others)
        share = 2.0 if pole.imag > 0.0 else 1.0
        kernel = np.exp(pole * h * (1.0 - s)) * _WEIGHTS * h / 2.0
        yield complex(pole), complex(share * residue), shapes @ kernel


def _body(car: Car) -> tuple[Array, Array, Array, Array]:
    inverse = np.asarray(np.linalg.inv(car.mass), dtype=np.float64)
    return car.corner, np.array(car.knots, dtype=np.float64), inverse, car.pull
