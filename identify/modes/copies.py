"""Finds copies: poles that a fit keeps separate although they are one mode.

A mode whose frequency differs a little from record to record (another hammer, another temperature)
is fitted better by two adjacent poles than by one, and by far more than noise would explain.  Both
poles have its shape.  Two modes that nearly coincide differ in shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .modal_model import mac

_NEAR = 0.02
"""Distance of two poles, relative to their size, within which they may be one mode."""
_ALIKE = 0.98
"""MAC above which two shapes count as one; two random shapes in three channels exceed it in 1 of
100."""


def originals(
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    amplitudes: NDArray[np.complex128] | None = None,
) -> NDArray[np.intp]:
    """Return the numbers of the modes without copies of others, in their order.

    Of several poles that are one mode the strongest stays.  With one channel there is no shape, and
    no pole is called a copy.

    Parameters
    ----------
    poles : (m,) complex128
        rad/s.
    shapes : (n_channels, m) complex128
        All channels scaled alike.
    amplitudes : (n_runs, m) complex128 or None
        Amplitude of each mode at the start of each run; None if they are not known yet, which
        leaves the pole of the lowest damping.
    """
    m = len(poles)
    if m < 2 or len(shapes) < 2:
        return np.arange(m)
    energy = np.sum(np.abs(shapes) ** 2, axis=0) if amplitudes is not None else np.ones(m)
    if amplitudes is not None:
        energy = energy * np.sum(np.abs(amplitudes) ** 2, axis=0)
    energy = energy / np.maximum(np.abs(poles.real), np.finfo(float).tiny)
    size = np.abs(poles)
    near = np.abs(poles[:, None] - poles) < _NEAR * np.maximum(size[:, None], size)
    same = near & (mac(shapes, shapes) > _ALIKE) & (poles.imag > 0.0)[:, None] & (poles.imag > 0.0)
    kept: list[int] = []
    for mode in np.argsort(-energy, kind="stable").tolist():
        if not any(same[mode, other] for other in kept):
            kept.append(mode)
    return np.sort(np.array(kept, dtype=np.intp))
