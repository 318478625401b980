"""Eigensystem realisation (Juang and Pappa 1985) on free decays: another way to the same modes.

Every run is the response to its own initial state, as if each were one input of an impulse test:
the runs are adjacent blocks of columns of one block Hankel matrix.  Its singular value
decomposition, cut off at the order, is a realisation of the structure; to balance it would change
neither poles nor shapes.  It is kept in addition to the State Variable Method for comparison: two
methods that agree are better than one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.median import median

from .modal_model import ModalModel
from .state_variable_method import checked_records

_ROWS_S = 0.25
"""Length of a column: some periods of the wheels, a quarter of one of the body."""
_OF_NOISE = 2.858
"""Singular values below this multiple of their median are best left out (Gavish and Donoho
2014)."""
_OF_ROUNDING = 1e-11
_LEAST_BLOCKS = 4


def realised_modes(
    records: Sequence[ArrayLike], rate_hz: float, order: int | None = None
) -> ModalModel:
    """Return the modes of a realisation of some free decays.

    Parameters
    ----------
    records : sequence of (n_samples, n_channels) array_like
        Free decays, evenly sampled, the same channels in each; lengths may differ.
    rate_hz : float
        Samples a second.
    order : int or None
        Number of states, two for each mode; by default as many as stand out from the noise.

    Returns
    -------
    ModalModel
        All pairs of poles that oscillate and decay, spurious ones among them; shapes in the
        channels' own quantities.

    Raises
    ------
    InputError
        As `identify.modes.mode_selection.identify_modes`.
    """
    decays = checked_records(records, rate_hz)
    size = np.sqrt(np.mean(np.concatenate(decays) ** 2, axis=0))
    size[size == 0.0] = 1.0
    shortest = min(len(decay) for decay in decays)
    blocks = min(max(_LEAST_BLOCKS, round(_ROWS_S * rate_hz)), shortest // 2)
    hankel = np.hstack([_hankel(decay / size, blocks) for decay in decays])
    directions, strength, _ = np.linalg.svd(hankel, full_matrices=False)
    if order is None:
        order = standing_out(strength)
    n_channels = len(size)
    observability = directions[:, :order]
    earlier, later = observability[:-n_channels], observability[n_channels:]
    z, vectors = np.linalg.eig(np.linalg.lstsq(earlier, later)[0])
    poles = np.log(np.where(z == 0.0, np.finfo(float).tiny, z).astype(complex)) * rate_hz
    shapes = observability[:n_channels] @ vectors * size[:, None]
    modes = (poles.imag > 0.0) & (poles.real < 0.0)
    return ModalModel(poles[modes], shapes[:, modes])


def standing_out(strength: NDArray[np.float64]) -> int:
    """Return how many singular values, the largest first, stand out from noise and rounding."""
    floor = max(_OF_NOISE * median(strength), _OF_ROUNDING * float(strength[0]))
    return int(np.sum(strength > floor))


def _hankel(decay: NDArray[np.float64], blocks: int) -> NDArray[np.float64]:
    """Return columns with the samples of `blocks` successive instants, one for each start."""
    n = len(decay) - blocks + 1
    windows = np.lib.stride_tricks.sliding_window_view(decay, n, axis=0)
    return np.asarray(windows.reshape(-1, n))
