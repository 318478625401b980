"""What an engineer quotes of a vehicle, and what scales and tape show, by statics."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import Corner, Fact, FactQuantity
from identify.model.derived import derived_quantities, whole_vehicle_indices
from identify.model.facts import corner_load, misfits_of, predicted

FULL = np.array(
    [
        1200.0, 1800.0, 500.0,  # body: mass, pitch and roll inertia
        30.0, 34.0, 40.0, 44.0,  # wheels
        16e3, 20e3, 21e3, 25e3,  # springs
        180e3, 200e3, 170e3, 190e3,  # tyres
        1300.0, 1500.0, 1600.0, 2000.0,  # dampers
        1.2, 1.8, 0.7, 0.8,  # a, b, t_f, t_r
        9e3, 6e3, 100.0, 200.0,  # bars, tyre damping
        0.05,  # the CG stands 50 mm to the left
    ],
    dtype=complex,
)  # fmt: skip
FRONT_BODY, REAR_BODY = 720.0, 480.0
"""Of the body on each axle: 1200 kg by 1.8 / 3 and 1.2 / 3."""


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("total_mass", 1348.0, "kg"),
        ("front_axle_load", 784.0, "kg"),
        ("rear_axle_load", 564.0, "kg"),
        ("wheelbase", 3.0, "m"),
        ("pitch_radius_of_gyration", np.sqrt(1.5), "m"),
        ("roll_radius_of_gyration", np.sqrt(500.0 / 1200.0), "m"),
        ("dynamic_index", 1800.0 / (1200.0 * 1.2 * 1.8), "1"),
        ("corner_load_fl", 360.0 + 720.0 * 0.05 / 1.4 + 30.0, "kg"),
        ("corner_load_fr", 360.0 - 720.0 * 0.05 / 1.4 + 34.0, "kg"),
        ("corner_load_rl", 240.0 + 480.0 * 0.05 / 1.6 + 40.0, "kg"),
        ("corner_load_rr", 240.0 - 480.0 * 0.05 / 1.6 + 44.0, "kg"),
        ("front_ride_frequency", np.sqrt(18e3 / 360.0) / (2.0 * np.pi), "Hz"),
        ("rear_ride_frequency", np.sqrt(23e3 / 240.0) / (2.0 * np.pi), "Hz"),
        ("front_ride_damping_ratio", 1400.0 / (2.0 * np.sqrt(18e3 * 360.0)), "1"),
        ("rear_ride_damping_ratio", 1800.0 / (2.0 * np.sqrt(23e3 * 240.0)), "1"),
        ("front_wheel_hop_frequency", np.sqrt(208e3 / 32.0) / (2.0 * np.pi), "Hz"),
        ("rear_wheel_hop_frequency", np.sqrt(203e3 / 42.0) / (2.0 * np.pi), "Hz"),
        ("front_wheel_hop_damping_ratio", 1400.0 / (2.0 * np.sqrt(208e3 * 32.0)), "1"),
        ("rear_wheel_hop_damping_ratio", 1800.0 / (2.0 * np.sqrt(203e3 * 42.0)), "1"),
    ],
)
def test_a_quarter_car_and_the_loads_under_its_wheels(name: str, value: float, unit: str) -> None:
    quantities = derived_quantities(FULL)
    assert len(quantities) == 19
    found, its_unit = quantities[name]
    assert float(found.real) == pytest.approx(value, rel=1e-12)
    assert its_unit == unit


def test_ratios_of_the_whole_vehicle_are_about_its_own_centre() -> None:
    """64 kg stand in front and 84 kg behind, each at its wheels."""
    found = whole_vehicle_indices(FULL)
    x = (64.0 * 1.2 - 84.0 * 1.8) / 1348.0
    pitch = 1800.0 + 1200.0 * x**2 + 64.0 * (1.2 - x) ** 2 + 84.0 * (1.8 + x) ** 2
    roll = 500.0 + 64.0 * 0.7**2 + 84.0 * 0.8**2
    assert found["pitch_index"].real == pytest.approx(pitch / (1348.0 * (1.2 - x) * (1.8 + x)))
    assert found["roll_gyration_over_track"].real == pytest.approx(np.sqrt(roll / 1348.0) / 1.5)


@pytest.mark.parametrize(
    ("quantity", "value"),
    [
        (FactQuantity.TOTAL_MASS, 1348.0),
        (FactQuantity.FRONT_AXLE, 784.0),
        (FactQuantity.REAR_AXLE, 564.0),
        (FactQuantity.WHEELBASE, 3.0),
        (FactQuantity.FRONT_TRACK, 1.4),
        (FactQuantity.REAR_TRACK, 1.6),
        ("m_s", 1200.0),
        ("k_sf", 18e3),  # of a symmetric vehicle: the mean of both sides
        ("k_sfl", 16e3),
        ("c_sr", 1800.0),
        ("y_s", 0.05),
        ("b", 1.8),
    ],
)
def test_what_scales_tape_and_a_test_bench_show(quantity: str, value: float) -> None:
    found = predicted(Fact(quantity, 0.0, 1.0), FULL, np.array(7.0 + 0j))
    assert float(found.real) == pytest.approx(value)


def test_a_cross_weight_turns_the_body_neither_over_nor_sideways() -> None:
    """10 kg more on the diagonal FL-RR; the rear axle is wider, so less there."""
    cross = np.array(10.0 + 0j)
    level = np.array(0j)
    more = {
        c: float(np.real(corner_load(c, FULL, cross))) - float(np.real(corner_load(c, FULL, level)))
        for c in Corner
    }
    assert more[Corner.FRONT_LEFT] == pytest.approx(10.0)
    assert more[Corner.FRONT_RIGHT] == pytest.approx(-10.0)
    assert more[Corner.REAR_LEFT] == pytest.approx(-10.0 * 0.7 / 0.8)
    assert more[Corner.REAR_RIGHT] == pytest.approx(10.0 * 0.7 / 0.8)
    shown = predicted(Fact(FactQuantity.CORNER_RR, 0.0, 1.0), FULL, cross)
    assert float(shown.real) == pytest.approx(240.0 - 15.0 + 44.0 + 8.75)


def test_misfits_count_in_sigmas_with_their_slopes() -> None:
    """A wheelbase of 3.0 m, read as 3.02 +- 0.005; it grows by a and b, one for one."""
    step = 1e-30
    points: NDArray[np.complex128] = np.repeat(FULL[None], 3, axis=0)
    points[1, 19] += 1j * step
    points[2, 0] += 1j * step
    facts = (Fact(FactQuantity.WHEELBASE, 3.02, 0.005), Fact(FactQuantity.TOTAL_MASS, 1347.0, 2.0))
    misfits, slopes = misfits_of(facts, points, np.zeros(3, complex))
    assert misfits == pytest.approx([4.0, -0.5])
    scale = slopes[0, 0] / 200.0  # of the complex step of the product
    assert slopes / scale == pytest.approx(np.array([[200.0, 0.0], [0.0, 0.5]]))
