"""Products of exponentials with each other and with samples, without a table of either.

Even times are a coarse and a fine step each, ``t = T + d``, so that ``exp(l t) = exp(l T) exp(l
d)``: a sum over n samples becomes one over some sqrt(n) coarse and one over as many fine steps,
exact to rounding.  The samples after the last whole coarse step are summed one by one, and so are
samples at times that are not even.  Recordings that are laid out alike are handled together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt

import numpy as np
from numpy.typing import NDArray

_Real = NDArray[np.float64]
_Complex = NDArray[np.complex128]

_FEW = 64  # samples for which steps would save nothing
_EVEN = 8.0  # spacings of float64 by which even times may depart from their line


@dataclass(frozen=True, slots=True)
class Series:
    """Samples of r recordings that are laid out alike, each with k channels."""

    members: tuple[int, ...]
    """Indices of the recordings among those that were laid out."""
    count: NDArray[np.intp]
    """Number of samples of each, shape (r,)."""
    coarse_s: _Real
    """Coarse steps, s, shape (r, n)."""
    step_s: _Real
    """Time from sample to sample, s, shape (r,)."""
    fine_s: _Real
    """Fine steps, s, shape (r, w)."""
    tail_s: _Real
    """Times of the samples left over, s, shape (r, q)."""
    present: _Real
    """1 where there is such a sample, else 0, shape (r, q)."""
    steps: _Real
    """Samples at the steps, shape (r, n, k, w)."""
    tail: _Real
    """Samples left over, zero where there is none, shape (r, q, k)."""
    power: _Real
    """Sum of the squares of the samples, shape (r, k)."""


@dataclass(frozen=True, slots=True)
class Waves:
    """``exp(rate t)`` of p rates at the times of some series."""

    series: Series
    """The samples and their times."""
    coarse_s: _Real
    tail_s: _Real
    """`coarse_s`, `tail_s`: times of the series, less the lateness, s."""
    coarse: _Complex
    """At the coarse steps, shape (r, n, p)."""
    fine: _Complex
    """At the fine steps, shape (r, w, p)."""
    tail: _Complex
    """At the samples left over, zero where there is none, shape (r, q, p)."""

    def grams(self) -> tuple[_Complex, _Complex]:
        """Return the sums of ``conj(f) g`` and of ``f g``, each (r, 2 p, 2 p).

        The functions are ``exp(rate t)`` and then ``t exp(rate t)``.
        """
        # Sums with 1, t and t^2 over all samples: t is a coarse and a fine time, and the samples
        # left over are added.
        c0, c1, c2 = _moments(self.coarse, self.coarse_s)
        f0, f1, f2 = _moments(self.fine, self.series.fine_s)
        q0, q1, q2 = _moments(self.tail, self.tail_s)
        p = self.fine.shape[2]
        out = np.empty((2, len(self.fine), 2 * p, 2 * p), dtype=complex)
        out[..., :p, :p] = c0 * f0 + q0
        out[..., :p, p:] = out[..., p:, :p] = c1 * f0 + c0 * f1 + q1
        out[..., p:, p:] = c2 * f0 + 2.0 * c1 * f1 + c0 * f2 + q2
        return out[0], out[1]

    def sums(self) -> _Complex:
        """Return the sums of ``exp(rate t)`` and of ``t exp(rate t)``, (r, 2 p)."""
        fine = _with_time(self.fine, self.series.fine_s).sum(axis=1)
        coarse = _with_time(self.coarse, self.coarse_s).sum(axis=1)
        p = self.fine.shape[2]
        plain = coarse[:, :p] * fine[:, :p]
        timed = coarse[:, p:] * fine[:, :p] + coarse[:, :p] * fine[:, p:]
        tail = _with_time(self.tail, self.tail_s).sum(axis=1)
        return np.asarray(np.concatenate([plain, timed], axis=1) + tail)

    def with_samples(self) -> _Complex:
        """Return the sums of the samples times ``exp(rate t)``, ``t exp(rate t)``, (r, k, 2 p)."""
        steps, tail = self.series.steps, self.series.tail
        r, n, k, w = steps.shape
        fine = _with_time(self.fine, self.series.fine_s)
        # Real samples times complex functions, as products of real tables: half of the work.
        within_steps = (steps.reshape(r, n * k, w) @ fine.view(np.float64)).view(np.complex128)
        within_steps = within_steps.reshape(r, n, k, 2, -1)
        plain, timed = within_steps[..., 0, :], within_steps[..., 1, :]
        coarse = self.coarse[:, :, None]
        sums = np.empty((r, k, 2, fine.shape[2] // 2), dtype=complex)
        sums[:, :, 0] = np.sum(coarse * plain, axis=1)
        # t is the coarse time and the fine one, which is in `timed`.
        by_time = self.coarse_s[:, :, None, None] * plain + timed
        sums[:, :, 1] = np.sum(coarse * by_time, axis=1)
        tail_functions = _with_time(self.tail, self.tail_s).view(np.float64)
        tail_sums = (tail.swapaxes(1, 2) @ tail_functions).view(np.complex128)
        return np.asarray(sums.reshape(r, k, -1) + tail_sums)

    def values(self, amplitudes: _Complex) -> tuple[_Real, _Real]:
        """Return the real parts of sums of exponentials, laid out like the samples.

        `amplitudes`: of each rate in each channel, shape (r, k, p).
        """
        r, n, k, w = self.series.steps.shape
        # The real part of a product is the scalar product of one factor with the other's conjugate.
        at_steps = (self.coarse[:, :, None] * amplitudes[:, None]).reshape(r, n * k, -1)
        steps = at_steps.conj().view(np.float64) @ self.fine.view(np.float64).swapaxes(1, 2)
        tail = self.tail.view(np.float64) @ amplitudes.conj().view(np.float64).swapaxes(1, 2)
        return steps.reshape(r, n, k, w), tail

    def residuals(self, amplitudes: _Complex) -> list[_Real]:
        """Return the samples of each recording less `values`, each (k, count)."""
        steps, tail = self.values(amplitudes)
        r, _, k, _ = steps.shape
        of_steps = (self.series.steps - steps).swapaxes(1, 2).reshape(r, k, -1)
        of_tail = (self.series.tail - tail).swapaxes(1, 2)
        n_tail = self.series.count - of_steps.shape[2]  # the others are padding
        return [
            np.concatenate([first, last[:, :n]], axis=1)
            for first, last, n in zip(of_steps, of_tail, n_tail.tolist(), strict=True)
        ]


def series_of(times_s: Sequence[_Real], samples: Sequence[_Real]) -> tuple[Series, ...]:
    """Lay out recordings, times (n_i,) and samples (n_i, k_i): those that are alike together.

    Alike are those with the same width and number of coarse steps, and as many channels.
    """
    alike: dict[tuple[int, int, int], list[int]] = {}
    for i, (time_s, values) in enumerate(zip(times_s, samples, strict=True)):
        width = _width(time_s)
        alike.setdefault((width, len(time_s) // width, values.shape[1]), []).append(i)
    return tuple(
        _one_series([(i, times_s[i], samples[i]) for i in members], width)
        for (width, _, _), members in alike.items()
    )


def waves(series: Series, rates: _Complex, late_s: _Real | float = 0.0) -> Waves:
    """Evaluate ``exp(rate t)`` at the times of some series less `late_s`, one or one for each."""
    late = np.broadcast_to(late_s, len(series.members))[:, None]
    coarse_s, tail_s = series.coarse_s - late, series.tail_s - late
    n, width, q = coarse_s.shape[1], series.fine_s.shape[1], tail_s.shape[1]
    if width == 1:  # not even, and nothing is left over
        coarse, fine = np.exp(np.multiply.outer(coarse_s, rates)), _powers(series.step_s, rates, 1)
    else:
        fine = _powers(series.step_s, rates, width)
        coarse = _powers(width * series.step_s, rates, n)
        coarse *= np.exp(np.multiply.outer(coarse_s[:, :1], rates))
    tail: _Complex = fine[:, :q] * np.exp(np.multiply.outer(tail_s[:, :1], rates))
    tail *= series.present[..., None]
    return Waves(series, coarse_s, tail_s, coarse, fine, tail)


def _powers(step_s: _Real, rates: _Complex, count: int) -> _Complex:
    """Return ``exp(rate k step)`` for k below `count` and each step, (r, count, p).

    Each k is a coarse and a fine step once more: exponentials take longer than their products.
    """
    inner = isqrt(count)
    outer = -(-count // inner)
    turned = np.multiply.outer(step_s, rates)[:, None]
    fine = np.exp(np.arange(inner)[:, None] * turned)
    coarse = np.exp(np.arange(0, outer * inner, inner)[:, None] * turned)
    table = coarse[:, :, None] * fine[:, None]
    return np.asarray(table.reshape(len(step_s), -1, len(rates))[:, :count])


def _width(time_s: _Real) -> int:
    """Return how many fine steps a coarse one has; 1 where times are few or not even."""
    n = len(time_s)
    if n < _FEW:
        return 1
    line = time_s[0] + float(time_s[-1] - time_s[0]) / (n - 1) * np.arange(n)
    even = np.abs(time_s - line).max() <= _EVEN * np.spacing(np.abs(time_s).max())
    return int(2 ** round(np.log2(n) / 2.0)) if even else 1


def _one_series(recordings: Sequence[tuple[int, _Real, _Real]], width: int) -> Series:
    """Lay out recordings, (index, times, samples), with the same number of whole steps.

    `width`: samples of a coarse step.
    """
    members, times, samples = zip(*recordings, strict=True)
    n, k = len(times[0]) // width, samples[0].shape[1]
    whole = n * width  # samples in whole steps
    q = max(len(time) for time in times) - whole
    tail_s, present = np.zeros((len(times), q)), np.zeros((len(times), q))
    tail = np.zeros((len(times), q, k))
    for i, (time, values) in enumerate(zip(times, samples, strict=True)):
        n_tail = len(time) - whole
        tail_s[i, :n_tail], present[i, :n_tail] = time[whole:], 1.0
        tail[i, :n_tail] = values[whole:]
    steps = np.stack([values[:whole].reshape(n, width, k) for values in samples])
    duration = np.array([time[-1] - time[0] for time in times])
    count = np.array([len(time) for time in times])
    step_s = duration / np.maximum(count - 1, 1)
    return Series(
        members,
        count,
        np.stack([time[:whole:width] for time in times]),
        step_s,
        np.multiply.outer(step_s, np.arange(width)),
        tail_s,
        present,
        np.ascontiguousarray(steps.swapaxes(2, 3)),
        tail,
        np.array([np.einsum("ij,ij->j", values, values) for values in samples]),
    )


def _with_time(wave: _Complex, time_s: _Real) -> _Complex:
    """Return waves, (r, n, p), and then these times t, (r, n, 2 p)."""
    return np.concatenate([wave, time_s[..., None] * wave], axis=-1)


def _moments(wave: _Complex, time_s: _Real) -> tuple[_Complex, ...]:
    """Return the sums of ``conj(f) g`` and ``f g``, times 1, t and t squared, each (2, r, p, p)."""
    r, _, p = wave.shape
    time = time_s[..., None]
    timed = time * wave
    right = np.concatenate([wave, timed, time * timed], axis=2)
    left = np.concatenate([wave.conj(), wave], axis=2).swapaxes(1, 2)
    sums = (left @ right).reshape(r, 2, p, 3, p)
    return tuple(sums[:, :, :, power].swapaxes(0, 1) for power in range(3))
