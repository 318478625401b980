"""A sensor's own low-pass, as it acts on a free decay.

A linear filter turns ``exp(l t)`` into ``H(l) exp(l t)`` and adds a transient of its own poles,
whose size depends on what came before the decay.  Both are known functions of time, so a filtered
channel is fitted as it is: nothing is inverted, and the transient is one more unknown amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel


@dataclass(frozen=True, slots=True)
class LowPass:
    """A Butterworth low-pass, gain 1 at rest."""

    poles: NDArray[np.complex128]
    """rad/s, shape (order,); conjugate pairs adjacent, the one with positive imaginary part first;
    empty for a channel without a filter."""

    def gain(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the transfer function H at complex frequencies `s`, rad/s."""
        if not len(self.poles):
            return np.ones_like(s)
        return np.asarray(np.prod(-self.poles / (s[..., None] - self.poles), axis=-1))

    def gain_slope(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return dH/ds."""
        if not len(self.poles):
            return np.zeros_like(s)
        return np.asarray(-self.gain(s) * np.sum(1.0 / (s[..., None] - self.poles), axis=-1))

    def transients(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the functions of time that the filter's own motion consists of, (n, order)."""
        upper = self.poles[self.poles.imag > 0]
        real = self.poles[self.poles.imag == 0].real
        wave = np.exp(np.multiply.outer(time_s, upper))
        return np.hstack([wave.real, wave.imag, np.exp(np.multiply.outer(time_s, real))])


def low_pass_of(channel: Channel) -> LowPass:
    """Return the low-pass of a channel; without one, H is 1 and there are no transients."""
    if channel.low_pass_hz <= 0.0:
        return LowPass(np.zeros(0, dtype=complex))
    n = channel.low_pass_order
    angle = np.pi * (2 * np.arange(n // 2) + n + 1) / (2 * n)  # left half-plane, upper half
    upper = np.exp(1j * angle)
    unit = np.concatenate([np.column_stack([upper, upper.conj()]).ravel(), [-1.0] * (n % 2)])
    poles = 2.0 * np.pi * channel.low_pass_hz * unit
    return LowPass(poles.astype(np.complex128))
