"""The stress list is what it says: each campaign differs from the control by one thing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import ADDED, BASELINE, Excitation, Run
from daq.sim.car import NOISE, Spread
from daq.sim.masses import GRAVITY_M_S2
from daq.vehicle import FORD_GRANADA, Structure, Vehicle, parameter_names
from identify.model.matrices import delta_mass, physical_model
from identify.model.response import Bump, exact_response

from ..stress import (
    BODY,
    BUMP_S,
    HUBS,
    ODD_RUN,
    REST_S,
    SECOND_BUMP_S,
    STRESSES,
    TRAVELS,
    Key,
    samples,
    stress_channels,
    stress_session,
    true_value,
)

Array = NDArray[np.float64]
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
BOUNCE: Key = (BASELINE, Excitation.BOUNCE, 1)
ROLL: Key = (BASELINE, Excitation.ROLL, 1)


CHANNELS = {channel.name: channel for channel in stress_channels(travels=True)}


def silent(name: str, run: Key, channel: str, rate_hz: float = 200.0) -> tuple[Array, Array]:
    """Time since the beginning of the bump, and the values without noise."""
    rng = np.random.default_rng(0)
    t_s, found = samples(STRESSES[name], CHANNELS[channel], run, rate_hz, SILENT, rng)
    return t_s - REST_S, found


def column(run: Run, channel: str) -> Array:
    (group,) = [group for group in run.groups if channel in group.values]
    return group.values[channel]


def values(name: str, run: Key, channel: str) -> Array:
    return silent(name, run, channel)[1]


def decay(name: str, run: Key, channel: str, start_s: float = BUMP_S) -> Array:
    t_s, found = silent(name, run, channel)
    return np.asarray(found[t_s > start_s] - found[0])


def rms(signal: Array) -> float:
    return float(np.sqrt(np.mean(signal**2)))


def changed(name: str) -> set[tuple[Key, str]]:
    """Which runs and channels of the baseline are not those of the control."""
    return {
        ((BASELINE, excitation, repeat), channel)
        for excitation in STRESSES[name].excitations
        for repeat in (1, 2)
        for channel in BODY + HUBS
        if not np.array_equal(
            values(name, (BASELINE, excitation, repeat), channel),
            values("linear", (BASELINE, excitation, repeat), channel),
        )
    }


@pytest.mark.parametrize("name", ["linear", "unit", "early", "no_roll"])
def test_a_session_has_the_campaign(name: str) -> None:
    session = stress_session(name, 1, 500.0, travels=True, extra=(Excitation.WARP,))
    kinds = 4 - (name == "no_roll")
    assert len(session.runs) == 2 * kinds * 2
    assert session.mass_states[1].name == ADDED
    assert sum(weight.mass_kg for weight in session.mass_states[1].added.weights) == 148.0
    for run in session.runs:
        assert {n for group in run.groups for n in group.values} == {*BODY, *HUBS, *TRAVELS}
        assert len(run.groups) == 5
        assert len(run.groups[0].time_s) == 2000
        assert run.bump_s == pytest.approx(BUMP_S - 0.005 * (name == "early"))


@pytest.mark.parametrize("state", [BASELINE, ADDED])
def test_the_control_is_the_linear_model(state: str) -> None:
    """Forces integrated here, matrices and an exact discretisation there."""
    added = stress_session("linear", 0).mass_states[state == ADDED].added
    model = physical_model(FORD_GRANADA).with_mass(delta_mass(added, FORD_GRANADA.a).real)
    for excitation in (Excitation.BOUNCE, Excitation.ROLL):
        t_s, found = silent("linear", (state, excitation, 1), "body_acc_z")
        bump = Bump(0.05, REST_S, BUMP_S)
        exact = exact_response(model, excitation, bump, 200.0, 3.995).acceleration
        # The IMU sits 0.2 m ahead of the CG and 0.12 m to the left.
        expected = exact[:, 0] - 0.2 * exact[:, 1] + 0.12 * exact[:, 2] + GRAVITY_M_S2
        np.testing.assert_allclose(found, expected[: len(t_s)], atol=1e-6)


def test_noise_is_white_and_drawn_anew_for_each_run() -> None:
    noisy = [stress_session("linear", seed, 500.0, travels=True) for seed in (3, 4)]
    for channel in stress_channels(travels=True):
        noise = [
            column(run, channel.name)
            - silent("linear", (run.mass_state, run.excitation, run.repeat), channel.name, 500.0)[1]
            for session in noisy
            for run in session.runs
        ]
        assert np.std(noise) == pytest.approx(NOISE.of(channel.quantity), rel=0.03)
        correlation = np.corrcoef(np.vstack([noise[0][1:], noise[0][:-1], noise[1][1:]]))
        assert np.abs(correlation - np.eye(3)).max() < 0.1


def test_sensor_faults_touch_their_channels_only() -> None:
    for name, spoilt in (
        ("hubs_late_1ms", HUBS),
        ("hubs_late_5ms", HUBS),
        ("body_low_pass", BODY),
        ("low_pass", BODY + HUBS),
        ("offset", ("body_acc_z",)),
        ("gain", ("hub_acc_fl",)),
        ("polarity", ("hub_acc_rr",)),
        ("unit", ("hub_acc_fr",)),
    ):
        assert {channel for _, channel in changed(name)} == set(spoilt), name
    assert changed("early") == changed("early_20ms") == changed("no_roll") == set()


def test_faults_of_gain_and_offset_are_exact() -> None:
    g = GRAVITY_M_S2
    for name, channel, factor, offset in (
        ("offset", "body_acc_z", 1.0, 0.05),
        ("gain", "hub_acc_fl", 1.02, 0.0),
        ("polarity", "hub_acc_rr", -1.0, 0.0),
        ("unit", "hub_acc_fr", 1 / g, 0.0),
    ):
        sound, found = values("linear", BOUNCE, channel), values(name, BOUNCE, channel)
        np.testing.assert_allclose(found, factor * sound + offset, rtol=1e-12)
    cut, sound = values("saturation", BOUNCE, "hub_acc_fl"), values("linear", BOUNCE, "hub_acc_fl")
    np.testing.assert_array_equal(cut, np.clip(sound, -2 * g, 2 * g))
    assert sound.max() > 2.5 * g


@pytest.mark.parametrize(("name", "rate_hz"), [("hubs_late_1ms", 1000.0), ("hubs_late_5ms", 200.0)])
def test_late_channels_are_one_sample_late_at_this_rate(name: str, rate_hz: float) -> None:
    _, sound = silent("linear", ROLL, "hub_acc_rl", rate_hz)
    _, late = silent(name, ROLL, "hub_acc_rl", rate_hz)
    np.testing.assert_allclose(late[1:], sound[:-1], atol=1e-6)


def test_a_low_pass_delays_slow_motion_by_its_group_delay() -> None:
    t_s, slow = silent("body_low_pass", ROLL, "pitch_rate")
    _, sound = silent("linear", ROLL, "pitch_rate")
    quiet = t_s > 0.5  # the wheels are still: 1.3 Hz is left, far below 20 Hz
    delay_s = np.sqrt(2) / (2 * np.pi * 20.0)
    expected = np.interp(t_s[quiet] - delay_s, t_s, sound)
    assert rms(slow[quiet] - expected) < 0.01 * rms(expected)
    assert rms(slow[quiet] - sound[quiet]) > 0.05 * rms(expected)


def test_one_run_is_odd() -> None:
    for name in ("second_bump", "hot_damper"):
        assert {run for run, _ in changed(name)} == {ODD_RUN}
    shift = round(SECOND_BUMP_S * 200)
    sound = values("linear", ODD_RUN, "hub_acc_fl")
    extra = values("second_bump", ODD_RUN, "hub_acc_fl") - sound
    np.testing.assert_allclose(extra[:shift], 0.0, atol=1e-9)
    np.testing.assert_allclose(extra[shift:], 0.4 * (sound[:-shift] - sound[0]), atol=1e-6)
    hot, cool = (decay(name, ODD_RUN, "body_acc_z", 0.5) for name in ("hot_damper", "linear"))
    assert rms(hot) > 1.05 * rms(cool)


def test_friction_stops_the_car_early() -> None:
    ratio = [
        rms(decay("friction", BOUNCE, "pitch_rate", start)[:60])
        / rms(decay("linear", BOUNCE, "pitch_rate", start)[:60])
        for start in (BUMP_S, 1.0)
    ]
    assert 0.5 < ratio[0] < 0.98
    assert ratio[1] < 0.5 * ratio[0]  # the less it moves, the more friction counts


def test_a_strong_rebound_pulls_the_body_down() -> None:
    for name, least_m in (("damper", 0.002), ("damper_mild", 0.0005)):
        jacked = values(name, BOUNCE, "travel_rl")[200:400].mean()
        assert jacked - values("linear", BOUNCE, "travel_rl")[200:400].mean() > least_m


def test_bars_work_in_roll_only() -> None:
    for channel in BODY + HUBS:
        np.testing.assert_allclose(
            values("bars", BOUNCE, channel), values("linear", BOUNCE, channel), atol=1e-6
        )
    stiff, soft = (decay(name, ROLL, "roll_rate") for name in ("bars", "linear"))
    # The first reversal of the roll comes earlier.
    assert np.argmax(np.diff(np.sign(stiff)) != 0) < np.argmax(np.diff(np.sign(soft)) != 0)


def test_tyre_damping_calms_the_wheels() -> None:
    for hub in HUBS:
        damped, plain = (decay(name, BOUNCE, hub)[:40] for name in ("tyre_damping", "linear"))
        assert 0.7 < rms(damped) / rms(plain) < 0.98


def test_unlike_sides_roll_in_bounce() -> None:
    assert rms(values("linear", BOUNCE, "roll_rate")) < 1e-9
    for name in ("sides", "cg_offset"):
        assert np.abs(values(name, BOUNCE, "roll_rate")).max() > 5 * NOISE.rate_rad_s


def test_a_wheel_in_the_air_breaks_proportion() -> None:
    for name, height_m, start_s, least in (
        ("lift_off", 0.09, 0.17, 0.05),
        ("lift_off_high", 0.13, 0.2, 0.5),
    ):
        scaled = height_m / 0.05 * decay("linear", BOUNCE, "hub_acc_rl", start_s)
        assert np.abs(decay(name, BOUNCE, "hub_acc_rl", start_s) - scaled).max() > least


def test_truth_by_structure() -> None:
    full = Structure(symmetric=False, anti_roll_bars=True, tyre_damping=True, cg_offset=True)
    for name in STRESSES:
        for parameter in parameter_names(full):
            assert true_value(name, parameter) >= 0.0
    for parameter in parameter_names(Structure()):
        plain = getattr(FORD_GRANADA, parameter)
        assert true_value("linear", parameter) == plain
        assert true_value("sides", parameter) == pytest.approx(plain)
        assert true_value("damper", parameter) == pytest.approx(plain)
    assert true_value("sides", "c_sfl") == pytest.approx(1650.0)
    assert true_value("sides", "c_srr") == pytest.approx(1350.0)
    assert true_value("bars", "k_af") == 10e3
    assert true_value("bars", "k_ar") == 5e3
    assert true_value("tyre_damping", "c_tr") == 150.0
    assert true_value("cg_offset", "y_s") == 0.03


def test_the_vehicle_that_is_stated_is_handed_on() -> None:
    stated = Vehicle("prototype", structure=Structure(tyre_damping=True))
    assert stress_session("tyre_damping", 1, vehicle=stated).vehicle is stated
