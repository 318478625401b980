"""Sensors of a bench: databases, buses, identifiers, names, and the ready maps.

The maps are held against frames packed by hand from the makers' documents.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Container
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Method, sketch
from daq.bench.config import Bench, bench_codec, load_bench, on_bus, parse_bench, with_database
from daq.bench.edit import with_channel
from daq.bench.sensors import stored_databases, stored_text
from daq.check.check import check_bench
from daq.runs import Excitation, SampleGroup
from daq.samples.mapping import bench_mapping, map_channels, sample_groups, timekeeping
from dbc import Samples
from dbc.codec import Quality
from dbc.frames import FrameBatch
from dbc.words import InputError, Severity

from ..sensor_bench import (
    DATABASES,
    IMU,
    POT,
    START_NS,
    TEXT,
    Row,
    channel,
    frame_batch,
    sensor_bench,
)

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
    for each, value in expected.items():
        assert values[each] == pytest.approx(value, rel=1e-6, abs=step.get(each, 1e-9)), each
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
    absurd = replace(bench, channels=tuple(replace(c, gain=1e9) for c in bench.channels))
    report = check_bench(absurd, bench_codec(bench), frame_batch(rows), TODAY)
    assert line in report.lines  # values that cannot be used are no missing frames


# A bench that is a list of sensors ----------------------------------------------------------------

STORED = stored_text(DATABASES)


def read(text: str) -> str:
    """Return the one line with which a bench is refused."""
    with pytest.raises(InputError) as refusal:
        _use(text)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


def _use(text: str) -> None:
    bench = parse_bench(text, "bench.toml", Path(), STORED)
    bench_mapping(bench, bench_codec(bench))


def test_messages_of_like_sensors_are_different_messages_on_their_buses() -> None:
    messages = {m.name: (m.can_id, m.bus) for m in bench_codec(sensor_bench()).messages}
    assert messages["imu_a.Accel"] == (256, 0)
    assert messages["imu_b.Accel"] == (256, 1)
    assert messages["hubs.Accel"] == (768, 0)
    assert messages["pot_fl.TPDO1"] == (385, 1)
    assert messages["pot_fr.TPDO1"] == (386, 1)
    assert messages["pot_rl.TPDO1"] == (0x183, 1)
    assert messages["pot_rr.TPDO1"] == (0x1C4, 1)
    assert "pot_rl.Heartbeat" not in messages  # ids names those that are sent


def test_signals_are_named_in_full() -> None:
    signals = {channel.name: channel.signal for channel in sensor_bench().channels}
    assert signals["acc_a"] == "imu_a.Accel.AccZ"
    assert signals["acc_b"] == "imu_b.Accel.AccZ"
    assert signals["pot_rr"] == "pot_rr.TPDO1.Position"
    mapped, triggers = bench_mapping(sensor_bench(), bench_codec(sensor_bench()))
    assert len(mapped) == 13
    assert triggers == {"hub_fl", "hub_fr", "hub_rl", "hub_rr"}


def test_the_databases_travel_with_the_bench() -> None:
    bench = sensor_bench()
    assert stored_databases(bench.dbc_text) == DATABASES
    again = parse_bench(bench.text, "the journal's", Path("/nowhere"), bench.dbc_text)
    assert again.channels == bench.channels
    assert bench_codec(again) == bench_codec(bench)


def test_files_are_read_beside_the_bench(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(TEXT, "utf-8")
    for name, text in DATABASES.items():
        (tmp_path / name).write_text(text, "utf-8")
    assert load_bench(tmp_path / "bench.toml").dbc_text == sensor_bench().dbc_text
    (tmp_path / "pot.dbc").unlink()
    with pytest.raises(InputError, match=r"pot\.dbc"):
        load_bench(tmp_path / "bench.toml")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t: t.replace('bus = "rear"', 'bus = "can7"', 1), "sensor imu_b is on bus can7"),
        (lambda t: t.replace('bus = "rear"', "bus = 2", 1), "sensor imu_b is on bus 2"),
        (lambda t: t.replace('bus = "rear"\n', "", 1), "sensor imu_b states no bus, which"),
        (lambda t: t.replace('name = "imu_b"', 'name = "imu_a"', 1), "sensor imu_a occurs twice"),
        (
            lambda t: t.replace('dbc = "hubs.dbc"', ""),
            "sensor.hubs: a sensor has either dbc or layout",
        ),
        (lambda t: 'dbc = "x.dbc"\n' + t, "dbc and [[sensor]] exclude each other"),
        (lambda t: t.replace('"hubs.dbc"', '"other.dbc"'), "the database other.dbc is missing"),
        (lambda t: t.replace("id_offset = 1", "id_offset = 0"), "pot_fl.TPDO1 and pot_fr.TPDO1"),
        (lambda t: t.replace("id_offset = 1", "id_offset = 1700"), "not one of 11 bits"),
        (lambda t: t.replace("id_offset = 1", "id_offset = -386"), "not one of 11 bits"),
        (lambda t: t.replace("{ TPDO1 =", "{ TPDO9 ="), "ids names TPDO9"),
        (lambda t: t.replace("imu_a.AccZ", "imu_a.AccW"), "has no signal 'imu_a.AccW'"),
    ],
)
def test_a_list_that_does_not_fit_is_refused_in_one_line(
    change: Callable[[str], str], reason: str
) -> None:
    assert reason in read(change(TEXT))


def test_an_identifier_that_no_channel_needs_twice_costs_the_other_message_only() -> None:
    # Both pots have the heartbeat 0x701; nothing refers to it.
    text = TEXT.replace("id_offset = 1\n", "ids = { TPDO1 = 0x182, Heartbeat = 0x701 }\n")
    codec = bench_codec(parse_bench(text, "bench.toml", Path(), STORED))
    lost = [each.subject for each in codec.left_out]
    assert lost == ["message pot_fl.Heartbeat", "message pot_fr.Heartbeat"]


def test_a_bench_of_one_bus_takes_frames_of_any_number() -> None:
    text = TEXT.replace('[[bus]]\ninterface = "virtual"\nchannel = "can1"\nname = "rear"\n', "")
    text = text.replace('bus = "rear"', 'bus = "can0"').replace(
        'dbc = "imu.dbc"\nbus = "can0"\n\n[[sensor]]\nname = "hubs"',
        'dbc = "imu.dbc"\nbus = "can0"\nid_offset = 16\n\n[[sensor]]\nname = "hubs"',
    )
    codec = bench_codec(parse_bench(text, "bench.toml", Path(), STORED))
    assert {message.bus for message in codec.messages} == {None}


def test_ready_maps_of_two_like_sensors_are_told_apart() -> None:
    text = """
    [[bus]]
    interface = "virtual"
    channel = "can0"
    [[bus]]
    interface = "virtual"
    channel = "can1"
    [[sensor]]
    name = "front"
    layout = "xsens_mti"
    bus = 0
    [[sensor]]
    name = "rear"
    layout = "xsens_mti"
    bus = 1
    """
    bench = parse_bench(text, "bench.toml", Path())
    bench_mapping(bench, bench_codec(bench))
    assert [s.name for s in bench.sample_sets] == ["front_mti", "rear_mti"]
    assert bench.sample_sets[1].messages == ("rear.RateOfTurn", "rear.Acceleration")
    assert bench.sample_sets[1].carrier == ("rear.SampleTime", "sample_time")
    assert bench.channels[2].name == "front_body_acc_z"
    assert bench.channels[8].signal == "rear.Acceleration.acc_z"
    own = text + channel("mine", "rear.acc_z", "body_acceleration")
    names = [c.name for c in parse_bench(own, "bench.toml", Path()).channels]
    assert names[0] == "mine"  # the rear sensor's own map in place of the ready one
    assert len([n for n in names if n.startswith("front_")]) == 6


def test_one_database_does_not_take_the_place_of_several(tmp_path: Path) -> None:
    (tmp_path / "pot.dbc").write_text(POT, "utf-8")
    with pytest.raises(InputError, match="is one database, but the bench has 3"):
        with_database(sensor_bench(), tmp_path / "pot.dbc")


def test_a_motion_ratio_makes_wheel_travel_of_sensor_travel() -> None:
    text = TEXT.replace(
        'signal = "pot_fl.Position"', 'signal = "pot_fl.Position"\nmotion_ratio = 0.5\ntare = 0.1'
    )
    bench = parse_bench(text, "bench.toml", Path(), STORED)
    mapped, _ = bench_mapping(bench, bench_codec(bench))
    (pot,) = [m for m in mapped if m.channel.name == "pot_fl"]
    t_ns, good = np.zeros(2, np.int64), np.zeros(2, np.uint8)
    samples = Samples("pot_fl.TPDO1.Position", t_ns, np.array([10.0, 20.0]), good)  # mm
    np.testing.assert_allclose(pot.values(samples), [0.02 - 0.1, 0.04 - 0.1])
    assert pot.step == pytest.approx(2e-5)  # 0.01 mm of the sensor are 0.02 mm of the wheel


def test_a_signal_that_two_messages_of_a_sensor_have_is_asked_for_in_full() -> None:
    twice = IMU.replace("GyrX", "AccX").replace("deg/s", "g")
    text = TEXT.replace("imu_a.GyrX", "imu_a.AccX")
    with pytest.raises(InputError, match=r"imu_a\.AccX is in imu_a\.Accel and in imu_a\.Rate"):
        parse_bench(text, "bench.toml", Path(), stored_text({**DATABASES, "imu.dbc": twice}))


def test_a_bench_on_several_buses_is_put_on_that_of_the_channel_or_of_its_sensors() -> None:
    with pytest.raises(InputError, match=r"here sensors are on 2 \(change the \[\[bus\]\] of "):
        on_bus(sensor_bench(), "socketcan", "can5")
    two = '[[bus]]\nchannel = "a"\n[[bus]]\nchannel = "b"\nbitrate = 250000\n'
    on_b = parse_bench(two + '[[sensor]]\nname = "s"\ndbc = "s.dbc"\nbus = "b"\n', "b", Path(), "")
    for bench, name, bitrate in (
        (parse_bench(two, "b", Path(), ""), "b", 250_000), (on_b, "c", 250_000), (on_b, "a", 1e6),
    ):  # fmt: skip
        assert [bus.bitrate for bus in on_bus(bench, None, name).buses] == [bitrate]


def test_a_channel_of_a_ready_map_is_edited() -> None:
    text = '[[sensor]]\nname = "imu"\nlayout = "xsens_mti"\n' + channel("x", "b.c", "unused")
    text = text.replace("[[channel]]", '[[sensor]]\nname = "b"\ndbc = "b.dbc"\n\n[[channel]]')
    edited = with_channel(text, "imu_body_acc_z", sign=-1, tare=9.8)
    bench = parse_bench(edited, "bench.toml", Path(), "")
    (changed,) = [c for c in bench.channels if c.name == "imu_body_acc_z"]
    assert (changed.sign, changed.tare, changed.signal) == (-1, 9.8, "imu.Acceleration.acc_z")
    assert with_channel(TEXT, "pot_fr", sign=-1).count("sign = -1") == TEXT.count("sign = -1") + 1


def test_a_damaged_list_of_databases_is_one_line() -> None:
    for text in ("{", '{"bumpbench_databases": 3}', "{}"):
        with pytest.raises(InputError, match="the list of databases is damaged"):
            stored_databases(text)
