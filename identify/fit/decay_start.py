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
_SPAN_S = 0.04
"""Seconds after the first sample that fails, within which the force ends: by then any sensor
has shown it."""
_BEFORE_S = 0.005
"""Seconds of certainly forced motion that help to find the foot of the ramp."""
_SLACK_S = 1e-7
"""Seconds by which a start comes before its first sample, so that rounding does not cut it off."""
_WHEELS = slice(3, 7)
"""The wheels among the degrees of freedom."""


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
    point: Evaluated,
    covariance: NDArray[np.float64],
    record: Record,
    decay: FreeDecay,
    linear: LinearPart,
    lower_s: float,
) -> float:
    """Return the earliest start from which the samples are free decay, s.

    `point`: the fitted model for the record's mass state.  `covariance`, (P, P) float64: of the
    unknowns of the fit, finite.  `decay` and `linear`: from a start that is late enough, with its
    linear part.  `lower_s`: no start before this time is considered.
    """
    start_s = decay.start_s
    # The force ends near the expected start: what is 30 ms before it is seldom looked at.
    for first_s in dict.fromkeys((max(lower_s, start_s - 0.03), lower_s)):
        early = _early(point, covariance, record, decay, linear, first_s)
        instants_s, known, failed_s = _free_instants(early)
        if failed_s is not None and start_s + failed_s - _BEFORE_S > first_s:
            break
    if failed_s is not None:
        surely_free = sum(instant > failed_s + _SPAN_S for instant in instants_s)
        end_s = _end_of_force_s(point, early, known[surely_free], failed_s)
        instants_s = [instant for instant in instants_s if instant > end_s - _SLACK_S]
    return start_s + min(instants_s) - _SLACK_S if instants_s else start_s


def _early(
    point: Evaluated,
    covariance: NDArray[np.float64],
    record: Record,
    decay: FreeDecay,
    linear: LinearPart,
    lower_s: float,
) -> _Early:
    """Return the samples from `lower_s` to the start, and what the decay predicts of them.

    Arguments are those of `earliest_start_s`.
    """
    start_s = decay.start_s
    modal_state = point.modes.W @ linear.solution[: len(point.modes.poles)]
    # The output row of an acceleration begins with r A21, where r is its row on the accelerations:
    # times the inverse of A21 it is r again.
    from_output = np.linalg.inv(point.system.A[7:, :7]) @ _wheel_mobility(point)
    mixed = np.zeros((len(linear.solution), len(covariance)))
    parts: list[tuple[NDArray[np.float64], ...]] = []
    for recording, product, stack in zip(
        decay.recordings, linear.products, linear.coefficients, strict=True
    ):
        J = slopes(point, recording.group, modal_state)
        weight = point.weights(recording.group)
        mixed += over_two(stack * weight[:, None, None], product.gram[:, : J.shape[1]] @ J)
        before = record.whole(recording).between(lower_s, start_s)
        # Times since the start of the decay, below zero.
        early = Recording(before.group, before.time_s + (lower_s - start_s), before.values)
        parts.append(_early_samples(point, early, stack, J, linear.solution, from_output))
    time_s, rows, error, output, force = (
        np.concatenate([part[i] for part in parts]) for i in range(5)
    )
    order = np.argsort(-time_s, kind="stable")
    return _Early(
        time_s[order],
        rows[order],
        error[order],
        output[order],
        force[order],
        _joint_covariance(covariance, mixed, linear.normal_inverse),
    )


def _early_samples(
    point: Evaluated,
    early: Recording,
    stack: NDArray[np.float64],
    J: NDArray[np.float64],
    solution: NDArray[np.float64],
    from_output: NDArray[np.float64],
) -> tuple[NDArray[np.float64], ...]:
    """Return the first five fields of `_Early` for one recording, one entry for each value.

    `stack`, (n_channels, m, n_linear), and `J`, (n_channels, 28, P): slopes of each channel by the
    linear part and by the unknowns, on the basis.  `solution`, (n_linear,): the linear part.
    `from_output`, (7, 4): from the first half of an acceleration's output row to its immediate
    change by 1 N at each wheel; no other quantity changes at once.
    """
    channels = early.group.channels
    over_sigma = np.sqrt(point.weights(early.group))[:, None]
    basis = point.basis(early)
    by_unknown = (basis[:, : J.shape[1]] @ J).swapaxes(0, 1) * over_sigma
    by_linear = (basis @ stack).swapaxes(0, 1) * over_sigma
    error = early.values * over_sigma[:, 0] - by_linear @ solution
    n, c = early.values.shape
    output = np.array([point.system.rows[channel.name] for channel in channels])
    accelerates = np.array([TIME_DERIVATIVE[channel.quantity] == 2 for channel in channels])
    at_once = np.where(accelerates[:, None], output[:, :7] @ from_output, 0.0)
    return (
        np.repeat(early.time_s, c),
        np.concatenate([by_unknown, by_linear], axis=-1).reshape(
            n * c, J.shape[2] + stack.shape[2]
        ),
        error.ravel(),
        np.tile(output * over_sigma, (n, 1)),
        np.tile(at_once * over_sigma, (n, 1)),
    )


def _wheel_mobility(point: Evaluated) -> NDArray[np.float64]:
    """Return the accelerations of the degrees of freedom by a force at each wheel, (7, 4).

    A wheel is a separate mass in every mass state, so a force at first moves that wheel alone.  The
    size of the force is unknown, so the wheel's stiffness over its mass, the diagonal of A21,
    stands for the inverse of its mass.
    """
    return np.asarray(np.eye(7)[:, _WHEELS] * np.abs(np.diag(point.system.A[7:, :7])[_WHEELS]))


def _joint_covariance(
    covariance: NDArray[np.float64],
    mixed: NDArray[np.float64],
    normal_inverse: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the covariance of the unknowns together with the linear part of one run.

    `covariance`, (P, P): of the unknowns.  `mixed`, (n_linear, P): weighted products of the slopes
    by the linear part and by the unknowns.  `normal_inverse`, (n_linear, n_linear): covariance of
    the linear part with all unknowns known.
    """
    across = -normal_inverse @ mixed @ covariance
    of_linear = normal_inverse - across @ mixed.T @ normal_inverse
    return np.block([[covariance, across.T], [across, of_linear]])


Known = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Change of the unknowns and linear part from their first estimate, and their covariance."""


def _free_instants(early: _Early) -> tuple[list[float], list[Known], float | None]:
    """Return the free instants, the estimate before each, and the first instant that is not free.

    The estimates include the one before that last instant, which is None if all are free.
    """
    n_unknown = early.rows.shape[1]
    change, covariance = np.zeros(n_unknown), early.covariance
    accepted: list[float] = []
    known: list[Known] = []
    squares: list[tuple[float, int]] = []
    begins = np.flatnonzero(np.diff(early.time_s, prepend=np.inf))  # first value of each instant
    for first, end in pairwise([*begins, len(early.time_s)]):
        rows, instant_s = early.rows[first:end], float(early.time_s[first])
        known.append((change, covariance))
        error = early.error[first:end] - rows @ change
        shared = rows @ covariance
        of_error = np.eye(len(error)) + shared @ rows.T  # covariance; the noise has sigma 1
        gain_and_error = np.linalg.solve(of_error, np.column_stack([shared, error]))
        gain, whitened = gain_and_error[:, :-1], gain_and_error[:, -1]
        squares.append((float(error @ whitened), len(error)))
        if _is_forced(squares):
            return accepted, known, instant_s
        accepted.append(instant_s)
        change = change + shared.T @ whitened
        covariance = covariance - shared.T @ gain
    return accepted, known, None


def _is_forced(squares: list[tuple[float, int]]) -> bool:
    """Return True if any window of last instants is not free decay.

    `squares`: chi2 of the errors of prediction at each instant, and how many errors it is of.
    """
    # Only windows that are no longer than what has been looked at.
    for width in _WINDOWS[: 1 + int(np.log2(len(squares)))]:
        total = sum(chi2 for chi2, _ in squares[-width:])
        freedom = sum(n for _, n in squares[-width:])
        # The limit of chi2 by Wilson and Hilferty (1931), at a normal deviate of 4.5: one false
        # alarm in 300,000.
        spread = 2.0 / (9.0 * freedom)
        if total > freedom * (1.0 - spread + 4.5 * np.sqrt(spread)) ** 3:
            return True
    return False


def _end_of_force_s(point: Evaluated, early: _Early, known: Known, failed_s: float) -> float:
    """Return the latest instant at which the force may have ended, s from the start.

    `known`: the estimate from samples that are surely free.  `failed_s`: first instant, backwards,
    that is not free.
    """
    since_failed_s = early.time_s - failed_s
    near = (since_failed_s > -_BEFORE_S) & (since_failed_s <= _SPAN_S)
    rows, time_s = early.rows[near], early.time_s[near]
    change, covariance = known
    of_error = np.eye(len(time_s)) + rows @ covariance @ rows.T
    whiten = np.linalg.inv(np.linalg.cholesky(of_error))
    error = whiten @ (early.error[near] - rows @ change)
    # The start itself may be the end of the force: then nothing is gained.
    ends_s = np.array(sorted({0.0, *time_s.tolist()}))
    ends_s = ends_s[(ends_s >= failed_s) & (ends_s <= failed_s + _SPAN_S)]
    traces = whiten @ _ramps(point, early, near, ends_s)
    size = np.linalg.norm(traces, axis=1, keepdims=True)
    directions, strength, _ = np.linalg.svd(traces / np.where(size > 0.0, size, 1.0), False)
    # Below this share of the strongest trace a combination of wheel forces counts as invisible.
    visible = strength > 1e-9 * strength[:, :1]
    # Change of chi2 by the four forces that explain most.
    changes = -np.sum(np.where(visible, error @ directions, 0.0) ** 2, axis=1)
    # A rise of the squared residuals by 6 excludes a later end of the force.
    return float(ends_s[changes <= changes.min() + 6.0].max())


def _ramps(
    point: Evaluated, early: _Early, near: NDArray[np.bool_], end_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motion added by wheel forces that fall to zero at `end_s`, (len(end_s), n, 4).

    Seen backwards from its end, ``t' = end - t``, the motion beyond the free decay obeys
    ``dz/dt' = -pole z - u t'`` in each mode and begins with zero, so that
    ``z = u (1 - pole t' - exp(-pole t')) / pole^2``.
    """
    until_end_s = np.maximum(end_s[:, None] - early.time_s[near], 0.0)  # t'
    upper = point.modes.poles.imag >= 0.0  # one of a conjugate pair represents both
    poles = point.modes.poles[upper]
    share = np.where(poles.imag > 0.0, 2.0, 1.0)[:, None]
    u = point.modes.W[upper, 7:] @ _wheel_mobility(point) * share
    time_s = early.time_s[near]
    first_s = time_s.min()  # exp(-pole t') is a product of two short tables
    back = np.exp(np.multiply.outer(first_s - end_s, poles))[:, None]
    wave = back * np.exp(np.multiply.outer(time_s - first_s, poles))
    by_u = (1.0 - np.multiply.outer(until_end_s, poles) - wave) / poles**2
    output = early.output[near] @ point.modes.V[:, upper]
    # A sample after the end has a `wave`, but no force.
    motion = real_part(output * by_u, u.T) * (until_end_s > 0.0)[..., None]
    return np.asarray(motion + early.force[near] * until_end_s[..., None])
