"""The linear model: matrices, responses, exponentials and their sums, chi-squared against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import chdtrc, chdtri

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, Fact, FactQuantity, HubWeight
from identify.model.chi_squared import chance_of_more, exceeded_by_chance
from identify.model.exponentials import real_functions, series_of, spectrum, waves_of
from identify.model.matrices import (
    corner_load,
    delta_mass,
    derived_quantities,
    matrices,
    misfits_of,
    physical_model,
    predicted,
    whole_vehicle_indices,
)
from identify.model.response import Bump, exact_response, wilson_response


def test_a_complex_step_differentiates_the_matrices() -> None:
    theta = FORD_GRANADA.to_array().astype(complex)
    theta[11] += 1e-30j  # a
    _, _, K = matrices(theta)
    assert K[1, 1].imag / 1e-30 == pytest.approx(2 * 2 * 17e3 * 1.25)  # of 2 k_sf a^2
    assert K[1, 3].imag / 1e-30 == pytest.approx(17e3)


def test_a_weight_adds_the_inertia_of_its_place_from_the_cg() -> None:
    weight = BodyWeight(mass_kg=10.0, x_m=-0.25, y_m=0.5, height_m=0.2)
    dM = delta_mass(AddedMass((weight, HubWeight(3.0, Corner.REAR_LEFT))), a=1.25).real
    x, y = 1.0, 0.5  # from the CG, 1.25 m behind the front axle
    v_z, pitch_rate, roll_rate = 0.3, 0.7, -0.4
    rate = np.array([v_z, pitch_rate, roll_rate, 0, 0, 0.9, 0])
    energy = 0.5 * 10.0 * (v_z - x * pitch_rate + y * roll_rate) ** 2
    energy += 0.5 * 10.0 * 0.2**2 * (pitch_rate**2 + roll_rate**2) + 0.5 * 3.0 * 0.9**2
    assert 0.5 * rate @ dM @ rate == pytest.approx(energy)


# The exact response against an ordinary integrator, and Wilson-theta against its order -----------

MODEL = physical_model(FORD_GRANADA)
BUMP = Bump(height_m=0.04, start_s=0.1037, duration_s=0.1512)  # corners between samples


def integrated(wheels: list[int], until_s: float) -> NDArray[np.float64]:
    """Integrate Eq. 1 in three stretches, between which the road has its corners."""

    def rate(t: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = BUMP.start_s <= t <= BUMP.end_s
        z = 0.04 * np.sin(np.pi * (t - 0.1037) / 0.1512) if inside else 0.0
        force = np.zeros(7)
        force[wheels] = 192e3 * z
        x, v = state[:7], state[7:]
        acceleration = np.linalg.solve(MODEL.M, force - MODEL.K @ x - MODEL.C @ v)
        return np.concatenate([v, acceleration])

    state = np.zeros(14)
    for start, end in ((BUMP.start_s, BUMP.end_s), (BUMP.end_s, until_s)):
        state = solve_ivp(rate, (start, end), state, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    return np.concatenate([state, rate(until_s, state)[7:]])


@pytest.mark.parametrize(
    ("excitation", "wheels"),
    [
        (Excitation.BOUNCE, [3, 4, 5, 6]),
        (Excitation.PITCH, [3, 4]),
        (Excitation.ROLL, [3, 5]),
        (Excitation.WARP, [3, 6]),
        (Excitation.REAR_PITCH, [5, 6]),
    ],
)
def test_exact_response_is_that_of_an_integrator(excitation: Excitation, wheels: list[int]) -> None:
    response = exact_response(MODEL, excitation, BUMP, 50.0, 0.5)
    found = np.concatenate(
        [response.displacement[-1], response.velocity[-1], response.acceleration[-1]]
    )
    assert response.time_s[-1] == 0.5
    np.testing.assert_allclose(found, integrated(wheels, 0.5), rtol=1e-7, atol=1e-10)


def test_wilson_theta_converges_with_the_square_of_the_step() -> None:
    def error(rate_hz: float) -> float:
        exact = exact_response(MODEL, Excitation.PITCH, Bump(), rate_hz, 1.0)
        wilson = wilson_response(MODEL, Excitation.PITCH, Bump(), rate_hz, 1.0)
        return float(np.max(np.abs(wilson.displacement - exact.displacement)))

    assert error(500.0) / error(1000.0) == pytest.approx(4.0, rel=0.1)
    assert error(1000.0) < 1e-3


# What an engineer quotes of a vehicle, and what scales and tape show, by statics -----------------

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
# Of the body on each axle stand 720 and 480 kg: 1200 kg by 1.8 / 3 and 1.2 / 3.


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


# Exponentials and their sums against plain tables; chi-squared ------------------------------------


TIMES = np.array([0.0, 0.013, 0.2, 1.7])


def _systems() -> dict[str, NDArray[np.float64]]:
    vehicle = np.asarray(physical_model(FORD_GRANADA).A)
    overdamped = np.array([[0.0, 1.0], [-4.0, -5.0]])  # poles -1 and -4
    equal = np.array([[-1.0, 0.0], [0.0, -1.0 - 1e-12]])
    return {"vehicle": vehicle, "overdamped": overdamped, "equal": equal}


@pytest.mark.parametrize("name", ["vehicle", "overdamped", "equal"])
def test_free_decay_is_the_matrix_exponential(name: str) -> None:
    A = _systems()[name]
    n = len(A)
    modes = spectrum(A)
    rng = np.random.default_rng(1)
    row, x0 = rng.standard_normal(n), rng.standard_normal(n)
    modal = ((row @ modes.V) * (modes.W @ x0))[modes.half]
    on_functions = modes.on_real_functions(modal[:, None])[:, 0]
    expected = [row @ expm(A * t) @ x0 for t in TIMES]
    functions = real_functions(TIMES, modes.poles[modes.half])
    np.testing.assert_allclose(functions @ on_functions, expected, rtol=1e-9, atol=1e-11)


# Sums over samples without a table are the sums of the table, whatever the times -----------------

RATES = np.array([-1.7 + 6j, -18 + 67j, -3.0, -628 + 628j, 0])
EVEN_S = np.asarray(0.0008 + 0.002000012 * np.arange(1144), dtype=np.float64)
TIMES_EXPONENTIAL_SUMS = {
    "even": (EVEN_S, EVEN_S[:-1] + 1e-4),
    "a gap": (np.delete(EVEN_S, slice(300, 310)), EVEN_S),
    "few": (0.01 * np.arange(20), 0.01 * np.arange(20)),
    "one": (np.array([0.3]), np.array([0.3])),
}


@pytest.mark.parametrize("kind", TIMES_EXPONENTIAL_SUMS)
def test_sums_are_those_of_a_table(kind: str) -> None:
    late_s = 0.003
    rng = np.random.default_rng(3)
    samples = [rng.standard_normal((len(time), 2)) for time in TIMES_EXPONENTIAL_SUMS[kind]]
    seen = []
    for series in series_of(TIMES_EXPONENTIAL_SUMS[kind], samples):
        at = waves_of(series, RATES, late_s)
        mixed, plain = at.grams()
        sums = at.with_samples()
        for i, member in enumerate(series.members):
            time, values = TIMES_EXPONENTIAL_SUMS[kind][member] - late_s, samples[member]
            wave = np.exp(np.outer(time, RATES))
            table = np.hstack([wave, time[:, None] * wave])
            for found, expected in (
                (mixed[i], table.conj().T @ table),
                (plain[i], table.T @ table),
                (sums[i], values.T @ table),
                (series.power[i], np.sum(values**2, axis=0)),
            ):
                np.testing.assert_allclose(
                    found, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max()
                )
            seen.append(member)
    assert sorted(seen) == [0, 1]


# Against SciPy's, and against the printed tables -------------------------------------------------


@pytest.mark.parametrize("freedom", [1, 2, 7, 40, 301, 2000])
def test_like_scipy_from_one_degree_to_thousands(freedom: int) -> None:
    for chance in (0.05, 1e-3, 1e-6, 1e-12):
        value = exceeded_by_chance(freedom, chance)
        assert value == pytest.approx(chdtri(freedom, chance), rel=1e-12)
        assert chance_of_more(freedom, value) == pytest.approx(chance, rel=1e-9)
    for value in (0.1, 0.5 * freedom, 1.5 * freedom):
        assert chance_of_more(freedom, value) == pytest.approx(chdtrc(freedom, value), rel=1e-9)
    assert chance_of_more(freedom, 0.0) == 1.0
