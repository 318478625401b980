"""Sums of exponentials as data: the basis of every free decay and of its derivatives.

With the eigenvalues l_k of the state matrix, a channel of a free decay is a sum of ``exp(l_k t)``,
and its derivative by any parameter is a sum of ``exp(l_k t)`` and ``t exp(l_k t)``.  So a recording
enters a fit only through the products of these 28 functions (and a few of the channels' own: a
constant, the transients of a low-pass) with each other and with the samples: the cost of a fit is
linear in the samples, whatever the number of parameters.  The functions are evaluated at each
sample's own time; there is no common grid.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel

from .matrices import Complex, Real

# A sensor's own low-pass, as it acts on a free decay ----------------------------------------------
#
# A linear filter turns ``exp(l t)`` into ``H(l) exp(l t)`` and adds a transient of its own poles,
# whose size depends on what came before the decay.  Both are known functions of time, so a filtered
# channel is fitted as it is: nothing is inverted, and the transient is one more unknown amplitude.


@dataclass(frozen=True, slots=True)
class LowPass:
    """A Butterworth low-pass, gain 1 at rest."""

    poles: Complex
    """rad/s, shape (order,); conjugate pairs adjacent, the one with positive imaginary part first;
    empty for a channel without a filter."""

    def gain(self, s: Complex) -> Complex:
        """Return the transfer function H at complex frequencies `s`, rad/s."""
        return np.asarray(np.prod(-self.poles / (s[..., None] - self.poles), axis=-1))

    def gain_slope(self, s: Complex) -> Complex:
        """Return dH/ds."""
        return np.asarray(-self.gain(s) * np.sum(1.0 / (s[..., None] - self.poles), axis=-1))

    def transients(self, time_s: Real) -> Real:
        """Return the functions of time that the filter's own motion consists of, (n, order)."""
        upper_poles = self.poles[self.poles.imag > 0]
        real_poles = self.poles[self.poles.imag == 0].real
        wave = np.exp(np.multiply.outer(time_s, upper_poles))
        return np.hstack([wave.real, wave.imag, np.exp(np.multiply.outer(time_s, real_poles))])


def low_pass_of(channel: Channel) -> LowPass:
    """Return the low-pass of a channel; without one, H is 1 and there are no transients."""
    if channel.low_pass_hz <= 0.0:
        return LowPass(np.zeros(0, dtype=complex))
    n = channel.low_pass_order
    angle = np.pi * (2 * np.arange(n // 2) + n + 1) / (2 * n)  # left half-plane, upper half
    upper = np.exp(1j * angle)
    poles_at_1 = np.concatenate([np.column_stack([upper, upper.conj()]).ravel(), [-1.0] * (n % 2)])
    poles = 2.0 * np.pi * channel.low_pass_hz * poles_at_1
    return LowPass(poles.astype(np.complex128))


# The free decay in modal coordinates --------------------------------------------------------------


def waves(time_s: Real, rates: Complex) -> Complex:
    """Return ``exp(rate t)`` of every rate at every time, (.., n_rates)."""
    return np.asarray(np.exp(np.multiply.outer(time_s, rates)))


def real_functions(time_s: Real, rates: Complex) -> Real:
    """Return the real functions of p rates at some times, (n_samples, 4 p).

    They are ``Re exp(rate t)``, ``t Re exp(rate t)``, ``Im exp(rate t)``, ``t Im exp(rate t)``,
    each of all rates.
    """
    wave = waves(time_s, rates)
    both = np.hstack([wave, time_s[:, None] * wave])
    return np.hstack([both.real, both.imag])


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Eigenvalues and eigenvectors of a real state matrix."""

    poles: Complex
    """Eigenvalues, rad/s, shape (n,); conjugate pairs adjacent."""
    V: Complex
    W: Complex
    """`V`, `W`: right eigenvectors and their inverse, shape (n, n)."""
    half: NDArray[np.intp]
    """Indices of the real poles and of the upper one of each pair, shape (h,)."""

    def change(self, dA: Real) -> tuple[Complex, Complex, Complex]:
        """Return how changes of the state matrix, (P, n, n) in 1/s, mix the modes and shift poles.

        Mixing: the change in modal coordinates from each pole to one of `half`, then that from one
        of `half` to each pole, both divided by the difference of the two poles, and 0 where they
        are equal.  Shift: the change from each pole to one of `half` that is equal, or to itself,
        else 0.  Each (n, h, P).  The entries of the other pole of a pair are conjugate.
        """
        modal = self.W @ dA @ self.V
        gap = self.poles[:, None] - self.poles[None, :]
        size = np.abs(self.poles)[:, None] + np.abs(self.poles)[None, :]
        # Eigenvalues that are closer are one double eigenvalue.
        is_same = np.abs(gap) < 1e-7 * size
        inverse_gap = np.where(is_same, 0.0, 1.0 / np.where(is_same, 1.0, gap))
        mixing, shift = modal * inverse_gap, modal * is_same
        return (
            np.ascontiguousarray(mixing[:, self.half].T),
            np.ascontiguousarray(mixing[:, :, self.half].transpose(1, 2, 0)),
            np.ascontiguousarray(shift[:, self.half].T),
        )

    def on_real_functions(self, plain: Complex, timed: Complex | float = 0.0) -> Real:
        """Return `real_functions`' coefficients, (.., 4 h, P), by those of exp, t exp, (.., h, P).

        ``c exp + conj(c exp)`` is ``2 Re c Re exp - 2 Im c Im exp``; a real pole has no conjugate.
        """
        count = np.where(self.poles[self.half].imag > 0.0, 2.0, 1.0)[:, None]
        plain, timed = plain * count, timed * count + np.zeros_like(plain)
        on_functions = (plain.real, timed.real, -plain.imag, -timed.imag)
        return np.concatenate(on_functions, axis=-2)


def spectrum(A: Real) -> Spectrum:
    """Return the eigenvalues and eigenvectors of a real state matrix, (n, n) in 1/s."""
    poles, V = np.linalg.eig(A)
    poles, V = poles.astype(complex), V.astype(complex)
    return Spectrum(poles, V, np.linalg.inv(V), np.flatnonzero(poles.imag >= 0))


# Products of exponentials with each other and with samples, without a table of either -------------
#
# Even times are a coarse and a fine step each, ``t = T + d``, so that ``exp(l t) = exp(l T) exp(l
# d)``: a sum over n samples becomes one over some sqrt(n) coarse and one over as many fine steps,
# exact to rounding.  The samples after the last whole coarse step are summed one by one, and so are
# samples at times that are not even.  Recordings that are laid out alike are handled together.


@dataclass(frozen=True, slots=True)
class Series:
    """Samples of r recordings that are laid out alike, each with k channels."""

    members: tuple[int, ...]
    """Indices of the recordings among those that were laid out."""
    count: NDArray[np.intp]
    """Number of samples of each, shape (r,)."""
    coarse_s: Real
    """Coarse steps, s, shape (r, n)."""
    fine_s: Real
    """Fine steps, s, shape (r, w)."""
    tail_s: Real
    """Times of the samples left over, s, shape (r, q)."""
    present: Real
    """1 where there is such a sample, else 0, shape (r, q)."""
    steps: Real
    """Samples at the steps, shape (r, n, k, w)."""
    tail: Real
    """Samples left over, zero where there is none, shape (r, q, k)."""
    power: Real
    """Sum of the squares of the samples, shape (r, k)."""


@dataclass(frozen=True, slots=True)
class Waves:
    """``exp(rate t)`` of p rates at the times of some series."""

    series: Series
    coarse_s: Real
    tail_s: Real
    """`coarse_s`, `tail_s`: times of the series, less the lateness, s."""
    coarse: Complex
    """At the coarse steps, shape (r, n, p)."""
    fine: Complex
    """At the fine steps, shape (r, w, p)."""
    tail: Complex
    """At the samples left over, zero where there is none, shape (r, q, p)."""

    def grams(self) -> tuple[Complex, Complex]:
        """Return the sums of ``conj(f) g`` and of ``f g``, each (r, 2 p, 2 p).

        The functions are ``exp(rate t)`` and then ``t exp(rate t)``.
        """
        # Sums with 1, t and t^2 over all samples: t is a coarse and a fine time, and the samples
        # left over are added.
        c0, c1, c2 = _moments(self.coarse, self.coarse_s)
        f0, f1, f2 = _moments(self.fine, self.series.fine_s)
        q0, q1, q2 = _moments(self.tail, self.tail_s)
        p = self.fine.shape[2]
        sums = np.empty((2, len(self.fine), 2 * p, 2 * p), dtype=complex)
        sums[..., :p, :p] = c0 * f0 + q0
        sums[..., :p, p:] = sums[..., p:, :p] = c1 * f0 + c0 * f1 + q1
        sums[..., p:, p:] = c2 * f0 + 2.0 * c1 * f1 + c0 * f2 + q2
        return sums[0], sums[1]

    def with_samples(self) -> Complex:
        """Return the sums of the samples times ``exp(rate t)``, ``t exp(rate t)``, (r, k, 2 p)."""
        steps, tail = self.series.steps, self.series.tail
        r, n, k, w = steps.shape
        fine = _with_time(self.fine, self.series.fine_s)
        # Real samples times complex functions, as products of real tables: half of the work.
        within_steps = (steps.reshape(r, n * k, w) @ fine.view(np.float64)).view(np.complex128)
        within_steps = within_steps.reshape(r, n, k, 2, -1)
        on_exp, on_t_exp = within_steps[..., 0, :], within_steps[..., 1, :]
        coarse = self.coarse[:, :, None]
        sums = np.empty((r, k, 2, fine.shape[2] // 2), dtype=complex)
        sums[:, :, 0] = np.sum(coarse * on_exp, axis=1)
        # t is the coarse time and the fine one, which is in `on_t_exp`.
        by_time = self.coarse_s[:, :, None, None] * on_exp + on_t_exp
        sums[:, :, 1] = np.sum(coarse * by_time, axis=1)
        tail_functions = _with_time(self.tail, self.tail_s).view(np.float64)
        tail_sums = (tail.swapaxes(1, 2) @ tail_functions).view(np.complex128)
        return np.asarray(sums.reshape(r, k, -1) + tail_sums)


def series_of(times_s: Sequence[Real], samples: Sequence[Real]) -> tuple[Series, ...]:
    """Return recordings, times (n_i,), s, and samples (n_i, k_i), laid out in some series.

    Recordings with as many fine steps (`_fine_steps`), coarse steps and channels are one series.
    """
    members_of: defaultdict[tuple[int, int, int], list[int]] = defaultdict(list)
    for i, (time_s, values) in enumerate(zip(times_s, samples, strict=True)):
        width = _fine_steps(time_s)
        members_of[width, len(time_s) // width, values.shape[1]].append(i)
    result = []
    for (width, n_coarse, n_channels), members in members_of.items():
        n_whole = n_coarse * width  # samples in whole coarse steps
        times = [times_s[i] for i in members]
        count = np.array([len(time) for time in times])
        durations_s = np.array([time[-1] - time[0] for time in times])
        steps_s = durations_s / np.maximum(count - 1, 1)  # from sample to sample
        n_tail = count.max() - n_whole
        tail_s, present = np.zeros((2, len(members), n_tail))
        tail = np.zeros((len(members), n_tail, n_channels))
        steps = np.empty((len(members), n_coarse, n_channels, width))
        for row, i in enumerate(members):
            whole, rest = np.split(samples[i], [n_whole])
            steps[row] = whole.reshape(n_coarse, width, n_channels).swapaxes(1, 2)
            tail[row, : len(rest)], present[row, : len(rest)] = rest, 1.0
            tail_s[row, : len(rest)] = times_s[i][n_whole:]
        result.append(
            Series(
                members=tuple(members),
                count=count,
                coarse_s=np.stack([time[:n_whole:width] for time in times]),
                fine_s=np.multiply.outer(steps_s, np.arange(width)),
                tail_s=tail_s,
                present=present,
                steps=steps,
                tail=tail,
                power=np.array([np.einsum("ij,ij->j", samples[i], samples[i]) for i in members]),
            )
        )
    return tuple(result)


def waves_of(series: Series, rates: Complex, lateness_s: Real | float = 0.0) -> Waves:
    """Return ``exp(rate t)`` of some series; t: times less `lateness_s`, one of all or of each."""
    of_each_s = np.broadcast_to(lateness_s, len(series.members))[:, None]
    coarse_s, tail_s = series.coarse_s - of_each_s, series.tail_s - of_each_s
    coarse, fine, tail = (waves(time_s, rates) for time_s in (coarse_s, series.fine_s, tail_s))
    tail = np.where(series.present[..., None] > 0.0, tail, 0.0)
    return Waves(series, coarse_s, tail_s, coarse, fine, tail)


def _fine_steps(time_s: Real) -> int:
    """Return how many fine steps a coarse one has; 1 where times are few or not even."""
    n = len(time_s)
    if n < 64:  # steps would save nothing
        return 1
    even_times_s = time_s[0] + float(time_s[-1] - time_s[0]) / (n - 1) * np.arange(n)
    # Even times may depart from their line by eight spacings of float64.
    is_even = np.abs(time_s - even_times_s).max() <= 8.0 * np.spacing(np.abs(time_s).max())
    return int(2 ** round(np.log2(n) / 2.0)) if is_even else 1


def _with_time(wave: Complex, time_s: Real) -> Complex:
    """Return waves, (r, n, p), and then these times t, (r, n, 2 p)."""
    return np.concatenate([wave, time_s[..., None] * wave], axis=-1)


def _moments(wave: Complex, time_s: Real) -> tuple[Complex, ...]:
    """Return the sums of ``conj(f) g`` and ``f g``, times 1, t and t squared, each (2, r, p, p)."""
    r, _, p = wave.shape
    time = time_s[..., None]
    by_time = time * wave
    with_powers = np.concatenate([wave, by_time, time * by_time], axis=2)
    both = np.concatenate([wave.conj(), wave], axis=2).swapaxes(1, 2)
    sums = (both @ with_powers).reshape(r, 2, p, 3, p)
    return tuple(sums[:, :, :, power].swapaxes(0, 1) for power in range(3))
