"""Each limit of what a sensor may read at rest, from both sides, on samples made by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.check.check import check_channel
from daq.samples.mapping import map_channels
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.codec import DecodeCounts, Decoded, Quality, Samples
from dbc.words import Finding, Severity

Array = NDArray[np.float64]
TODAY = date(2026, 6, 1)
G = 9.80665
WARN, FAIL, OK = Severity.WARNING, Severity.ERROR, Severity.NOTE
FLOATS = {"Z": "m/s2", "W": "rad/s", "T": "rad/s2", "S": "m"}
DBC = (
    'VERSION ""\n\nBU_: A B\n'
    + "".join(
        f'BO_ {300 + n} {name}: 8 A\n SG_ v : 0|32@1- (1,0) [0|0] "{unit}" A\n'
        for n, (name, unit) in enumerate(FLOATS.items())
    )
    + 'BO_ 310 RAW: 8 B\n SG_ v : 0|16@1- (0.001,0) [-30|30] "m" A\n'
    + ' SG_ bit : 16|1@1+ (1,0) [0|0] "m" A\n SG_ up : 24|16@1+ (0.001,0) [0|0] "m" A\n'
    + ' SG_ two : 40|2@1+ (0.01,0) [0|0] "m" A\n'
    + 'BO_ 320 IMU: 8 B\n SG_ x : 0|16@1- (0.001,0) [0|0] "g" A\n'
    + ' SG_ y : 16|16@1- (0.01,0) [0|0] "m/s2" A\n SG_ z : 32|16@1- (1,0) [0|0] "furlong" A\n'
    + 'BO_ 330 TWIN: 8 B\n SG_ u : 0|16@1- (0.001,0) [0|0] "g" A\n'
    + "".join(f"SIG_VALTYPE_ {300 + n} v : 1;\n" for n in range(4))
)
CODEC = parse_codec(DBC, "rest.dbc")
STEP_NS = 12_500_000
"""80 Hz: eight samples in each tenth of a second."""
KINDS = {
    Quantity.BODY_ACCELERATION: "Z",
    Quantity.HUB_ACCELERATION: "Z",
    Quantity.PITCH_RATE: "W",
    Quantity.ROLL_RATE: "W",
    Quantity.PITCH_ACCELERATION: "T",
    Quantity.ROLL_ACCELERATION: "T",
    Quantity.SUSPENSION_TRAVEL: "S",
    Quantity.BODY_DISPLACEMENT: "S",
}


def channel(quantity: Quantity, signal: str = "", **facts: Any) -> Channel:
    wheel = quantity in (Quantity.HUB_ACCELERATION, Quantity.SUSPENSION_TRAVEL)
    corner = Corner.FRONT_LEFT if wheel else None
    return Channel("c", quantity, signal=signal or f"{KINDS[quantity]}.v", corner=corner, **facts)


def checked(
    one: Channel,
    value: Sequence[float] | Array,
    quality: int | NDArray[np.uint8] = 0,
    others: Mapping[str, Samples] | None = None,
    step_ns: int = STEP_NS,
) -> list[Finding]:
    array = np.asarray(value, float)
    n = len(array)
    bits: NDArray[np.uint8] = np.zeros(n, np.uint8)
    bits[:] = quality
    own = Samples(one.signal, np.arange(n) * step_ns, array, bits)
    decoded = Decoded({one.signal: own, **(others or {})}, DecodeCounts(0, 0, 0, 0, 0))
    (mapped,) = map_channels((one,), CODEC.messages, "rest.dbc")
    return check_channel(mapped, decoded, 365, TODAY)


def still(level: float, noise: float = 1e-3, n: int = 320) -> Array:
    """Return samples whose neighbours differ by 1.414 `noise`; the mean of each eight is `level`.

    White noise of that standard deviation differs as much.
    """
    turn: Array = np.resize([0.0, 1.0, 0.0, -1.0], n)
    return np.asarray(level + noise * np.sqrt(2.0) * turn)


def faults(lines: Sequence[Finding]) -> list[Finding]:
    """Return what is not right, or else what the channel reads."""
    return [line for line in lines if line.code != "rest"] or list(lines)


def found(lines: Sequence[Finding]) -> dict[str, Severity]:
    return {line.code: line.severity for line in faults(lines)}


def level_of(quantity: Quantity) -> float:
    return G if KINDS[quantity] == "Z" else 0.0


@pytest.mark.parametrize(
    ("quantity", "most_noise", "most_motion"),
    [
        (Quantity.BODY_ACCELERATION, 0.5, 0.5),
        (Quantity.HUB_ACCELERATION, 2.0, 1.0),
        (Quantity.PITCH_RATE, 0.02, 0.05),
        (Quantity.ROLL_RATE, 0.02, 0.05),
        (Quantity.PITCH_ACCELERATION, 0.5, 0.5),
        (Quantity.ROLL_ACCELERATION, 0.5, 0.5),
        (Quantity.SUSPENSION_TRAVEL, 2e-3, 5e-3),
        (Quantity.BODY_DISPLACEMENT, 2e-3, 5e-3),
    ],
)
def test_each_kind_of_sensor_has_its_usual_noise_and_may_move_a_little(
    quantity: Quantity, most_noise: float, most_motion: float
) -> None:
    """It moves if the means of tenths of a second lie apart."""
    level, swing = level_of(quantity), np.repeat(np.resize([-0.5, 0.5], 40), 8)
    for share in (0.99, 1.01):
        noisy = checked(channel(quantity), still(level, share * most_noise))
        moved = checked(channel(quantity), level + swing * share * most_motion)
        for lines, code, most in ((noisy, "noise", most_noise), (moved, "motion", most_motion)):
            assert found(lines) == ({"rest": OK} if share < 1.0 else {code: WARN})
            assert lines[0].figures[code] == pytest.approx(share * most)


@pytest.mark.parametrize(
    ("quantity", "level", "expected"),
    [
        (Quantity.PITCH_RATE, 0.034, "rest"),
        (Quantity.ROLL_RATE, -0.036, "tare"),
        (Quantity.PITCH_RATE, 0.49, "tare"),
        (Quantity.PITCH_RATE, -0.51, "level"),
        (Quantity.PITCH_ACCELERATION, 0.99, "rest"),
        (Quantity.PITCH_ACCELERATION, 1.01, "tare"),
        (Quantity.ROLL_ACCELERATION, -19.9, "tare"),
        (Quantity.ROLL_ACCELERATION, 20.1, "level"),
        (Quantity.SUSPENSION_TRAVEL, 0.029, "rest"),
        (Quantity.SUSPENSION_TRAVEL, -0.031, "tare"),
        (Quantity.BODY_DISPLACEMENT, 0.99, "tare"),
        (Quantity.BODY_DISPLACEMENT, 1.01, "level"),
    ],
)
def test_a_level_is_near_zero_or_wants_a_tare_or_cannot_be(
    quantity: Quantity, level: float, expected: str
) -> None:
    verdict = {"rest": OK, "tare": WARN, "level": FAIL}[expected]
    assert found(checked(channel(quantity), still(level))) == {expected: verdict}


@pytest.mark.parametrize(("step_ns", "slow"), [(19_900_000, False), (20_100_000, True)])
def test_fifty_samples_a_second_are_asked_for(step_ns: int, slow: bool) -> None:
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL), still(0.0, n=100), step_ns=step_ns)
    assert found(lines) == ({"slow": WARN} if slow else {"rest": OK})
    assert lines[0].figures["rate_hz"] == pytest.approx(1e9 / step_ns)
    one = checked(channel(Quantity.SUSPENSION_TRAVEL), [0.0])
    assert found(one) == {"rest": OK}
    assert one[0].figures["rate_hz"] == 0.0


@pytest.mark.parametrize(("sigma_m", "guessed"), [(0.29, False), (0.3, True)])
def test_a_place_known_to_thirty_centimetres_is_a_guess(sigma_m: float, guessed: bool) -> None:
    for quantity in (Quantity.BODY_ACCELERATION, Quantity.BODY_DISPLACEMENT):
        one = channel(quantity, position_sigma_m=sigma_m)
        assert found(checked(one, still(level_of(quantity)))) == (
            {"position": WARN} if guessed else {"rest": OK}
        )
    rate = channel(Quantity.PITCH_RATE, position_sigma_m=sigma_m)
    assert found(checked(rate, still(0.0))) == {"rest": OK}


@pytest.mark.parametrize(("bad", "verdict"), [(1, WARN), (160, WARN), (161, FAIL), (320, FAIL)])
@pytest.mark.parametrize(
    ("bit", "why"),
    [
        (Quality.CRC_BAD, "checksum"),
        (Quality.SENTINEL, "no value"),
        (Quality.MISSING, "too short"),
    ],
)
def test_more_than_half_of_the_samples_have_to_be_usable(
    bad: int, verdict: Severity, bit: Quality, why: str
) -> None:
    quality = np.zeros(320, np.uint8)
    quality[:bad] = bit
    (line,) = faults(checked(channel(Quantity.SUSPENSION_TRAVEL), still(0.0), quality))
    assert (line.code, line.severity) == ("unusable", verdict)
    assert line.text.startswith(f"{bad} of 320 samples")
    assert why in line.text


@pytest.mark.parametrize(("out", "verdict"), [(1, WARN), (160, WARN), (161, FAIL)])
def test_samples_outside_the_range_of_the_dbc_are_counted(out: int, verdict: Severity) -> None:
    quality = np.zeros(320, np.uint8)
    quality[:out] = Quality.OUT_OF_RANGE
    quality[300:] = Quality.CRC_BAD | Quality.OUT_OF_RANGE  # not usable, so not out of range
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL, "RAW.v"), still(0.0), quality)
    assert found(lines) == {"unusable": WARN, "out_of_range": verdict}
    text = f"{out} of 320 samples {'is' if out == 1 else 'are'} outside -30 to 30 m"
    assert text in [line.text for line in lines]


def test_samples_that_are_no_number_fail() -> None:
    value = still(0.0)
    value[3] = np.nan
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL), value)
    assert found(lines) == {"no_number": FAIL}
    assert lines[0].text == "1 of 320 samples is no number"
    quality = np.zeros(320, np.uint8)
    quality[3] = Quality.SENTINEL
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL), value, quality)
    assert found(lines) == {"unusable": WARN}
    assert found(checked(channel(Quantity.SUSPENSION_TRAVEL), [np.nan] * 9)) == {"no_number": FAIL}


@pytest.mark.parametrize(("at_end", "verdict"), [(0, OK), (1, WARN), (3, WARN), (4, FAIL)])
@pytest.mark.parametrize("end", [32.767, -32.768])
def test_a_hundredth_of_the_samples_may_lie_at_the_end_of_the_bits(
    at_end: int, verdict: Severity, end: float
) -> None:
    value = still(0.0)
    value[40 : 40 + 60 * at_end : 60] = end
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL, "RAW.v"), value)
    assert found(lines).get("overload", OK) is verdict
    floating = checked(channel(Quantity.SUSPENSION_TRAVEL), value)
    assert "overload" not in found(floating)


@pytest.mark.parametrize(
    ("signal", "value", "n", "expected"),
    [
        ("S.v", 0.02, 19, {"rest": OK}),
        ("S.v", 0.02, 20, {"stuck": WARN}),  # a potentiometer may rest on one value
        ("RAW.v", 0.02, 20, {"stuck": WARN}),
        ("RAW.v", 32.767, 20, {"stuck": FAIL}),  # at the end of its bits
        ("RAW.v", -32.768, 20, {"stuck": FAIL}),
        ("RAW.up", 0.0, 20, {"stuck": WARN}),  # but not at the zero of an unsigned one
        ("RAW.up", 65.535, 20, {"stuck": FAIL}),
        ("RAW.bit", 1.0, 20, {"stuck": WARN, "tare": WARN}),
    ],
)
def test_twenty_like_samples_are_a_sensor_that_is_stuck(
    signal: str, value: float, n: int, expected: dict[str, Severity]
) -> None:
    assert found(checked(channel(Quantity.SUSPENSION_TRAVEL, signal), [value] * n)) == expected


def test_a_channel_without_samples_fails_and_one_that_is_not_used_never() -> None:
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL), [])
    assert found(lines) == {"no_sample": FAIL}
    assert lines[0].subject == "channel c"
    assert found(checked(channel(Quantity.UNUSED, "S.v"), [])) == {"no_sample": WARN}
    dead = [32.767] * 20  # at the end of its bits
    assert found(checked(channel(Quantity.UNUSED, "RAW.v"), dead)) == {"rest": OK}
    lines = checked(channel(Quantity.UNUSED, "RAW.v"), dead, Quality.SENTINEL)
    assert found(lines) == {"unusable": WARN}


@pytest.mark.parametrize(
    ("day", "text"),
    [
        ("2025-06-01", ""),  # 365 days ago
        ("2025-05-31", "calibrated on 2025-05-31, 366 days ago"),
        ("2026-06-01", ""),
    ],
)
def test_a_calibration_is_valid_from_its_day_on_for_a_year(day: str, text: str) -> None:
    lines = checked(channel(Quantity.SUSPENSION_TRAVEL, calibrated=day), still(0.0))
    assert [line.text for line in lines if line.code == "calibration"] == [text] * bool(text)


# Gravity ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("share", "verdict", "says"),
    [
        (1.059, OK, "+1 g"),
        (0.941, OK, "+1 g"),
        (-1.059, FAIL, "upside down"),
        (-0.941, FAIL, "upside down"),
        (1.061, WARN, "m/s2 at rest: its scale is wrong"),  # no tilt makes it read more
        (0.939, WARN, "tilted by 20 degrees"),
        (-0.939, FAIL, "upside down, tilted by 20 degrees, or its scale is wrong"),
        (0.701, WARN, "tilted by 45 degrees"),
        (0.699, FAIL, "tilted by 46 degrees"),
        (1.299, WARN, "its scale"),
        (1.301, FAIL, "its scale"),
        (0.061, FAIL, "tilted by 87 degrees"),
        (0.059, WARN, "no gravity"),
        (0.0, WARN, "no gravity"),
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
    assert ("set sign = -1" in line.advice) is ("upside" in says)


@pytest.mark.parametrize(
    ("share", "setting"),
    [
        (1.07 / G, 'state signal_unit = "g"'),
        (0.93 / G, 'state signal_unit = "g"'),
        (-1.07 / G, 'state signal_unit = "g" and set sign = -1'),
        (1.09 / G, ""),
        (0.91 / G, ""),
        (1.07 * G, 'state signal_unit = "m/s2"'),
        (-1e3 * G, 'state signal_unit = "mm/s2" and set sign = -1'),
        (30.0, ""),
    ],
)
def test_gravity_in_a_wrong_unit_shows_which_it_is(share: float, setting: str) -> None:
    quiet = min(1e-4, abs(share) * 1e-2)
    (line,) = faults(checked(channel(Quantity.BODY_ACCELERATION), still(share * G, quiet)))
    assert line.severity is FAIL
    assert (line.advice if "gravity" in line.text else "") == setting
