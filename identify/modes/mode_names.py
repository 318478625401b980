"""Names for the modes of a vehicle by what moves in them."""

from __future__ import annotations

import numpy as np

from daq.vehicle import VehicleGeometry

from .assignment import best_pairs
from .modal_model import ModalModel

MODE_NAMES = (
    "body bounce",
    "body pitch",
    "body roll",
    "front wheels symmetric",
    "front wheels antisymmetric",
    "rear wheels symmetric",
    "rear wheels antisymmetric",
)
"""Names of the modes of a vehicle of seven degrees of freedom."""


def mode_names(model: ModalModel, geometry: VehicleGeometry) -> tuple[str, ...]:
    """Name each mode by the motion that has the largest share in it.

    The body counts by the motion of its four corners, the wheels by their own motion: body pitch is
    the pitch angle times half the wheelbase, body roll the roll angle times the half width.  Bounce
    and pitch are mixed in most vehicles, so two modes may have the same largest share; names are
    assigned so that no two modes have the same one and the sum of the named shares is largest.

    Parameters
    ----------
    model : ModalModel
        Displacement shapes (7, m), order `daq.vehicle.DOF`.
    geometry : VehicleGeometry
        Of the vehicle.

    Returns
    -------
    tuple of str
        One of `MODE_NAMES` for each mode, ``"further mode"`` for those beyond seven.
    """
    z, theta, phi, A, B, C, D = model.shapes
    wheelbase = geometry.a + geometry.b
    half_width = (geometry.t_f + geometry.t_r) / 2.0
    motions = np.stack(
        [
            2.0 * z,
            theta * wheelbase,
            2.0 * phi * half_width,
            (A + B) / np.sqrt(2.0),
            (A - B) / np.sqrt(2.0),
            (C + D) / np.sqrt(2.0),
            (C - D) / np.sqrt(2.0),
        ]
    )
    share = np.abs(motions) ** 2
    share /= share.sum(axis=0)
    names = ["further mode"] * len(model)
    for motion, mode in zip(*best_pairs(share), strict=True):
        names[mode] = MODE_NAMES[motion]
    return tuple(names)
