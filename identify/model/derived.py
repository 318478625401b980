"""Quantities that follow from the parameters and that engineers quote for a vehicle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import Corner

from .facts import corner_load

Value = tuple[NDArray[np.complex128], str]
"""A quantity, (...), and its SI unit (1 for a ratio)."""


def derived_quantities(full: NDArray[np.complex128]) -> dict[str, Value]:
    """Return each derived quantity of a vehicle, (28,) or stacked, with its unit.

    Total mass and axle loads; wheelbase; radii of gyration of the sprung mass and its dynamic index
    k^2 / (a b); loads under the wheels on level ground without cross weight; damping ratio and
    natural frequency of each axle's body on its suspension (quarter car, tyre rigid) and of its
    wheel between both springs.
    """
    m_s, I_yy, I_xx = (full[..., i] for i in range(3))
    a, b = full[..., 19], full[..., 20]
    result: dict[str, Value] = {
        "total_mass": (m_s + full[..., 3:7].sum(axis=-1), "kg"),
        "front_axle_load": (m_s * b / (a + b) + full[..., 3:5].sum(axis=-1), "kg"),
        "rear_axle_load": (m_s * a / (a + b) + full[..., 5:7].sum(axis=-1), "kg"),
        "wheelbase": (a + b, "m"),
        "pitch_radius_of_gyration": (np.sqrt(I_yy / m_s), "m"),
        "roll_radius_of_gyration": (np.sqrt(I_xx / m_s), "m"),
        "dynamic_index": (I_yy / (m_s * a * b), "1"),
    }
    for corner in Corner:
        load = corner_load(corner, full, np.zeros_like(m_s))
        result[f"corner_load_{corner.lower()}"] = (load, "kg")
    for axle, left, lever in (("front", 0, b), ("rear", 2, a)):
        m_u, k_s, k_t, c_s = (
            full[..., 3 + 4 * kind + left : 5 + 4 * kind + left].mean(axis=-1) for kind in range(4)
        )
        body = m_s * lever / (a + b) / 2.0
        result[f"{axle}_ride_frequency"] = (np.sqrt(k_s / body) / (2.0 * np.pi), "Hz")
        result[f"{axle}_ride_damping_ratio"] = (c_s / (2.0 * np.sqrt(k_s * body)), "1")
        hop = k_s + k_t
        result[f"{axle}_wheel_hop_frequency"] = (np.sqrt(hop / m_u) / (2.0 * np.pi), "Hz")
        result[f"{axle}_wheel_hop_damping_ratio"] = (c_s / (2.0 * np.sqrt(hop * m_u)), "1")
    return result


def whole_vehicle_indices(full: NDArray[np.complex128]) -> dict[str, NDArray[np.complex128]]:
    """Return two ratios in which vehicles of all sizes are alike, wheels included.

    `roll_gyration_over_track`: radius of gyration in roll over the mean track.  `pitch_index`:
    k_y^2 / (a b) about the centre of gravity of the whole.
    """
    m_s, I_yy, I_xx = (full[..., i] for i in range(3))
    a, b, t_f, t_r = (full[..., i] for i in range(19, 23))
    front, rear = full[..., 3:5].sum(axis=-1), full[..., 5:7].sum(axis=-1)
    mass = m_s + front + rear
    x = (front * a - rear * b) / mass  # centre of the whole, forward of that of the body
    pitch = I_yy + m_s * x**2 + front * (a - x) ** 2 + rear * (b + x) ** 2
    roll = I_xx + front * t_f**2 + rear * t_r**2
    return {
        "roll_gyration_over_track": np.asarray(np.sqrt(roll / mass) / (t_f + t_r)),
        "pitch_index": np.asarray(pitch / (mass * (a - x) * (b + x))),
    }
