"""How far back a fitted model explains a record: the sample at which the free decay begins.

Every sample of the first 50 ms counts: the wheels' motion has lost half its size by then.  From a
start that is late enough the samples before it are predicted one by one, each prediction mended by
the samples already accepted (recursive least squares).  The errors of prediction are independent
and of known variance as long as the motion is free; the bump's last force shows at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .decay import Record, Recording
from .projection import Point, linear_coefficients, linear_part

_WINDOWS = (1, 2, 4, 8, 16)
"""Samples taken together; many tell a small force that one does not."""
_Z = 4.5
"""Normal deviate beyond which a window is no free decay: one false alarm in 300,000."""


def earliest_start_s(at: Point, record: Record, start_s: float, lower_s: float) -> float:
    """Return the earliest start from which the samples are free decay, s.

    Parameters
    ----------
    at : Point
        The fitted model for the record's mass state.
    record : Record
        The run.
    start_s : float
        A start that is late enough.
    lower_s : float
        No start before this time is considered.
    """
    decay = record.decay(start_s)
    linear = linear_part(at, decay)
    stacks = linear_coefficients(at, decay)
    blocks = sorted(
        (block for r, stack in zip(record.recordings, stacks, strict=True)
         for block in _samples(at, r.between(lower_s, start_s), stack, lower_s - start_s)),
        key=lambda block: -block[0],
    )  # fmt: skip
    solution, covariance = linear.solution, linear.normal_inverse
    accepted: list[float] = []
    squares: list[tuple[float, int]] = []
    for time, rows, values in blocks:
        error = values - rows @ solution
        spread = np.eye(len(values)) + rows @ covariance @ rows.T
        gain = np.linalg.solve(spread, rows @ covariance).T
        squares.append((float(error @ np.linalg.solve(spread, error)), len(values)))
        failed = _failed_window(squares)
        if failed:
            accepted = accepted[: len(squares) - failed]
            break
        accepted.append(time)
        solution = solution + gain @ error
        covariance = covariance - gain @ rows @ covariance
    return start_s + min(accepted) - 1e-7 if accepted else start_s


Block = tuple[float, NDArray[np.float64], NDArray[np.float64]]
"""One sample of a clock: its time, rows (n_channels, n_linear) and values, in units of sigma."""


def _samples(
    at: Point, early: Recording, stack: NDArray[np.float64], shift_s: float
) -> list[Block]:
    """Return the early samples of a clock; `shift_s` takes their times to the decay's start."""
    moved = Recording(early.clock, early.time_s + shift_s, early.values)
    level = np.sqrt(at.weights(early.clock))
    rows = np.einsum("nm,cms->ncs", at.basis(moved), stack) * level[:, None]
    return list(zip(moved.time_s.tolist(), rows, moved.values * level, strict=True))


def _failed_window(squares: list[tuple[float, int]]) -> int:
    """Return the length of the shortest window of last samples that are no free decay, else 0."""
    for width in _WINDOWS[: 1 + int(np.log2(len(squares)))]:
        total = sum(square for square, _ in squares[-width:])
        freedom = sum(n for _, n in squares[-width:])
        # The limit of chi2 by Wilson and Hilferty (1931).
        spread = 2.0 / (9.0 * freedom)
        if total > freedom * (1.0 - spread + _Z * np.sqrt(spread)) ** 3:
            return width
    return 0
