"""Readings of scales and tape measure, and derived quantities, from the vehicle's parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import Corner, Fact, FactQuantity

from .matrices import COMPLEX_STEP, FRONT_WHEELS, FULL_NAMES, REAR_WHEELS, Full

CORNERS = {
    FactQuantity.CORNER_FL: Corner.FRONT_LEFT,
    FactQuantity.CORNER_FR: Corner.FRONT_RIGHT,
    FactQuantity.CORNER_RL: Corner.REAR_LEFT,
    FactQuantity.CORNER_RR: Corner.REAR_RIGHT,
}
SCALED = {FactQuantity.TOTAL_MASS, FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE, *CORNERS}
"""Quantities that scales show; one of them fixes the scale that free decays leave open."""


def predicted(
    fact: Fact, full: NDArray[np.complex128], cross_kg: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return the value of a fact, in its unit, that parameters (..., 28) predict.

    On four wheels a body is statically indeterminate: how much more the diagonal FL-RR carries than
    the other depends on the ground and on the spring seats, not on the parameters.  `cross_kg`,
    what the front left corner carries beyond its share, is a separate unknown.
    """
    a, b, t_f, t_r = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R))
    front, rear = full[..., FRONT_WHEELS].sum(axis=-1), full[..., REAR_WHEELS].sum(axis=-1)
    body = full[..., Full.M_S]
    direct = {
        FactQuantity.TOTAL_MASS: body + front + rear,
        FactQuantity.FRONT_AXLE: body * b / (a + b) + front,
        FactQuantity.REAR_AXLE: body * a / (a + b) + rear,
        FactQuantity.WHEELBASE: a + b,
        FactQuantity.FRONT_TRACK: 2.0 * t_f,
        FactQuantity.REAR_TRACK: 2.0 * t_r,
    }
    if fact.quantity in direct:
        return np.asarray(direct[FactQuantity(fact.quantity)])
    if fact.quantity in CORNERS:
        return corner_load(CORNERS[FactQuantity(fact.quantity)], full, cross_kg)
    # The fact is a parameter; one of a symmetric vehicle is that of both corners of its axle.
    places = [i for i, name in enumerate(FULL_NAMES) if fact.quantity in (name, name[:-1])]
    return np.asarray(full[..., places].mean(axis=-1))


def misfits_of(
    facts: Sequence[Fact], full: NDArray[np.complex128], cross_kg: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return measured less predicted value of each fact in sigmas, and the slopes of the latter.

    `full`, (1 + P, 28), and `cross_kg`, (1 + P,): at a point and one `COMPLEX_STEP` along each of P
    unknowns.  Returns (n_facts,) and (n_facts, P).
    """
    misfits, slopes = np.zeros(len(facts)), np.zeros((len(facts), len(full) - 1))
    for i, fact in enumerate(facts):
        value = predicted(fact, full, cross_kg)
        misfits[i] = (fact.value - value[0].real) / fact.sigma
        slopes[i] = value[1:].imag / COMPLEX_STEP / fact.sigma
    return misfits, slopes


def corner_load(
    corner: Corner, full: NDArray[np.complex128], cross_kg: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return what the scales show under one wheel, kg; arguments as in `predicted`."""
    a, b, t_f, t_r = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R))
    half_width, to_other_axle = (t_f, b) if corner.front else (t_r, a)
    axle = full[..., Full.M_S] * to_other_axle / (a + b)  # share of the body on this axle
    diagonal = corner.side * (1.0 if corner.front else -1.0)
    # The cross weights of both axles must have no roll moment: they are proportional to 1 / half
    # width.
    cross = diagonal * cross_kg * t_f / half_width
    offset = corner.side * axle * full[..., Full.Y_S] / (2.0 * half_width)
    return np.asarray(axle / 2.0 + offset + cross + full[..., Full.M_U + corner.position])


# Quantities that follow from the parameters and that engineers quote for a vehicle ----------------

Value = tuple[NDArray[np.complex128], str]
"""A quantity, (...), and its SI unit (1 for a ratio)."""


def derived_quantities(full: NDArray[np.complex128]) -> dict[str, Value]:
    """Return each derived quantity of a vehicle, (28,) or stacked, with its unit.

    Total mass and axle loads; wheelbase; radii of gyration of the sprung mass and its dynamic index
    k^2 / (a b); loads under the wheels on level ground without cross weight; damping ratio and
    natural frequency of each axle's body on its suspension (quarter car, tyre rigid) and of its
    wheel between both springs.
    """
    m_s, I_yy, I_xx = (full[..., i] for i in (Full.M_S, Full.I_YY, Full.I_XX))
    a, b = full[..., Full.A], full[..., Full.B]
    wheels = full[..., Full.M_U : Full.M_U + 4]
    result: dict[str, Value] = {
        "total_mass": (m_s + wheels.sum(axis=-1), "kg"),
        "front_axle_load": (m_s * b / (a + b) + full[..., FRONT_WHEELS].sum(axis=-1), "kg"),
        "rear_axle_load": (m_s * a / (a + b) + full[..., REAR_WHEELS].sum(axis=-1), "kg"),
        "wheelbase": (a + b, "m"),
        "pitch_radius_of_gyration": (np.sqrt(I_yy / m_s), "m"),
        "roll_radius_of_gyration": (np.sqrt(I_xx / m_s), "m"),
        "dynamic_index": (I_yy / (m_s * a * b), "1"),
    }
    for corner in Corner:
        load = corner_load(corner, full, np.zeros_like(m_s))
        result[f"corner_load_{corner.lower()}"] = (load, "kg")
    for axle, first, to_other_axle in (("front", 0, b), ("rear", 2, a)):
        m_u, k_s, k_t, c_s = (  # means of the axle's two corners, which begin at `first`
            full[..., kind + first : kind + first + 2].mean(axis=-1)
            for kind in (Full.M_U, Full.K_S, Full.K_T, Full.C_S)
        )
        body = m_s * to_other_axle / (a + b) / 2.0  # mass on one corner
        result[f"{axle}_ride_frequency"] = (np.sqrt(k_s / body) / (2.0 * np.pi), "Hz")
        result[f"{axle}_ride_damping_ratio"] = (c_s / (2.0 * np.sqrt(k_s * body)), "1")
        both_springs = k_s + k_t
        result[f"{axle}_wheel_hop_frequency"] = (np.sqrt(both_springs / m_u) / (2.0 * np.pi), "Hz")
        result[f"{axle}_wheel_hop_damping_ratio"] = (c_s / (2.0 * np.sqrt(both_springs * m_u)), "1")
    return result


def whole_vehicle_indices(full: NDArray[np.complex128]) -> dict[str, NDArray[np.complex128]]:
    """Return two ratios in which vehicles of all sizes are alike, wheels included.

    `roll_gyration_over_track`: radius of gyration in roll over the mean track.  `pitch_index`:
    k_y^2 / (a b) about the centre of gravity of the whole.
    """
    m_s, I_yy, I_xx = (full[..., i] for i in (Full.M_S, Full.I_YY, Full.I_XX))
    a, b, t_f, t_r = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R))
    front, rear = full[..., FRONT_WHEELS].sum(axis=-1), full[..., REAR_WHEELS].sum(axis=-1)
    mass = m_s + front + rear
    x = (front * a - rear * b) / mass  # centre of the whole, forward of that of the body
    pitch = I_yy + m_s * x**2 + front * (a - x) ** 2 + rear * (b + x) ** 2
    roll = I_xx + front * t_f**2 + rear * t_r**2
    return {
        "roll_gyration_over_track": np.asarray(np.sqrt(roll / mass) / (t_f + t_r)),
        "pitch_index": np.asarray(pitch / (mass * (a - x) * (b + x))),
    }
