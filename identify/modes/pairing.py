"""Pairs the modes of a vehicle with those of the same vehicle with added mass.

They are paired by shape, never by frequency: the mass lowers nearly equal frequencies by different
amounts, and modes change places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from dbc.frames import freeze_arrays

from .assignment import best_pairs
from .modal_model import ModalModel, mac


@dataclass(frozen=True, slots=True)
class Pairing:
    """Modes of two mass states, paired."""

    baseline: NDArray[np.intp]
    added: NDArray[np.intp]
    """Indices of the paired modes in either model, the baseline's ascending."""
    mac: NDArray[np.float64]
    """MAC of each pair, 0 to 1, shape (k,)."""
    margin: NDArray[np.float64]
    """MAC of the pair less the largest MAC of either mode with any third, shape (k,)."""
    swapped: tuple[tuple[int, int], ...]
    """Pairs of baseline modes whose partners are in the opposite order of frequency."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "baseline", "added", "mac", "margin")


def pair_modes(baseline: ModalModel, added: ModalModel) -> Pairing:
    """Pair the modes of two mass states so that the sum of their MAC is largest.

    `baseline` and `added`: modes with shapes in the same channels; if one has more modes, some have
    no partner.  Raises InputError if the shapes are of different channels.
    """
    if len(baseline.shapes) != len(added.shapes):
        raise InputError(
            "pairing of modes",
            f"shapes of {len(baseline.shapes)} and of {len(added.shapes)} channels",
            "identify both mass states from the same channels",
        )
    likeness = mac(baseline.shapes, added.shapes)
    rows, columns = best_pairs(likeness)
    chosen = likeness[rows, columns]
    rivals = likeness.copy()
    rivals[rows, columns] = 0.0
    rival = np.maximum(
        rivals.max(axis=1, initial=0.0)[rows], rivals.max(axis=0, initial=0.0)[columns]
    )
    swapped = tuple(
        (int(rows[i]), int(rows[j]))
        for i in range(len(rows))
        for j in range(i + 1, len(rows))
        if columns[i] > columns[j]
    )
    return Pairing(rows, columns, chosen, chosen - rival, swapped)
