"""Stabilisation: which poles of the State Variable Method recur when its rank is raised.

A pole of the structure is found at every rank above its own; a pole that follows noise moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.median import median
from dbc.frames import freeze_arrays

from .modal_model import mac
from .state_variable_method import DelaySpace, checked_records, delay_space, layouts, poles_of_rank

_SAME_POLE = 0.05
_SAME_SHAPE = 0.9
_SEEN_AGAIN = 2
"""Number of ranks at which a pole must recur."""
_MORE_RANKS = 12
"""Ranks to try beyond the singular values that stand out from the noise."""
_MAX_GROWTH = 0.5
"""Nepers in the longest record: noise makes a mode that hardly decays seem to grow a little."""

Poles = tuple[NDArray[np.complex128], NDArray[np.complex128]]
"""Poles (m,) and their shapes (n_channels, m)."""


@dataclass(frozen=True, slots=True)
class StabilisationDiagram:
    """Poles found at each rank, ready to be drawn: frequency across, rank upwards."""

    rank: NDArray[np.intp]
    """Rank at which the pole was found."""
    poles: NDArray[np.complex128]
    """One of each conjugate pair, and real ones, rad/s, shape (n,)."""
    shapes: NDArray[np.complex128]
    """Entries in the channels, shape (n_channels, n)."""
    stable: NDArray[np.bool_]
    """True if pole and shape recur at the next ranks, shape (n,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "rank", "poles", "shapes", "stable")

    @property
    def stable_sets(self) -> list[Poles]:
        """Stable poles of each rank that has any, in order of frequency."""
        found = []
        for rank in sorted(set(self.rank[self.stable].tolist())):
            which = np.flatnonzero(self.stable & (self.rank == rank))
            which = which[np.argsort(np.abs(self.poles[which]))]
            found.append((self.poles[which], self.shapes[:, which]))
        return found


def stabilisation_diagram(records: Sequence[ArrayLike], rate_hz: float) -> StabilisationDiagram:
    """Return the poles of the State Variable Method over its rank.

    Parameters
    ----------
    records : sequence of (n_samples, n_channels) array_like
        Free decays, evenly sampled, the same channels in each; lengths may differ.
    rate_hz : float
        Samples a second.

    Raises
    ------
    InputError
        As `identify.modes.mode_selection.identify_modes`.
    """
    decays = checked_records(records, rate_hz)
    size = np.sqrt(np.mean(np.concatenate(decays) ** 2, axis=0))
    size[size == 0.0] = 1.0
    scaled = [decay / size for decay in decays]
    space = delay_space(scaled, rate_hz, layouts(scaled, rate_hz)[0])
    diagram = diagram_of(space, max(len(decay) for decay in decays) / rate_hz)
    shapes = diagram.shapes * size[:, None]
    return StabilisationDiagram(diagram.rank, diagram.poles, shapes, diagram.stable)


def diagram_of(space: DelaySpace, duration_s: float) -> StabilisationDiagram:
    """Return the poles of one layout of delays over its rank.

    Real poles are kept: they are not modes, but an offset or a filter's transient has one, and if a
    fit left it out it would be taken for a mode.  `duration_s` is the length of the longest record.
    """
    highest = space.directions.shape[1] - space.n_channels - 1
    standing_out = int(np.sum(space.strength > 2.0 * median(space.strength)))
    highest = min(highest, standing_out + _MORE_RANKS)
    found = []
    for rank in range(1, highest + 1):
        poles, shapes = poles_of_rank(space, rank)
        upper = poles.imag >= 0.0
        found.append((poles[upper], shapes[:, upper]))
    stable = []
    for number, (poles, shapes) in enumerate(found):
        keep = poles.real * duration_s < _MAX_GROWTH
        tolerance = _SAME_POLE * np.maximum(np.abs(poles), 1.0 / duration_s)
        following = found[number + 1 : number + 1 + _SEEN_AGAIN]
        keep &= len(following) == _SEEN_AGAIN
        for again in following:
            keep &= seen_in((poles, shapes), again, tolerance)
        stable.append(keep)
    return StabilisationDiagram(
        np.repeat(np.arange(1, len(found) + 1), [len(poles) for poles, _ in found]),
        np.concatenate([np.zeros(0, complex), *(poles for poles, _ in found)]),
        np.hstack([np.zeros((space.n_channels, 0), complex), *(shapes for _, shapes in found)]),
        np.concatenate([np.zeros(0, bool), *stable]),
    )


def seen_in(candidates: Poles, others: Poles, tolerance: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which candidates recur among the others, by pole and by shape, (m,)."""
    near = np.abs(candidates[0][:, None] - others[0]) < tolerance[:, None]
    return np.asarray(np.any(near & (mac(candidates[1], others[1]) > _SAME_SHAPE), axis=1))
