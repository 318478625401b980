"""The paper's low-pass: a linear-phase FIR filter by least squares with a 16 Hz pass band."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError

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
