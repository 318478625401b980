"""Sensor faults: the filter against its closed form, and every fault seen in the frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Campaign
from daq.bench.config import load_bench
from daq.runs import Excitation
from daq.sim.car import SensorFault, SimulatedCar, Spread
from daq.sim.ecu import campaign_frames
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
    campaign = Campaign((Excitation.ROLL,), 1, ("baseline",))
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
