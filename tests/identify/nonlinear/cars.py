"""Models of the truth's cars for the tests of the nonlinear room."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, MassState, Structure
from identify.decays.decay import ChannelGroup, Record
from identify.fit.grey_box import GreyBox
from identify.model.matrices import SYMMETRIC
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.path import InitialState

from .truth import ADDED, BASELINE

RICH = Structure(True, True, True, True)


def granada(structure: Structure = RICH) -> NDArray[np.float64]:
    """Return the 28 parameters of the paper's car, with bars where the structure has them."""
    full = np.asarray(SYMMETRIC @ FORD_GRANADA.to_array())
    if structure.anti_roll_bars:
        full[23:25] = (8e3, 5e3)
    return full


def model_of(
    records: Sequence[Record] = (),
    knots: str = "K3",
    structure: Structure = RICH,
    states: tuple[MassState, ...] = (BASELINE, ADDED),
) -> Model:
    """Return a model for the channels of some records."""
    groups: dict[ChannelGroup, None] = dict.fromkeys(
        r.group for record in records for r in record.recordings
    )
    return Model(GreyBox(tuple(groups), states, None, structure), KNOTS[knots])


def bent(model: Model, **unknowns: float) -> NDArray[np.float64]:
    """Return the Granada with elements; each in units of its unknown."""
    eta = model.unknowns(model.box.unknowns_of(granada(model.box.structure)))
    for name, value in unknowns.items():
        eta[model.names.index(name)] = value
    return eta


def rich(model: Model, mounted: bool) -> NDArray[np.float64]:
    """Return a car with everything there is."""
    mounts = {"s_mf": 1.0, "s_mr": 0.5} if mounted else {}
    return bent(
        model, F_cf=1.0, F_cr=1.0, r_cf=0.4, h_f1=-0.5, h_f2=0.8, h_f3=-0.6, h_r1=-0.4, h_r3=0.3,
        k_2f=0.4, k_3f=0.3, k_bf=0.5, g_bf=float(np.log(0.015)), p_bf=float(np.log(1.5)),
        dF_cf=0.2, s_cf=0.1, b_tf=0.4, c_tf=0.8, y_s=0.1, **mounts,
    )  # fmt: skip


def moving() -> InitialState:
    """Return a car in motion in every direction."""
    heave = [0.01, 0.002, 0.003, 0.03, 0.02, 0.01, -0.01]
    speed = [0.1, -0.05, 0.07, 0.3, -0.2, 0.1, 0.25]
    return InitialState(np.array([*heave, *speed]), np.array([0.3, -0.2, 0.1, 0.0]), np.zeros(4))
