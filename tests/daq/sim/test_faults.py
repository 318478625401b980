"""Sensor faults: the filter against its closed form, and every fault seen in the frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Campaign
from daq.bench.config import load_bench
from daq.errors import InputError
from daq.runs import Excitation
from daq.sim.car import SensorFault, SimulatedCar, Spread, truth
from daq.sim.ecu import campaign_frames
from daq.sim.elements import Imperfections
from daq.sim.plant import GRAVITY_M_S2
from daq.sim.sensors import low_pass
from dbc import Codec, parse_codec, shipped_dbc

STEP_S = 1e-4
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
QUIET = SimulatedCar(noise=SILENT, bias=SILENT, jitter_s=0.0, lead_s=0.6, tail_s=1.0)
HUB = "HUB_Front.acc_fl"


def test_a_ramp_leaves_the_low_pass_as_the_closed_form_says() -> None:
    """Second-order Butterworth, from rest: a ramp trails by sqrt(2) / omega once it has settled."""
    t = np.arange(-0.05, 0.3, STEP_S)
    ramp = 3.0 + np.maximum(t, 0.0)
    omega = 2 * np.pi * 20.0
    found = low_pass(ramp, STEP_S, 20.0, 2)
    s = omega / np.sqrt(2)  # poles at s (-1 +- j)
    tau = t[t > 0]
    trail = (np.sqrt(2) / omega) * (1.0 - np.exp(-s * tau) * np.cos(s * tau))
    np.testing.assert_allclose(found[t > 0], 3.0 + tau - trail, atol=1e-6)
    np.testing.assert_array_equal(found[t < -STEP_S], 3.0)


@pytest.fixture(scope="module")
def codec() -> Codec:
    return parse_codec(shipped_dbc(), "shipped")


def frames(codec: Codec, car: SimulatedCar, signal: str) -> NDArray[np.float64]:
    shipped = load_bench(None)
    exact = tuple(replace(channel, gain_sigma=0.0) for channel in shipped.channels)
    campaign = Campaign((Excitation.ROLL,), 1, ("baseline",), bump_height_m=0.05)
    bench = replace(shipped, channels=exact, campaign=campaign)
    (batch,) = campaign_frames(bench, codec, car, 3, 1_700_000_000_000_000_000)
    return codec.decode(batch)[signal].value


def faulty(codec: Codec, fault: SensorFault, signal: str = HUB) -> NDArray[np.float64]:
    return frames(codec, replace(QUIET, faults=(fault,)), signal)


@pytest.fixture(scope="module")
def sound(codec: Codec) -> NDArray[np.float64]:
    return frames(codec, QUIET, HUB)


def test_gain_polarity_offset_and_saturation(codec: Codec, sound: NDArray[np.float64]) -> None:
    resolution = 0.5005 * 0.001  # g
    for fault, expected in (
        (SensorFault("hub_acc_fl", gain=1.02), 1.02 * sound),
        (SensorFault("hub_acc_fl", gain=-1.0), -sound),
        (SensorFault("hub_acc_fl", offset=0.5), sound + 0.5 / GRAVITY_M_S2),
        (SensorFault("hub_acc_fl", limit=1.5 * GRAVITY_M_S2), np.clip(sound, -1.5, 1.5)),
    ):
        np.testing.assert_allclose(faulty(codec, fault), expected, atol=3 * resolution)
    assert sound.max() > 1.6  # the saturation had something to cut


def test_a_late_channel_is_late_and_the_others_are_not(
    codec: Codec, sound: NDArray[np.float64]
) -> None:
    late = SensorFault("hub_acc_fl", late_s=0.005)
    found = faulty(codec, late)
    np.testing.assert_allclose(found[5:], sound[:-5], atol=0.002)
    assert np.abs(found - sound).max() > 0.1
    other = "HUB_Front.acc_fr"
    np.testing.assert_array_equal(faulty(codec, late, other), frames(codec, QUIET, other))


def test_a_low_passed_channel_is_the_filter_of_the_sound_one(
    codec: Codec, sound: NDArray[np.float64]
) -> None:
    found = faulty(codec, SensorFault("hub_acc_fl", low_pass_hz=20.0))
    # Frames come every millisecond: filtering them is a coarser way to the same.
    np.testing.assert_allclose(found, low_pass(sound, 0.001, 20.0, 2), atol=0.004)
    assert np.abs(found - sound).max() > 0.3


@pytest.mark.parametrize(("order", "tail"), [(2, 1.0 / 17), (4, 1.0 / 257)])
def test_a_sine_is_damped_by_3_db_at_the_cut_off(order: int, tail: float) -> None:
    """Squared gain 1 / (1 + (f / f_c)^(2 n))."""
    t = np.arange(0.0, 2.0, STEP_S)
    for frequency_hz, power in ((20.0, 0.5), (40.0, tail)):
        late = low_pass(np.sin(2 * np.pi * frequency_hz * t), STEP_S, 20.0, order)[-10000:]
        assert 2 * np.mean(late**2) == pytest.approx(power, rel=1e-3)


def test_a_low_pass_that_the_bench_states_is_there() -> None:
    bench = load_bench(None)
    filtered = tuple(replace(c, low_pass_hz=40.0, low_pass_order=4) for c in bench.channels)
    stated = replace(bench, channels=filtered)
    assert truth(stated, QUIET, 1).sensors["pitch_rate"].low_pass_hz == 40.0
    car = replace(QUIET, faults=(SensorFault("pitch_rate", low_pass_hz=25.0),))
    spoilt = truth(stated, car, 1).sensors["pitch_rate"]
    assert (spoilt.low_pass_hz, spoilt.low_pass_order) == (25.0, 2)
    assert truth(stated, car, 1).sensors["roll_rate"].low_pass_order == 4


def test_faults_leave_every_draw_as_it_was() -> None:
    bench = load_bench(None)
    car = SimulatedCar(faults=(SensorFault("hub_acc_fr", late_s=0.001, offset=0.3),))
    plain, spoilt = truth(bench, SimulatedCar(), 5), truth(bench, car, 5)
    before, after = plain.sensors["hub_acc_fr"], spoilt.sensors["hub_acc_fr"]
    assert after.delay_s == pytest.approx(before.delay_s + 0.001)
    assert after.bias == pytest.approx(before.bias + 0.3)
    assert plain.sensors["travel_rr"] == spoilt.sensors["travel_rr"]
    assert plain.clocks == spoilt.clocks


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ((SensorFault("hub"),), "no channel 'hub' for this fault"),
        ((SensorFault("pitch_rate"), SensorFault("pitch_rate")), "pitch_rate has two faults"),
    ],
)
def test_a_fault_that_fits_no_channel_is_refused(
    faults: tuple[SensorFault, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        truth(load_bench(None), SimulatedCar(faults=faults), 1)


def test_an_imperfect_car_on_the_bus(codec: Codec) -> None:
    bench_of = replace(QUIET, imperfections=Imperfections(cg_offset_m=0.05))
    plain = frames(codec, QUIET, "IMU_Accel.acc_z")
    offset = frames(codec, bench_of, "IMU_Accel.acc_z")
    assert np.abs(plain - offset).max() > 0.05
    # Zeroed unloaded, an imperfect car still reads zero travel at rest.
    travel = frames(codec, bench_of, "SUSP_Front.travel_fl")
    assert np.abs(travel[:100]).max() < 0.02
