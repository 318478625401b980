"""The bench check on simulated benches: a sound one passes, each fault is named."""

import re
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from functools import cache
from typing import Any

import numpy as np
import pytest

from daq.bench.config import Bench, bench_codec, load_bench
from daq.channels import Quantity
from daq.check.check import CheckReport, check_bench
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import Codec, FrameBatch, FrameFlag, parse_codec
from dbc.finding import Finding, Severity

from ..sensor_bench import START_NS

TODAY = date(2026, 6, 1)
REST_S = 3.0


@cache
def _bench() -> Bench:
    return load_bench(None)


@cache
def _codec() -> Codec:
    return bench_codec(_bench())


@cache
def _rest() -> FrameBatch:
    """Three seconds of the simulated car at rest."""
    car = SimulatedCar(lead_s=REST_S + 0.2)
    frames = next(iter(campaign_frames(_bench(), _codec(), car, 1, START_NS)))
    return frames.select(frames.t_ns < START_NS + round(REST_S * 1e9))


def _check(
    frames: FrameBatch, bench: Bench | None = None, codec: Codec | None = None
) -> CheckReport:
    return check_bench(bench or _bench(), codec or _codec(), frames, TODAY)


def _bad(report: CheckReport) -> list[Finding]:
    return [line for line in report.lines if line.severity is not Severity.NOTE]


def _id(name: str) -> int:
    return _codec().message(name).can_id


def _with_payload(
    name: str, change: Callable[[np.ndarray], None], crc_too: bool = True
) -> FrameBatch:
    """Change the payloads of one message, and correct their checksums."""
    from dbc.layout import CRC_RULES

    frames = _rest()
    data = frames.data.copy()
    rows = np.flatnonzero(frames.can_id == _id(name))
    part = data[rows]
    change(part)
    if crc_too:
        last = _codec().message(name).length - 1
        part[:, last] = CRC_RULES["crc8_j1850"](part[:, :last])
    data[rows] = part
    return FrameBatch(frames.t_ns, frames.can_id, frames.flags, frames.bus, frames.length, data)


def _channel(name: str, **changes: Any) -> Bench:
    """Return the bench with one channel described differently."""
    channels = tuple(replace(c, **changes) if c.name == name else c for c in _bench().channels)
    return replace(_bench(), channels=channels)


def test_a_sound_bench_passes_and_says_what_it_measured() -> None:
    report = _check(_rest())
    assert _bad(report) == []
    assert report.verdict is Severity.NOTE
    lines = {line.subject: line for line in report.lines}
    figures = lines["message HUB_Front"].figures
    assert figures["rate_hz"] == pytest.approx(1000, rel=1e-3)
    assert 0 < figures["jitter_s"] < 1e-3
    z = lines["channel body_acc_z"]
    assert z.figures["level"] == pytest.approx(9.80665, abs=0.2)
    assert z.figures["noise"] == pytest.approx(0.03, rel=0.15)  # as simulated
    assert "+1 g" in z.text
    assert lines["channel hub_acc_fl"].figures["noise"] == pytest.approx(0.15, rel=0.15)
    # No digit below the noise: 0.0017 rad/s, and no minus before a zero.
    shown = lines["channel roll_rate"].text.split()[0]
    assert re.fullmatch(r"0\.0000|-?0\.000[1-9]", shown), shown
    assert report.frames == len(_rest())


def test_silence_is_a_failure() -> None:
    (line,) = _check(FrameBatch.empty()).lines
    assert (line.severity, line.text) == (Severity.ERROR, "no frame was received")


def _one(frames: FrameBatch, bench: Bench | None = None, codec: Codec | None = None) -> Finding:
    """Check, and return the line of the only fault."""
    bad = _bad(_check(frames, bench, codec))
    assert len(bad) == 1, bad
    return bad[0]


def test_a_log_that_a_trigger_wrote_is_checked_without_its_pauses() -> None:
    frames = _rest()
    since_s = (frames.t_ns - START_NS) * 1e-9
    # 0.5 s and 2.5 s of it, 10 s apart: by time 40,000 frames are missing between them.
    paused = replace(frames, t_ns=frames.t_ns + np.where(since_s > 0.5, 10 * 10**9, 0))
    (bad,) = _bad(_check(paused))
    assert (bad.severity, bad.subject) == (Severity.WARNING, "bus")
    assert bad.text.startswith("a pause without any frame, 10.0 s in all")
    assert bad.text.endswith("longest stretch without one, 2.5 s")


def test_wrong_sign() -> None:
    line = _one(_rest(), _channel("hub_acc_rl", sign=-1.0))
    assert (line.severity, line.subject) == (Severity.ERROR, "channel hub_acc_rl")
    assert "upside down" in line.text
    assert line.advice == "set sign = 1"


@pytest.mark.parametrize(
    ("signal_unit", "factor", "advice"),
    [
        ("m/s2", 1 / 9.80665, 'signal_unit = "g"'),  # g taken for m/s2
        ("mg", 1e-3, "gain = 1000"),
    ],
)
def test_wrong_unit_of_a_hub(signal_unit: str, factor: float, advice: str) -> None:
    bad = _bad(_check(_rest(), _channel("hub_acc_fl", signal_unit=signal_unit)))
    line = bad[0]
    assert line.severity is Severity.ERROR
    assert f"{factor:.4g} times gravity" in line.text
    assert advice in line.advice


def test_wrong_axis() -> None:
    line = _one(_rest(), _channel("body_acc_z", signal="IMU_Accel.acc_x"))
    assert (line.severity, line.subject) == (Severity.ERROR, "channel body_acc_z")
    assert 'take signal = "IMU_Accel.acc_z"' in line.advice


def test_no_gravity_is_said_and_allowed() -> None:
    def center(part: np.ndarray) -> None:
        up = part[:, 4:6].copy().view("<i2")
        part[:, 4:6] = (up - 9807).astype("<i2").view(np.uint8)

    report = _check(_with_payload("IMU_Accel", center))
    assert _bad(report) == []
    (line,) = [x for x in report.lines if x.subject == "channel body_acc_z"]
    assert "no gravity (AC-coupled, or tared in the sensor)" in line.text


def test_a_missing_message_and_who_may_be_it() -> None:
    frames = _rest()
    can_id = np.where(frames.can_id == _id("SUSP_Rear"), 0x3A1, frames.can_id).astype(np.uint32)
    moved = FrameBatch(frames.t_ns, can_id, frames.flags, frames.bus, frames.length, frames.data)
    unknown, missing, *channels = _bad(_check(moved))
    assert unknown.text.startswith("1 identifier is not in the DBC: 0x3a1 (500 Hz)")
    assert (missing.severity, missing.subject) == (Severity.ERROR, "message SUSP_Rear")
    assert "0x3a1 has its length and rate" in missing.advice
    assert [line.subject for line in channels] == ["channel travel_rl", "channel travel_rr"]


def test_the_same_identifier_with_29_bits() -> None:
    frames = _rest()
    flags = np.where(frames.can_id == _id("IMU_Rate"), FrameFlag.EXTENDED, 0).astype(np.uint16)
    wide = FrameBatch(frames.t_ns, frames.can_id, flags, frames.bus, frames.length, frames.data)
    assert "comes with 29 bits; the DBC has IMU_Rate with 11" in _bad(_check(wide))[0].advice


def test_half_the_rate() -> None:
    rows = np.flatnonzero(_rest().can_id == _id("IMU_Rate"))

    def count_on(part: np.ndarray) -> None:
        part[::2, 6] = np.arange(len(part[::2])) % 256  # the sensor's own counter, at half rate

    frames = _with_payload("IMU_Rate", count_on)
    line = _one(frames.select(np.setdiff1d(np.arange(len(frames)), rows[1::2])))
    assert (line.severity, line.subject) == (Severity.ERROR, "message IMU_Rate")
    assert line.text == "250.0 Hz instead of 500.0 Hz"
    assert "cycle_ms = 4" in line.advice


def test_a_sensor_that_fell_silent() -> None:
    gone = (_rest().can_id == _id("SUSP_Front")) & (_rest().t_ns > START_NS + 1_500_000_000)
    bad = _bad(_check(_rest().select(~gone)))
    assert bad[0].text.startswith("silent for the last 1.5")
    assert {line.subject for line in bad} == {"message SUSP_Front"}


@pytest.mark.parametrize(("every", "verdict"), [(50, Severity.ERROR), (500, Severity.WARNING)])
def test_checksum_errors(every: int, verdict: Severity) -> None:
    def flip(part: np.ndarray) -> None:
        part[5::every, 0] ^= 4

    bad = _bad(_check(_with_payload("SUSP_Rear", flip, crc_too=False)))
    assert bad[0].severity is verdict
    assert "have a wrong checksum (crc8_j1850)" in bad[0].text
    assert {line.subject for line in bad[1:]} == {"channel travel_rl", "channel travel_rr"}
    assert all("the checksum does not match" in line.text for line in bad[1:])


def test_travel_that_is_not_zero_or_cannot_be() -> None:
    line = _one(_rest(), _channel("travel_fl", tare=0.1))
    assert line.severity is Severity.WARNING
    tare = float(line.advice.split("=")[1].split()[0])
    assert _bad(_check(_rest(), _channel("travel_fl", tare=tare))) == []
    bad = _bad(_check(_rest(), _channel("travel_rl", signal_unit="m")))
    (line,) = [line for line in bad if line.severity is Severity.ERROR]
    assert 'state signal_unit = "mm"' in line.advice


def test_error_frames_and_foreign_traffic_are_warnings() -> None:
    extra = FrameBatch(
        START_NS + np.arange(20) * 10_000_000,
        np.full(20, 0x7FF, np.uint32),
        np.where(np.arange(20) % 2, FrameFlag.ERROR, 0).astype(np.uint16),
        np.zeros(20, np.uint8),
        np.full(20, 8, np.uint8),
        np.zeros((20, 8), np.uint8),
    )
    frames = FrameBatch.concatenate([_rest(), extra])
    report = _check(frames.by_time())
    assert [line.text.split(":")[0] for line in _bad(report)] == [
        "10 error frames",
        "1 identifier is not in the DBC",
    ]
    assert report.verdict is Severity.WARNING


def test_a_moving_car_is_not_at_rest() -> None:
    car = SimulatedCar(lead_s=0.5, tail_s=2.5)
    frames = next(iter(campaign_frames(_bench(), _codec(), car, 1, START_NS)))
    report = _check(frames)
    moving = {x.subject for x in _bad(report) if "not at rest" in x.text}
    assert moving >= {"channel body_acc_z", "channel travel_fl", "channel pitch_rate"}
    # Half a second of rest is enough to be sure of units and signs all the same.
    assert not [x for x in report.lines if "upside down" in x.text or "wrong" in x.text]


def test_a_bench_that_cannot_trigger() -> None:
    channels = tuple(c for c in _bench().channels if c.quantity is Quantity.SUSPENSION_TRAVEL)
    line = _one(_rest(), replace(_bench(), channels=channels))
    assert (line.severity, line.subject) == (Severity.ERROR, "trigger")


def test_a_sentinel_for_no_value_is_named() -> None:
    text = _bench().dbc_text + 'VAL_ 288 travel_fl 32767 "sensor error" ;\n'
    codec = parse_codec(text, "with sentinels")

    def absent(part: np.ndarray) -> None:
        part[:, 0:2] = [0xFF, 0x7F]

    bad = _bad(_check(_with_payload("SUSP_Front", absent), codec=codec))
    assert {line.subject for line in bad} == {"channel travel_fl"}
    assert bad[0].severity is Severity.ERROR
