"""Finds where a free decay begins, to the sample: how far back a fitted model explains a record.

Every sample of the first 50 ms counts: the wheels' motion has lost half its size by then.  From a
start that is late enough the samples before it are predicted one by one, each prediction updated
by the samples already accepted (recursive least squares).  The errors of prediction are independent
and of known variance as long as the motion is free; the bump's last force shows sooner or later.

A sensor of displacement shows it later than one of acceleration, so some forced samples may have
passed.  The end of the force is therefore estimated by itself: near its end any smooth force is a
ramp, and the ramp of unknown size at each wheel that explains all samples best has its foot there.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE

from ..decays.decay import FreeDecay, Record, Recording
from ..model.exponentials import real_part
from .varpro import Evaluated, LinearPart, over_two, slopes

_WINDOWS = (1, 2, 4, 8, 16)
"""Samples taken together; many show a small force that one does not."""
_Z = 4.5
"""Normal deviate beyond which a window is not free decay: one false alarm in 300,000."""
_SURE = 6.0
"""Rise of the squared residuals that excludes a later end of the force."""
_SPAN_S = 0.04
"""Seconds after the first sample that fails, within which the force ends: by then any sensor
has shown it."""
_BEFORE_S = 0.005
"""Seconds of certainly forced motion that help to find the foot of the ramp."""
_AT_FIRST_S = 0.03
"""Seconds before the start that are looked at first."""
_SEEN = 1e-9
"""Share of the strongest trace below which a combination of wheel forces counts as invisible."""
_WHEELS = slice(3, 7)


@dataclass(frozen=True, slots=True)
class _Early:
    """The samples before the start, the last one first, in units of sigma."""

    time_s: NDArray[np.float64]
    """Time from the start, s, negative, shape (n,); one entry for each value."""
    rows: NDArray[np.float64]
    """Slope of each value by the unknowns of the fit and the linear part of the run, shape (n,
    n_unknown)."""
    error: NDArray[np.float64]
    """Measured less predicted, shape (n,)."""
    output: NDArray[np.float64]
    """Output row of each value's channel, shape (n, 14)."""
    force: NDArray[np.float64]
    """Immediate change of each value by 1 N at each wheel, shape (n, 4)."""
    covariance: NDArray[np.float64]
    """Covariance of the unknowns that the predictions use, shape (n_unknown, n_unknown)."""


def earliest_start_s(
    at: Evaluated,
    covariance: NDArray[np.float64],
    record: Record,
    decay: FreeDecay,
    linear: LinearPart,
    lower_s: float,
) -> float:
    """Return the earliest start from which the samples are free decay, s.

    `at`: the fitted model for the record's mass state.  `covariance`, (P, P) float64: of the
    unknowns of the fit, finite.  `decay` and `linear`: from a start that is late enough, with its
    linear part.  `lower_s`: no start before this time is considered.
    """
    start_s = decay.start_s
    # The force ends near the expected start: all other samples are seldom looked at.
    for first_s in dict.fromkeys((max(lower_s, start_s - _AT_FIRST_S), lower_s)):
        early = _early(at, covariance, record, decay, linear, first_s)
        instants, known, failed = _free_instants(early)
        if failed is not None and start_s + failed - _BEFORE_S > first_s:
            break
    if failed is not None:
        settled = sum(instant > failed + _SPAN_S for instant in instants)
        end = _end_of_force_s(at, early, known[settled], failed)
        instants = [instant for instant in instants if instant > end - 1e-7]
    return start_s + min(instants) - 1e-7 if instants else start_s


def _early(
    at: Evaluated,
    covariance: NDArray[np.float64],
    record: Record,
    decay: FreeDecay,
    linear: LinearPart,
    lower_s: float,
) -> _Early:
    start_s = decay.start_s
    z = at.modes.W @ linear.solution[: len(at.modes.poles)]
    # An acceleration feels a force at once: A21 = -M^-1 K gives back the row of displacements.
    displaced = np.linalg.inv(at.system.A[7:, :7]) @ _wheel_mobility(at)
    size, P = len(linear.solution), len(covariance)
    mixed = np.zeros((size, P))
    parts: list[tuple[NDArray[np.float64], ...]] = []
    for later, product, stack in zip(
        decay.recordings, linear.products, linear.coefficients, strict=True
    ):
        J = slopes(at, later.group, z)
        weight = at.weights(later.group)
        seen = product.gram[:, : J.shape[1]] @ J
        mixed += over_two(stack * weight[:, None, None], seen)
        before = record.whole(later).between(lower_s, start_s)
        moved = Recording(before.group, before.time_s + (lower_s - start_s), before.values)
        parts.append(_recording(at, moved, stack, J, linear, displaced))
    time, rows, error, output, force = (
        np.concatenate([part[i] for part in parts]) for i in range(5)
    )
    order = np.argsort(-time, kind="stable")
    return _Early(
        time[order],
        rows[order],
        error[order],
        output[order],
        force[order],
        _joint(covariance, mixed, linear.normal_inverse),
    )


def _recording(
    at: Evaluated,
    early: Recording,
    stack: NDArray[np.float64],
    J: NDArray[np.float64],
    linear: LinearPart,
    displaced: NDArray[np.float64],
) -> tuple[NDArray[np.float64], ...]:
    channels = early.group.channels
    level = np.sqrt(at.weights(early.group))[:, None]
    basis = at.basis(early)
    by_unknown = (basis[:, : J.shape[1]] @ J).swapaxes(0, 1) * level
    by_linear = (basis @ stack).swapaxes(0, 1) * level
    error = early.values * level[:, 0] - by_linear @ linear.solution
    n, c = early.values.shape
    output = np.array([at.system.rows[channel.name] for channel in channels])
    second = np.array([TIME_DERIVATIVE[channel.quantity] == 2 for channel in channels])
    at_once = output[:, :7] @ displaced * second[:, None]
    return (
        np.repeat(early.time_s, c),
        np.concatenate([by_unknown, by_linear], axis=-1).reshape(
            n * c, J.shape[2] + stack.shape[2]
        ),
        error.ravel(),
        np.tile(output * level, (n, 1)),
        np.tile(at_once * level, (n, 1)),
    )


def _wheel_mobility(at: Evaluated) -> NDArray[np.float64]:
    """Return the accelerations of the degrees of freedom by a unit force at each wheel, (7, 4).

    A wheel is a separate mass in every mass state, so a force at first moves that wheel alone; the
    size of the force is unknown, so the mass need not be known either.
    """
    return np.asarray(np.eye(7)[:, _WHEELS] * np.abs(np.diag(at.system.A[7:, :7])[_WHEELS]))


def _joint(
    covariance: NDArray[np.float64], mixed: NDArray[np.float64], inverse: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the covariance of the unknowns together with the linear part of one run."""
    across = -inverse @ mixed @ covariance
    own = inverse - across @ mixed.T @ inverse
    return np.block([[covariance, across.T], [across, own]])


Known = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Change of the unknowns and linear part from their first estimate, and their covariance."""


def _free_instants(early: _Early) -> tuple[list[float], list[Known], float | None]:
    """Return the free instants, the estimate before each, and the first instant that is not free.

    The estimates include the one before that last instant, which is None if all are free.
    """
    n = early.rows.shape[1]
    state, covariance = np.zeros(n), early.covariance
    accepted: list[float] = []
    known: list[Known] = []
    squares: list[tuple[float, int]] = []
    edges = np.flatnonzero(np.diff(early.time_s, prepend=np.inf))
    for first, last in pairwise([*edges, len(early.time_s)]):
        rows, time = early.rows[first:last], float(early.time_s[first])
        known.append((state, covariance))
        error = early.error[first:last] - rows @ state
        shared = rows @ covariance
        spread = np.eye(len(error)) + shared @ rows.T
        weighed = np.linalg.solve(spread, np.column_stack([shared, error]))
        squares.append((float(error @ weighed[:, -1]), len(error)))
        if _is_forced(squares):
            return accepted, known, time
        accepted.append(time)
        state = state + shared.T @ weighed[:, -1]
        covariance = covariance - shared.T @ weighed[:, :-1]
    return accepted, known, None


def _is_forced(squares: list[tuple[float, int]]) -> bool:
    """Return True if any window of last samples is not free decay."""
    for width in _WINDOWS[: 1 + int(np.log2(len(squares)))]:
        total = sum(square for square, _ in squares[-width:])
        freedom = sum(n for _, n in squares[-width:])
        # The limit of chi2 by Wilson and Hilferty (1931).
        spread = 2.0 / (9.0 * freedom)
        if total > freedom * (1.0 - spread + _Z * np.sqrt(spread)) ** 3:
            return True
    return False


def _end_of_force_s(at: Evaluated, early: _Early, known: Known, failed_s: float) -> float:
    """Return the latest instant at which the force may have ended, s from the start."""
    away = early.time_s - failed_s
    near = (away > -_BEFORE_S) & (away <= _SPAN_S)
    rows, time = early.rows[near], early.time_s[near]
    state, covariance = known
    spread = np.eye(len(time)) + rows @ covariance @ rows.T
    whiten = np.linalg.inv(np.linalg.cholesky(spread))
    error = whiten @ (early.error[near] - rows @ state)
    # The start itself may be the end of the force: then nothing is gained.
    instants = np.array(sorted({0.0, *time.tolist()}))
    instants = instants[(instants >= failed_s) & (instants <= failed_s + _SPAN_S)]
    traces = whiten @ _ramps(at, early, near, instants)
    size = np.linalg.norm(traces, axis=1, keepdims=True)
    within, strength, _ = np.linalg.svd(traces / np.where(size > 0.0, size, 1.0), False)
    seen = strength > _SEEN * strength[:, :1]
    costs = -np.sum(np.where(seen, error @ within, 0.0) ** 2, axis=1)
    return float(instants[costs <= costs.min() + _SURE].max())


def _ramps(
    at: Evaluated, early: _Early, near: NDArray[np.bool_], end_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motion added by wheel forces that fall to zero at `end_s`, (len(end_s), n, 4).

    Seen backwards from its end, ``t' = end - t``, the motion beyond the free decay obeys
    ``dz/dt' = -lambda z - u t'`` in each mode and begins with zero.
    """
    before = np.maximum(end_s[:, None] - early.time_s[near], 0.0)
    upper = at.modes.poles.imag >= 0.0  # one of a conjugate pair represents both
    poles = at.modes.poles[upper]
    u = at.modes.W[upper, 7:] @ _wheel_mobility(at) * np.where(poles.imag > 0.0, 2.0, 1.0)[:, None]
    time_s = early.time_s[near]
    first_s = time_s.min()  # exp(-pole t') is a product of two short tables
    back = np.exp(np.multiply.outer(first_s - end_s, poles))[:, None]
    wave = back * np.exp(np.multiply.outer(time_s - first_s, poles))
    grown = (1.0 - np.multiply.outer(before, poles) - wave) / poles**2
    seen = early.output[near] @ at.modes.V[:, upper]
    motion = real_part(seen * grown, u.T) * (before > 0.0)[..., None]
    return np.asarray(motion + early.force[near] * before[..., None])
