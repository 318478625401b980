"""Campaigns of a small linear car of its own equations, for whatever a person may do to them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.channels import Channel, Quantity
from daq.vehicle import BodyWeight, Corner, HubWeight

Array = NDArray[np.float64]
Records = list[tuple[str, str, dict[str, tuple[Array, Array]]]]

RATE_HZ, REST_S, BUMP_S, LENGTH_S = 200.0, 0.5, 0.2, 2.5
LIFTED = {"bounce": (1, 1, 1, 1), "pitch": (1, 1, 0, 0), "roll": (1, 0, 1, 0)}
NOISE = {"az": 0.02, "wy": 0.002, "wx": 0.002, "hub": 0.1, "tr": 0.0003}
WEIGHTS: tuple[BodyWeight | HubWeight, ...] = (
    BodyWeight(25.0, 0.1, 0.45),
    BodyWeight(20.0, 0.1, -0.45),
    BodyWeight(30.0, -2.2, 0.4),
    BodyWeight(20.0, -2.2, -0.4),
    *(HubWeight(2.5, corner) for corner in Corner),
)
_X, _Y = np.array([1.05, 1.05, -1.40, -1.40]), np.array([0.66, -0.66, 0.655, -0.655])
_SPRING = np.array([17e3, 17e3, 16e3, 16e3])
_DAMPER = np.array([1100.0, 1100.0, 950.0, 950.0])
_TYRE = np.array([150e3, 150e3, 155e3, 155e3])
_MASS = np.diag([720.0, 850.0, 260.0, 28.0, 28.0, 25.0, 25.0])


def channels() -> tuple[Channel, ...]:
    """Return an IMU in the middle of the front axle, and hubs and travels at the corners."""
    hubs = [Channel(f"hub{c}", Quantity.HUB_ACCELERATION, corner=c) for c in Corner]
    travels = [Channel(f"tr{c}", Quantity.SUSPENSION_TRAVEL, corner=c) for c in Corner]
    return (
        Channel("az", Quantity.BODY_ACCELERATION, x_m=-1.0),
        Channel("wy", Quantity.PITCH_RATE),
        Channel("wx", Quantity.ROLL_RATE),
        *hubs,
        *travels,
    )


def campaign(
    kinds: Iterable[str] = ("bounce", "pitch", "roll"),
    states: Sequence[str] = ("baseline", "added"),
    noise: float = 1.0,
    seed: int = 1,
    weights: tuple[BodyWeight | HubWeight, ...] = WEIGHTS,
) -> Records:
    """Return a record of each kind of bump in each state; `noise` in units of `NOISE`."""
    rng = np.random.default_rng(seed)
    runs: Records = []
    for state in states:
        for kind in kinds:
            t_s, clean = _motion(weights if state == "added" else (), kind)
            noisy = {
                name: values + noise * NOISE[name[: 3 if name[0] == "h" else 2]]
                * rng.standard_normal(len(t_s))
                for name, values in clean.items()
            }  # fmt: skip
            runs.append((state, kind, {name: (t_s, values) for name, values in noisy.items()}))
    return runs


@cache
def _motion(
    weights: tuple[BodyWeight | HubWeight, ...], kind: str
) -> tuple[Array, dict[str, Array]]:
    """Return times and noise-free readings; travels show how far the weights sink the body."""
    force_of_travel = np.zeros((7, 4))  # travel = wheel - body, positive in compression
    for i in range(4):
        force_of_travel[:, i] = [1.0, -_X[i], _Y[i], *-np.eye(4)[i]]
    K = force_of_travel @ np.diag(_SPRING) @ force_of_travel.T
    C = force_of_travel @ np.diag(_DAMPER) @ force_of_travel.T
    K[3:, 3:] += np.diag(_TYRE)
    M, weight = _MASS.copy(), np.zeros(7)
    for w in weights:
        if isinstance(w, BodyWeight):
            row = np.array([1.0, -(w.x_m + 1.05), w.y_m, 0, 0, 0, 0])
            M += w.mass_kg * np.outer(row, row)
            weight += w.mass_kg * 9.80665 * row
        else:
            M[3 + w.corner.position, 3 + w.corner.position] += w.mass_kg
    road = np.concatenate([np.zeros(3), _TYRE * LIFTED[kind]])
    A = np.zeros((15, 15))  # the state, and the road's height as an input
    A[:7, 7:14] = np.eye(7)
    A[7:14, :7], A[7:14, 7:14] = -np.linalg.solve(M, K), -np.linalg.solve(M, C)
    A[7:14, 14] = np.linalg.solve(M, road)
    fine = 10
    step = expm(A / (fine * RATE_HZ))
    n = round(LENGTH_S * RATE_HZ)
    state_now, states = np.zeros(15), np.zeros((n, 15))
    for k in range(n * fine):
        t = (k + 0.5) / (fine * RATE_HZ) - REST_S
        if k % fine == 0:
            states[k // fine] = state_now
            height = 0.04 * np.sin(np.pi * (t - 0.5 / (fine * RATE_HZ)) / BUMP_S)
            states[k // fine, 14] = height * (0.0 <= t < BUMP_S)
        state_now[14] = 0.04 * np.sin(np.pi * t / BUMP_S) * (0.0 <= t < BUMP_S)
        state_now = step @ state_now
    rates, z, v = states @ A.T, states[:, :7], states[:, 7:14]
    accelerations = rates[:, 7:14]
    sunk = -np.linalg.solve(K, weight)
    travels = -(z + sunk) @ force_of_travel
    # The IMU is 1 m behind the front axle, 0.05 m before the centre of gravity.
    readings = {
        "az": accelerations[:, 0] - 0.05 * accelerations[:, 1],
        "wy": v[:, 1],
        "wx": v[:, 2],
    }
    readings |= {f"hub{c}": accelerations[:, 3 + c.position] for c in Corner}
    readings |= {f"tr{c}": travels[:, c.position] for c in Corner}
    return np.arange(n) / RATE_HZ, readings
