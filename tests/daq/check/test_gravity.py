"""Unit, axis and sign of accelerometers by gravity, on samples made by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from daq.bench.bench_tables import SampleSet
from daq.channels import Quantity
from dbc.finding import Severity
from dbc.samples import Quality, Samples

from .at_rest import FAIL, OK, WARN, G, channel, checked, faults, still


@pytest.mark.parametrize(
    ("share", "verdict", "says"),
    [
        (1.059, OK, "+1 g"),
        (0.941, OK, "+1 g"),
        (-1.059, FAIL, "upside down"),
        (-0.941, FAIL, "upside down"),
        (1.061, WARN, "m/s2 at rest, or its scale"),  # no tilt makes it read more
        (0.939, WARN, "tilted by 20 degrees"),
        (-0.939, WARN, "tilted by 20 degrees"),
        (0.701, WARN, "tilted by 45 degrees"),
        (0.699, FAIL, "tilted by 46 degrees"),
        (1.299, WARN, "or its scale"),
        (1.301, FAIL, "or its scale"),
        (0.061, FAIL, "tilted by 87 degrees"),
        (0.059, OK, "no gravity"),
        (0.0, OK, "no gravity"),
    ],
)
@pytest.mark.parametrize("quantity", [Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION])
def test_an_accelerometer_that_points_up_reads_gravity(
    share: float, verdict: Severity, says: str, quantity: Quantity
) -> None:
    (line,) = faults(checked(channel(quantity), still(share * G, 0.01)))
    assert line.severity is verdict
    assert says in line.text
    assert ("tilted" in line.text) is ("tilted" in says)


@pytest.mark.parametrize(
    ("share", "setting"),
    [
        (1.07 / G, 'state signal_unit = "g"'),
        (0.93 / G, 'state signal_unit = "g"'),
        (-1.07 / G, 'state signal_unit = "g" and set sign = -1'),
        (1.09 / G, ""),
        (0.91 / G, ""),
        (1.07 * G, 'state signal_unit = "m/s2"'),
        (1e-3, "state gain = 1000"),
        (1e3, "state gain = 0.001"),
        (1e-3 / G, "state gain = 9806.65"),
        (1e-3 * G, "state gain = 101.972"),
        (1e3 / G, "state gain = 0.00980665"),
        (-1e3 * G, 'state signal_unit = "mm/s2" and set sign = -1'),
        (30.0, ""),
    ],
)
def test_gravity_in_a_wrong_unit_shows_which_it_is(share: float, setting: str) -> None:
    quiet = min(1e-4, abs(share) * 1e-2)
    (line,) = faults(checked(channel(Quantity.BODY_ACCELERATION), still(share * G, quiet)))
    assert line.severity is FAIL
    assert (line.advice if "gravity" in line.text else "") == setting


def test_the_gain_to_state_counts_the_one_that_is() -> None:
    (line,) = faults(checked(channel(Quantity.BODY_ACCELERATION, gain=2.0), still(G / 2000, 1e-6)))
    assert line.advice == "state gain = 2000"


@pytest.mark.parametrize(
    ("noise", "n", "is_scaled"),
    [
        (1.9e-3, 320, True),
        (2.1e-3, 320, False),  # as quiet as no sensor is: else it is AC-coupled
        (1.9e-3, 100, True),  # five errors of the mean: 0.95e-3 m/s2 of 1e-3
        (1.9e-3, 80, False),  # and 1.06e-3
    ],
)
def test_a_reading_near_nothing_is_gravity_only_of_a_quiet_sensor(
    noise: float, n: int, is_scaled: bool
) -> None:
    (line,) = faults(checked(channel(Quantity.BODY_ACCELERATION), still(1e-3, noise, n)))
    assert (line.advice == "state gain = 9806.65") is is_scaled
    assert (line.severity is OK) is not is_scaled


def sibling(name: str, value: float, quality: int = 0) -> dict[str, Samples]:
    t_ns = np.arange(5, dtype=np.int64)
    values = np.array([value, value, value, -9e3, 9e3])
    return {name: Samples(name, t_ns, values, np.full(5, quality, np.uint8))}


@pytest.mark.parametrize(
    ("share", "others", "advice"),
    [
        (0.49, sibling("IMU.x", 1.09), 'take signal = "IMU.x"'),
        (0.49, sibling("IMU.x", 0.91), 'take signal = "IMU.x"'),
        (-0.49, sibling("IMU.x", -1.09), 'take signal = "IMU.x" with sign = -1'),
        (0.49, sibling("IMU.x", 1.11), ""),
        (0.49, sibling("IMU.x", 0.89), ""),
        (0.51, sibling("IMU.x", 1.0), ""),
        (0.2, sibling("IMU.x", 1.0, int(Quality.CRC_BAD)), ""),
        (0.2, sibling("IMU.z", 1.0), ""),  # of an unknown unit
        (0.2, sibling("IMU.z", 1.0) | sibling("TWIN.u", 1.0), 'take signal = "TWIN.u"'),
        (0.2, sibling("Z.v", 9.8), ""),  # of another sender
        (0.2, sibling("IMU.x", 0.3) | sibling("TWIN.u", 1.0), 'take signal = "TWIN.u"'),
        (0.01, sibling("TWIN.u", 1.0), 'take signal = "TWIN.u"'),
    ],
)
def test_another_axis_of_the_sensor_that_reads_gravity_is_named(
    share: float, others: Mapping[str, Samples], advice: str
) -> None:
    own = channel(Quantity.BODY_ACCELERATION, "IMU.y")
    (line,) = faults(checked(own, still(share * G, 0.1), others=others))
    assert (line.advice if "axis" in line.text else "") == advice


def test_messages_of_one_sample_set_are_one_sensor() -> None:
    together = SampleSet(name="set", messages=("IMU", "Z"), bound_by="IMU.x")
    for sets, named in (
        ((together,), True),
        ((together.model_copy(update={"messages": ("T", "Z")}),), False),
    ):
        own = channel(Quantity.BODY_ACCELERATION, "IMU.y")
        (line,) = faults(checked(own, still(0.2 * G, 0.1), others=sibling("Z.v", G), sets=sets))
        assert (line.advice == 'take signal = "Z.v"') is named
