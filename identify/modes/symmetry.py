"""Left and right: the effect of a mirror on the sensors of a vehicle, and on its modes.

A vehicle that is its own mirror image has symmetric modes (heave, pitch, axles in parallel) and
antisymmetric ones (roll, axles in opposition), and neither kind moves the other.  Sums and
differences of mirrored sensors then each show one kind, which separates wheel modes of nearly one
pole.  The data decide whether the vehicle is symmetric (`identify.modes.vehicle_modes`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import AT_CORNER, ON_BODY, Channel, Quantity
from dbc.frames import freeze_arrays

from .normal_equations import Ties

_SAME_PLACE_M = 0.005
"""Largest distance from the exact mirror place at which sensors count as mirror images."""

_ROLL = frozenset({Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION})


@dataclass(frozen=True, slots=True)
class Mirror:
    """The mirror image of each channel."""

    image: NDArray[np.intp]
    """Channel that is the mirror image, possibly the channel itself; -1 if there is none."""
    sign: NDArray[np.float64]
    """-1 if the mirror turns its sign (roll), else 1, shape (n_channels,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "image", "sign")

    def combinations(self, parity: float) -> NDArray[np.float64]:
        """Return the combinations of channels that show modes of one kind only.

        `parity`: 1 for symmetric modes, -1 for antisymmetric ones.  Returns (k, n_channels)
        float64: orthonormal rows; none of a channel without image.
        """
        n = len(self.image)
        rows = []
        for channel in np.flatnonzero(self.image >= np.arange(n)):
            image = self.image[channel]
            row = np.zeros(n)
            row[channel] = 1.0
            row[image] += parity * self.sign[channel]
            if np.any(row):
                rows.append(row / np.linalg.norm(row))
        return np.array(rows).reshape(-1, n)

    def ties(self, parity: NDArray[np.float64]) -> Ties:
        """Return the ties of the channels in modes of given kinds, (m,) of 1 or -1."""
        n = len(self.image)
        owner = np.where(self.image >= 0, np.minimum(self.image, np.arange(n)), np.arange(n))
        _, owner = np.unique(owner, return_inverse=True)
        sign = np.ones((n, len(parity)))
        for channel, image in enumerate(self.image):
            if image == channel:
                sign[channel] = parity == self.sign[channel]
            elif 0 <= image < channel:
                sign[channel] = parity * self.sign[channel]
        return Ties(owner, sign)


def mirror_of(channels: Sequence[Channel]) -> Mirror:
    """Return the mirror image of some channels, by their quantity and place."""
    sign = np.array([-1.0 if channel.quantity in _ROLL else 1.0 for channel in channels])
    image = np.array([_image(channel, channels) for channel in channels], dtype=np.intp)
    return Mirror(image, sign)


def _image(channel: Channel, channels: Sequence[Channel]) -> int:
    found = [number for number, other in enumerate(channels) if _mirrored(channel, other)]
    back = [number for number, other in enumerate(channels) if _mirrored(other, channel)]
    # With two sensors at one place the image is ambiguous.
    twins = [other for other in channels if found and _mirrored(other, channels[found[0]])]
    return found[0] if len(found) == len(back) == len(twins) == 1 else -1


def _mirrored(one: Channel, other: Channel) -> bool:
    if one.quantity is not other.quantity:
        return False
    if one.quantity in AT_CORNER and one.corner and other.corner:
        return one.corner.front is other.corner.front and one.corner.side == -other.corner.side
    if one.quantity in ON_BODY:
        if one.at_cg or other.at_cg:
            return one.at_cg and other.at_cg
        gap = np.hypot(one.x_m - other.x_m, one.y_m + other.y_m)
        return bool(gap <= _SAME_PLACE_M)
    return True
