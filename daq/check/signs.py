"""Finds travels and rates with a wrong sign, from channels that move with them in a swing.

Above 5 Hz a wheel's accelerometer and its travel show the same motion; below 4 Hz travels and
gyroscopes show the same motion.  No parameter of the car changes the relative signs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.words import Finding, Severity

from ..channels import Channel, Quantity
from ..runs import Run
from ..vehicle import Corner

_RATE_HZ = 250.0
"""Rate, Hz, of the grid on which all channels of a run are compared."""
_BODY_HZ = (0.7, 2.5)
"""Band of frequencies, Hz, in which the body swings and the wheels hardly do."""
_TILT_RATIO = 0.3
"""Ratio of roll (or pitch) to all motion of the travels, in power, from which a run shows the sign
of a rate: a bounce does not show that of the roll."""

_TILTS = {
    Quantity.ROLL_RATE: {corner: -corner.side for corner in Corner},
    Quantity.PITCH_RATE: {corner: 1 if corner.front else -1 for corner in Corner},
}
"""Signs of the travels' change at a positive rate: left side extended, front compressed."""

Spectrum = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Spectra of the channels of a run, on one grid of times."""

    hz: NDArray[np.float64]
    """Frequencies, Hz, shape (m,)."""
    of: Mapping[str, Spectrum]
    """Spectra by name of the channel, shape (m,)."""

    def sum(self, signs: Mapping[str, int]) -> Spectrum:
        """Return the sum of channels with these signs."""
        return np.asarray(np.sum([n * self.of[name] for name, n in signs.items()], axis=0))

    def body_power(self, spectrum: Spectrum) -> float:
        """Return the power in the body's band."""
        body = (self.hz >= _BODY_HZ[0]) & (self.hz < _BODY_HZ[1])
        return float(np.sum(np.abs(spectrum[body]) ** 2))

    def is_tilt(self, signs: Mapping[str, int]) -> bool:
        """Return whether the travels' motion is in large part that with these signs."""
        total = sum(self.body_power(self.of[name]) for name in signs)
        # n equal travels with these signs have n**2 times the power of one, n times their total.
        return self.body_power(self.sum(signs)) > _TILT_RATIO * len(signs) * total


def opposed_signs(runs: Sequence[Run], channels: Sequence[Channel]) -> tuple[Finding, ...]:
    """Return findings that name travels opposed to their hubs, and rates opposed to the travels.

    `runs`: with their samples, SI, signs applied.  `channels`: of the session.  Travels are
    compared with the hub accelerometers; then, if every wheel has a travel, rates of pitch and roll
    with the travels, in the runs that show that motion.  A channel without a channel for
    comparison, or without such a run, is not judged.
    """
    spectra = [spectra for run in runs if (spectra := _spectra(run)) is not None]
    travels = {c.corner: c.name for c in channels if c.quantity is Quantity.SUSPENSION_TRAVEL}
    hubs = {c.corner: c.name for c in channels if c.quantity is Quantity.HUB_ACCELERATION}
    opposed_travels = []
    for corner in Corner:
        travel, hub = travels.get(corner, ""), hubs.get(corner, "")
        pairs = [
            # An acceleration integrated twice is a displacement; 0 Hz does not count.
            (s, s.of[travel], -s.of[hub] / (2 * np.pi * np.maximum(s.hz, 0.1)) ** 2)
            for s in spectra
            if {travel, hub} <= set(s.of)
        ]
        if _is_opposed(pairs, (5.0, 15.0)):  # Hz, where wheels swing and the body hardly does
            opposed_travels.append(travel)
    findings = _finding(opposed_travels, "against the hub accelerometers")
    if len(travels) < len(Corner):
        return findings
    for quantity, tilt in _TILTS.items():
        signs = {
            travels[corner]: -sign if travels[corner] in opposed_travels else sign
            for corner, sign in tilt.items()
        }
        opposed_rates = []
        for name in (c.name for c in channels if c.quantity is quantity):
            pairs = [
                # The rate that belongs to a tilt is its derivative.
                (s, s.of[name], 2j * np.pi * s.hz * s.sum(signs))
                for s in spectra
                if {name, *signs} <= set(s.of) and s.is_tilt(signs)
            ]
            if _is_opposed(pairs, _BODY_HZ):
                opposed_rates.append(name)
        findings += _finding(opposed_rates, "against the travels")
    return findings


def _finding(names: Sequence[str], against: str) -> tuple[Finding, ...]:
    """Return one finding on all channels of these names; none if there is no name."""
    if not names:
        return ()
    subject = ", ".join(names)
    text = f"{subject} {'moves' if len(names) == 1 else 'move'} {against}"
    advice = "change the sign of these channels"
    return (Finding("opposed_sign", Severity.ERROR, text, subject, advice),)


def _spectra(run: Run) -> _Spectra | None:
    """Return the spectra of the channels of a run; None if they have no second in common."""
    sampled = [
        (group, name)
        for group in run.groups
        for name, value in group.values.items()
        if np.isfinite(value).sum() > 1
    ]
    start_s = max((float(group.time_s[0]) for group, _ in sampled), default=0.0)
    end_s = min((float(group.time_s[-1]) for group, _ in sampled), default=0.0)
    n = int((end_s - start_s) * _RATE_HZ)
    if n < _RATE_HZ:  # less than a second
        return None
    time_s = start_s + np.arange(n) / _RATE_HZ
    spectra = {}
    for group, name in sampled:
        value = group.values[name]
        good = np.isfinite(value)
        on_grid = np.interp(time_s, group.time_s[good], value[good])
        # Twice the length, padded with zeros: a lag then brings in no values of the other end.
        spectra[name] = np.asarray(np.fft.rfft(on_grid - on_grid.mean(), 2 * n), np.complex128)
    hz = np.asarray(np.fft.rfftfreq(2 * n, 1 / _RATE_HZ), np.float64)
    return _Spectra(hz, spectra)


def _is_opposed(
    pairs: Sequence[tuple[_Spectra, Spectrum, Spectrum]], band_hz: tuple[float, float]
) -> bool:
    """Return whether two signals, the same in each run, have opposite signs in a band.

    `pairs`: for each run its spectra, and those of the two signals.  False if one of them does not
    move there.
    """
    # Signals of equal signs look opposed if one is late, at 8 Hz by 0.06 s; then a lag makes them
    # agree better than they differ without one.
    lags_s = np.linspace(-0.06, 0.06, 25)
    product, powers = np.zeros(len(lags_s)), np.zeros(2)  # cross-correlation; power of each signal
    for spectra, first, second in pairs:
        in_band = (spectra.hz >= band_hz[0]) & (spectra.hz < band_hz[1])
        a, b = first[in_band], second[in_band]
        shift = np.exp(2j * np.pi * np.outer(lags_s, spectra.hz[in_band]))  # (lags, frequencies)
        product += (shift @ (a.conj() * b)).real
        powers += np.sum(np.abs(a) ** 2), np.sum(np.abs(b) ** 2)
    if not powers.all():
        return False
    correlation = product / np.sqrt(powers[0] * powers[1])
    without_lag = float(correlation[len(lags_s) // 2])  # the middle of the lags is 0
    return without_lag < -0.5 and -without_lag >= float(np.max(correlation))  # half in common
