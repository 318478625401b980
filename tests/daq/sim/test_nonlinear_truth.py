"""What a simulated car has beyond its linear parameters, in the identification's names."""

from __future__ import annotations

import numpy as np
import pytest

from daq.sim import SimulatedCar, named_car, true_elements
from daq.sim.imperfections import Friction, Imperfections


def test_the_paper_car_has_none() -> None:
    assert true_elements(named_car("granada").simulated()).groups == ()


def test_a_rough_car_has_friction_bars_and_bent_curves() -> None:
    found = true_elements(named_car("granada-worn").simulated())
    assert set(found.groups) == {
        "anti_roll_bars", "friction", "one_sided_dampers", "damper_knees", "dampers_left_right",
    }  # fmt: skip
    assert found.values["F_cf"] == 50.0
    assert found.values["d_cr"] == 0.5e-3
    # The rear left damper at half: 0.25 below a mean of 0.75.
    assert found.values["s_cr"] == pytest.approx(-1.0 / 3.0)
    assert found.values["s_cf"] == 0.0
    speed, force = found.curves[0]
    assert (speed[0], speed[-1]) == (-1.0, 1.0)  # faster than any damper of these campaigns
    assert np.diff(speed) == pytest.approx(0.005)
    rise = np.interp([-0.1, 0.1], speed, force)
    assert (rise[1] - rise[0]) / 0.2 == pytest.approx(1500.0, rel=1e-3)
    assert -np.interp(-0.5, speed, force) > 1.5 * np.interp(0.5, speed, force)


def test_every_element_has_its_name_and_size() -> None:
    imperfections = Imperfections(
        friction=Friction(40.0, 30.0, 0.4e-3, static_ratio=1.3, sides=(1.2, 0.8, 1.0, 1.0)),
        mount_n_m=(1e6, np.inf),
        quadratic_n_m2=(2e4, 0.0),
        cubic_n_m3=(0.0, 3e5),
        stop_gap_m=(0.03, np.inf),
        stop_n_m=(5e4, 0.0),
        tyre_progression_per_m=(2.0, 1.0),
        tyre_damping_front_ns_m=100.0,
        cg_offset_m=0.02,
    )
    found = true_elements(SimulatedCar(imperfections=imperfections))
    assert set(found.groups) == {
        "friction", "damper_mounts", "progressive_springs", "bump_stops", "progressive_tyres",
        "friction_left_right", "static_friction", "tyre_damping", "cg_offset",
    }  # fmt: skip
    assert found.values == pytest.approx({
        "F_cf": 40.0, "F_cr": 30.0, "d_cf": 0.4e-3, "d_cr": 0.4e-3, "v_cf": 0.01,
        "v_cr": 0.01, "r_cf": 0.3, "r_cr": 0.3, "s_mf": 1e-6, "s_mr": 0.0,
        "k_2f": 2e4, "k_2r": 0.0, "k_3f": 0.0, "k_3r": 3e5, "k_bf": 5e4, "k_br": 0.0, "g_bf": 0.03,
        "b_tf": 2.0, "b_tr": 1.0, "dF_cf": 8.0, "dF_cr": 0.0, "s_cf": 0.0, "s_cr": 0.0,
    })  # fmt: skip
