"""The paper's low-pass and its figure 9: the noisy and the filtered signal.

The low-pass is a linear-phase FIR filter by least squares with a 16 Hz pass band.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from daq.runs import Excitation
from dbc.errors import InputError

from .campaign import BUMP, Campaign, records_of, require_noise
from .result import Column, Curve, CurvePanel, Study

PASS_HZ = 16.0
"""Section 4.3."""

_MEMORY_S = 0.05
"""Length of the filter; the paper does not state it.  A filtered free decay is still a free decay,
but only where the whole memory lies in it, and the wheels lose three fifths of their motion in 50
ms."""
_STOP_HZ = 60.0
"""Start of the stop band, Hz: with so short a memory, 35 dB down from here, and little above 30
Hz."""


def taps(rate_hz: float) -> NDArray[np.float64]:
    """Return the filter for samples at `rate_hz`, (n,), n odd and symmetric.

    Raises
    ------
    InputError
        If the rate leaves no room for a stop band.
    """
    from scipy.signal import firls

    if rate_hz <= 2.0 * _STOP_HZ:
        raise InputError(
            "rate",
            f"{rate_hz:g} Hz leaves no room for a {PASS_HZ:g} Hz low-pass",
            f"give more than {2.0 * _STOP_HZ:g} Hz",
        )
    n = 2 * round(_MEMORY_S * rate_hz / 2.0) + 1
    bands = (0.0, PASS_HZ, _STOP_HZ, rate_hz / 2.0)
    return np.asarray(firls(n, bands, (1.0, 1.0, 0.0, 0.0), fs=rate_hz), dtype=np.float64)


def filtered(values: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Return the filtered samples, (n - n_taps + 1, n_channels).

    There is a result only where the whole memory is filled; the first belongs to the middle of the
    first n_taps samples.
    """
    weights = taps(rate_hz)
    windows = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=0)
    return np.asarray(windows @ weights)


_SHOWN = {"z_s": "Body, vertical (z_s)", "z_uA": "Front left hub (z_uA)"}
_SHOWN_S = (0.0, 1.2)
_TAIL_S = (0.5, 0.8)
"""Time span, s, in which the wheels come to rest and the noise is visible."""


def fig9_study(rate_hz: float, noise_db: float, seed: int) -> Study:
    """Return the effect of the paper's low-pass on the accelerations of a bounce run (Fig. 9).

    `rate_hz`: samples a second.  `noise_db`: distance from signal to noise.  `seed`: draws the
    noise.  Raises InputError if a rate or noise level cannot be studied.
    """
    campaign = Campaign(rate_hz=rate_hz, noise_db=noise_db, cases=(Excitation.BOUNCE,))
    require_noise(campaign)
    noisy = records_of(campaign, seed)[0].recordings[0]
    clean = records_of(replace(campaign, noise_db=inf), seed)[0].recordings[0]
    low, clean_low = (filtered(values, rate_hz) for values in (noisy.values, clean.values))
    half = len(taps(rate_hz)) // 2
    time, time_low = noisy.time_s, noisy.time_s[half : len(noisy.time_s) - half]
    decay, decay_low = time > BUMP.end_s, time_low > BUMP.end_s + half / rate_hz
    rows, panels = [], []
    for name, title in _SHOWN.items():
        c = [channel.name for channel in noisy.group.channels].index(name)
        before, after = noisy.values[:, c] - clean.values[:, c], low[:, c] - clean_low[:, c]
        rows.append(
            (
                name,
                _rms(clean.values[:, c]),
                _rms(before),
                _rms(after),
                _db(clean.values[decay, c], before[decay]),
                _db(clean_low[decay_low, c], after[decay_low]),
            )
        )
        signals = {"noisy": (time, noisy.values[:, c]), "filtered": (time_low, low[:, c])}
        panels.append(
            (
                _panel(title, "acceleration / (m/s²)", signals, _SHOWN_S),
                _panel("The same, enlarged", "acceleration / (m/s²), enlarged", signals, _TAIL_S),
            )
        )
    return Study(
        title=f"Fig. 9, bounce run with {noise_db:g} dB of noise at {rate_hz:g} Hz, {PASS_HZ:g} Hz"
        " linear-phase FIR low-pass",
        columns=(
            Column("channel", "channel"),
            Column("signal_rms", "signal m/s²", ".3f"),
            Column("noise_rms", "noise m/s²", ".4f"),
            Column("noise_filtered_rms", "noise filtered m/s²", ".4f"),
            Column("decay_db", "decay dB", ".1f"),
            Column("decay_filtered_db", "decay filtered dB", ".1f"),
        ),
        rows=tuple(rows),
        notes=(
            f"The filter ({2 * half + 1} taps, least squares, stop band from 60 Hz) does not delay:"
            " its results belong to the middle of its memory.",
            "Noise counts from the rms of the whole run, bump included. The free decay, which alone"
            " is identified, is weaker: the last columns.",
        ),
        panels=tuple(panels),
    )


def _panel(
    title: str,
    y_label: str,
    signals: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
    span_s: tuple[float, float],
) -> CurvePanel:
    """Return a diagram of signals, each (time, values), within a span of time."""
    curves = []
    for hue, (name, (time_s, values)) in zip((0, 2), signals.items(), strict=True):
        shown = (time_s >= span_s[0]) & (time_s <= span_s[1])
        curves.append(Curve(name, time_s[shown], values[shown], hue))
    return CurvePanel(title, "time / s", y_label, tuple(curves))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _db(signal: NDArray[np.float64], noise: NDArray[np.float64]) -> float:
    return 20.0 * float(np.log10(_rms(signal) / _rms(noise)))
