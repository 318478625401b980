"""The ready maps against frames packed by hand from the makers' documents."""

from __future__ import annotations

import math
import struct
from collections.abc import Container
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Method, sketch
from daq.bench.config import Bench, bench_codec, parse_bench
from daq.check.check import check_bench
from daq.runs import Excitation, SampleGroup
from daq.samples.mapping import map_channels, sample_groups, timekeeping
from dbc.codec import Quality
from dbc.finding import Severity
from dbc.frames import FrameBatch

from ..sensor_bench import START_NS, Row, frame_batch

G = 9.80665
DEG = math.pi / 180
TODAY = date(2026, 6, 1)


def _bench(name: str) -> Bench:
    return parse_bench(f'dbc = "layout:{name}"', name, Path())


def _groups(name: str, frames: FrameBatch) -> dict[str, SampleGroup]:
    bench = _bench(name)
    codec = bench_codec(bench)
    mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
    groups = sample_groups(mapped, codec.decode(frames), timekeeping(bench, codec), START_NS)
    return {group.name: group for group in groups}


def _xsens(k: int, stamp: int, acc: tuple[int, ...], gyr: tuple[int, ...]) -> list[bytes]:
    return [
        struct.pack(">I", stamp % 2**32),
        struct.pack(">H", k % 65536),
        struct.pack(">3h", *gyr),
        struct.pack(">3h", *acc),
    ]


XSENS_IDS = (0x05, 0x06, 0x32, 0x34)


def _mm7(
    k: int, z: tuple[float, float], x: tuple[float, float], y: tuple[float, float]
) -> list[bytes]:
    def one(rate: float, acc: float) -> bytes:
        raw_rate, raw_acc = round((rate + 163.84) / 0.005), round((acc + 4.1768) / 0.000127465)
        return struct.pack("<HBBHBB", raw_rate, 0, 0, raw_acc, k % 16, 0xAB)

    return [one(*z), one(*x), one(*y)]


MM7_IDS = (0x174, 0x178, 0x17C)

# Per layout: frames of one sample, and the SI values (x forward, y left, z up) they stand for.
REST: dict[str, tuple[list[tuple[int, bytes]], dict[str, float]]] = {
    "xsens_mti": (
        list(zip(XSENS_IDS, _xsens(0, 1000, (256, -512, 2511), (512, -256, 100)), strict=True)),
        {
            "body_acc_x": 1.0,
            "body_acc_y": -2.0,
            "body_acc_z": 2511 / 256,
            "roll_rate": 1.0,
            "pitch_rate": -0.5,
            "yaw_rate": 100 / 512,
        },
    ),
    "bosch_mm7": (
        list(zip(MM7_IDS, _mm7(3, (10.0, 0.5), (20.0, -0.25), (-30.0, 1.0)), strict=True)),
        {
            "body_acc_x": -0.25 * G,
            "body_acc_y": 0.5 * G,
            "body_acc_z": 1.0 * G,
            "roll_rate": -20 * DEG,
            "pitch_rate": -30 * DEG,
            "yaw_rate": 10 * DEG,
        },
    ),
    "bosch_mm5_10": (
        [
            (0x174, struct.pack("<HHHH", 34768, 0, 32768, 0)),
            (0x178, struct.pack("<HHHH", 36768, 0, 36000, 0)),
            (0x17C, struct.pack("<HHHH", 0, 0, 40613, 0)),
        ],
        {
            "body_acc_x": (36000 * 0.000127465 - 4.1768) * G,
            "body_acc_y": (32768 * 0.000127465 - 4.1768) * G,
            "body_acc_z": (40613 * 0.000127465 - 4.1768) * G,
            "roll_rate": -20 * DEG,
            "yaw_rate": 10 * DEG,
        },
    ),
    "racelogic_imu04": (
        [
            (0x600, struct.pack(">ff", 5.0, 0.25)),
            (0x601, struct.pack(">ff", -0.5, 21.0)),
            (0x602, struct.pack(">ff", -3.0, 4.0)),
            (0x603, struct.pack(">ff", 1.0, 0.0)),
        ],
        {
            "body_acc_x": 0.25 * G,
            "body_acc_y": -0.5 * G,
            "body_acc_z": G,
            "roll_rate": -4 * DEG,
            "pitch_rate": 3 * DEG,  # the nose goes down
            "yaw_rate": -5 * DEG,  # clockwise is to the right
        },
    ),
    "oxts_rt": (
        [
            (0x605, struct.pack("<4h", 50, 100, -981, 0)),
            (0x608, struct.pack("<4h", 200, 300, -400, 0)),
            (0x630, struct.pack("<q", 1_460_000_000_000)[:6] + b"\x12\x00"),
        ],
        {
            "body_acc_x": 0.5,
            "body_acc_y": -1.0,
            "body_acc_z": 9.81,
            "roll_rate": 2 * DEG,
            "pitch_rate": -3 * DEG,
            "yaw_rate": 4 * DEG,
        },
    ),
    "sbg_ecan": (
        [
            (0x120, struct.pack("<IHh", 123_456, 0, 2500)),
            (0x121, struct.pack("<3h", 50, 100, -981)),
            (0x122, struct.pack("<3h", 20, 30, -40)),
        ],
        {
            "body_acc_x": 0.5,
            "body_acc_y": -1.0,
            "body_acc_z": 9.81,
            "roll_rate": 0.02,
            "pitch_rate": -0.03,
            "yaw_rate": 0.04,
        },
    ),
    "canopen_string_pot": (
        [(0x181 + i, struct.pack("<ihB", 1000 * (i - 1), -5, 0)) for i in range(4)],
        {"travel_fl": 0.01, "travel_fr": 0.0, "travel_rl": -0.01, "travel_rr": -0.02},
    ),
}


@pytest.mark.parametrize("name", REST)
def test_values_and_units_of_one_sample(name: str) -> None:
    frames, expected = REST[name]
    bench = _bench(name)
    codec = bench_codec(bench)
    decoded = codec.decode(frame_batch([(1e-4 * i, *f) for i, f in enumerate(frames)]))
    assert decoded.counts.unknown_id == 0
    assert decoded.counts.wrong_length == 0
    mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
    values = {m.channel.name: m.values(decoded[m.channel.signal])[0] for m in mapped}
    assert values.keys() == expected.keys()
    # Offset-binary numbers are rounded to half a step when packed.
    step = {"body_acc_x": 7e-4, "body_acc_y": 7e-4, "body_acc_z": 7e-4} if "mm" in name else {}
    for channel, value in expected.items():
        assert values[channel] == pytest.approx(value, rel=1e-6, abs=step.get(channel, 1e-9)), (
            channel
        )
    units = {m.channel.unit for m in mapped}
    assert units <= {"m/s2", "rad/s", "m"}


def _noise(rng: np.random.Generator, n: int) -> list[int]:
    return [int(v) for v in np.rint(rng.normal(0, 6, n))]


def _xsens_rows(n: int, tick_us: int, drop: Container[tuple[int, int]] = ()) -> list[Row]:
    """Return n samples at 100 Hz of a slow clock, in late bursts; `drop` is of (sample, frame)."""
    rng = np.random.default_rng(7)
    rows: list[Row] = []
    for k in range(n):
        taken_s = k * 0.01 * (1 + 80e-6)
        stamp = 4_294_960_000 + k * 10_000 // tick_us  # wraps on the way
        a, g = _noise(rng, 3), _noise(rng, 3)
        late_s = float(rng.exponential(200e-6))
        burst = _xsens(k, stamp, (a[0], a[1], 2510 + a[2]), (g[0], g[1], k % 100))
        for i, payload in enumerate(burst):
            if (k, i) not in drop:
                rows.append((taken_s + late_s + 120e-6 * i, XSENS_IDS[i], payload))
    return rows


def test_a_sample_set_is_bound_by_its_time_stamp() -> None:
    lost = {
        (10, 3),
        (20, 0),
        (30, 2),
        (40, 0),
        (40, 3),
        (50, 0),
        (50, 2),
        (50, 3),
        (60, 0),
        (61, 0),
    }
    group = _groups("xsens_mti", frame_batch(_xsens_rows(500, 100, lost)))["mti"]
    numbers = np.rint(group.time_s / 0.01).astype(int)
    assert numbers.tolist() == [k for k in range(500) if k != 50]
    # Frame k carries k % 100 as its yaw rate: each sample has its own frames.
    yaw = np.rint(group.values["yaw_rate"] * 512)
    expected = (numbers % 100).astype(float)
    expected[np.isin(numbers, [30])] = np.nan
    np.testing.assert_array_equal(yaw, expected)
    missing = np.flatnonzero(np.isnan(group.values["body_acc_z"]))
    assert numbers[missing].tolist() == [10, 40]
    marked = numbers[(group.quality & Quality.MISSING) != 0]
    assert marked.tolist() == [10, 30, 40]
    assert numbers[(group.quality & Quality.COUNTER_GAP) != 0].tolist() == [51]
    # The sensor's clock is fitted: far better than the 200 us of the bus.
    error_s = group.time_s - numbers * 0.01 * (1 + 80e-6)
    assert np.abs(error_s).max() < 20e-6


def test_a_sample_set_is_bound_by_the_counter_that_all_its_frames_have() -> None:
    rng = np.random.default_rng(3)
    rows: list[Row] = []
    for k in range(400):
        late_s = float(rng.exponential(1e-3))
        for i, payload in enumerate(_mm7(k, (k % 50, 0), (k % 50, 0), (k % 50, 1))):
            if rng.uniform() > 0.05:
                rows.append((0.01 * k + late_s + 2e-4 * i, MM7_IDS[i], payload))
    group = _groups("bosch_mm7", frame_batch(rows))["mm7"]
    rates = np.array(
        [group.values["yaw_rate"], -group.values["roll_rate"], group.values["pitch_rate"]]
    )
    values = np.rint(rates / DEG)
    assert np.isnan(values).sum() > 20  # frames were lost
    spread = np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
    assert np.all(spread == 0)  # and none was put to another sample
    number = np.rint(group.time_s / 0.01).astype(int)
    np.testing.assert_array_equal(np.nanmax(values, axis=0), number % 50)


def test_the_check_passes_a_good_sensor_and_finds_a_wrong_time_unit() -> None:
    bench = _bench("xsens_mti")
    codec = bench_codec(bench)
    good = check_bench(bench, codec, frame_batch(_xsens_rows(500, 100)), TODAY)
    assert [line.text for line in good.lines if line.severity is Severity.ERROR] == []
    assert "+1 g" in next(x.text for x in good.lines if x.subject == "channel body_acc_z")
    bad = check_bench(bench, codec, frame_batch(_xsens_rows(500, 1)), TODAY)
    (line,) = [x for x in bad.lines if x.severity is Severity.ERROR]
    assert line.subject == "message SampleTime"
    assert "runs 99.99 times as fast" in line.text


@pytest.mark.parametrize("method", [Method.ROLL_OVER, Method.DROP])
def test_the_sketch_marks_the_wheels_of_the_bump(method: Method) -> None:
    mark = "===" if method is Method.ROLL_OVER else "[#]"
    counts = [
        sum(line.count(mark) for line in sketch(Campaign(method=method), kind)[:-1])
        for kind in Excitation
    ]
    assert counts == [4, 2, 2, 2, 2]


@pytest.mark.parametrize(
    ("lost", "verdict"),
    [(7, Severity.NOTE), (8, Severity.WARNING), (250, Severity.WARNING), (251, Severity.ERROR)],
)
def test_a_hundredth_of_a_sample_set_and_two_more_may_lack_a_frame(
    lost: int, verdict: Severity
) -> None:
    bench = _bench("xsens_mti")
    rows = _xsens_rows(500, 100, {(k, 3) for k in range(100, 100 + lost)})
    report = check_bench(bench, bench_codec(bench), frame_batch(rows), TODAY)
    (line,) = [x for x in report.lines if x.subject == "sample set mti"]
    assert line.severity is verdict
    assert (line.figures["samples"], line.figures["incomplete"]) == (500, lost)
    assert line.figures["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    if verdict is not Severity.NOTE:
        assert line.text == f"{lost} of 500 samples lack a frame"
