"""Simulated campaigns: noise as defined, sensors as mounted."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from dbc.errors import InputError
from identify.decays.decay import Record
from identify.model.matrices import physical_model
from identify.model.response import Bump, exact_response
from identify.study.campaign import SENSOR_SETS, Campaign, noise_levels, records_of

QUIET = np.inf


def _values(record: Record) -> dict[str, NDArray[np.float64]]:
    return {
        channel.name: column
        for recording in record.recordings
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True)
    }


def test_noise_lies_30_db_below_the_rms_over_the_three_records() -> None:
    noisy = records_of(Campaign(rate_hz=1000.0), 1)
    clean = records_of(Campaign(rate_hz=1000.0, noise_db=QUIET), 1)
    assert [r.label for r in noisy[:4]] == [
        "baseline_bounce_1",
        "baseline_pitch_1",
        "baseline_roll_1",
        "added_bounce_1",
    ]
    for state in (slice(0, 3), slice(3, 6)):
        signal = np.concatenate([r.recordings[0].values for r in clean[state]])
        noise = np.concatenate([r.recordings[0].values for r in noisy[state]]) - signal
        ratio = noise.std(axis=0) / np.sqrt(np.mean(signal**2, axis=0))
        np.testing.assert_allclose(20 * np.log10(ratio), -30.0, atol=0.3)


def test_noise_levels_are_those_of_the_records() -> None:
    campaign = Campaign(rate_hz=1000.0, groups=SENSOR_SETS["all"])
    clean = Campaign(rate_hz=1000.0, noise_db=QUIET, groups=SENSOR_SETS["all"])
    noisy = [_values(r) for r in records_of(campaign, 2)]
    quiet = [_values(r) for r in records_of(clean, 2)]
    for name, level in noise_levels(campaign).items():
        noise = np.concatenate([a[name] - b[name] for a, b in zip(noisy, quiet, strict=True)])
        assert noise.std() == pytest.approx(level, rel=0.03)


def test_one_more_run_leaves_the_noise_as_it_is() -> None:
    assert noise_levels(Campaign(cases=tuple(Excitation))) == noise_levels(Campaign())


def test_sensors_see_the_motion_of_their_places() -> None:
    campaign = Campaign(noise_db=QUIET, cases=(Excitation.WARP,), groups=SENSOR_SETS["all"])
    seen = _values(records_of(campaign, 0)[0])
    run = exact_response(
        physical_model(FORD_GRANADA), Excitation.WARP, Bump(), campaign.rate_hz, 3.0
    )
    z, theta, phi, a, b, c, d = run.displacement.T
    # The IMU is 1.05 m behind the front axle, the CG 1.25 m.
    np.testing.assert_allclose(seen["imu_z"], run.acceleration @ [1, -0.2, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(seen["pitch_rate"], run.velocity[:, 1])
    np.testing.assert_allclose(seen["roll_rate"], run.velocity[:, 2])
    np.testing.assert_allclose(seen["hub_RL"], run.acceleration[:, 5])
    corner = {
        "FL": (a, z - 1.25 * theta + 0.74 * phi),
        "FR": (b, z - 1.25 * theta - 0.74 * phi),
        "RL": (c, z + 1.51 * theta + 0.74 * phi),
        "RR": (d, z + 1.51 * theta - 0.74 * phi),
    }
    for name, (wheel, body) in corner.items():
        np.testing.assert_allclose(seen[f"travel_{name}"], wheel - body, atol=1e-12)


@pytest.mark.parametrize(
    ("rate_hz", "noise_db", "cases"),
    [
        (0.0, 30.0, (Excitation.ROLL,)),
        (np.nan, 30.0, (Excitation.ROLL,)),
        (1e6, 30.0, (Excitation.ROLL,)),
        (200.0, np.nan, (Excitation.ROLL,)),
        (200.0, -50.0, (Excitation.ROLL,)),
        (200.0, 30.0, ()),
        (200.0, 30.0, (Excitation.ROLL, Excitation.ROLL)),
    ],
)
def test_campaigns_that_make_no_sense(
    rate_hz: float, noise_db: float, cases: tuple[Excitation, ...]
) -> None:
    with pytest.raises(InputError):
        Campaign(rate_hz, noise_db, cases)
