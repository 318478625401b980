"""A bench that is a list of sensors: databases, buses, identifiers, names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import bench_codec, load_bench, on_bus, parse_bench, with_database
from daq.bench.edit import with_channel
from daq.bench.sensors import Database, stored_databases, stored_text
from daq.errors import InputError
from daq.samples.mapping import bench_mapping
from dbc import Samples

from ..sensor_bench import DATABASES, IMU, POT, TEXT, channel, sensor_bench

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
    assert {each.name: each.text for each in stored_databases(bench.dbc_text)} == {
        "imu.dbc": IMU,
        "hubs.dbc": DATABASES[1].text,
        "pot.dbc": POT,
    }
    again = parse_bench(bench.text, "the journal's", Path("/nowhere"), bench.dbc_text)
    assert again.channels == bench.channels
    assert bench_codec(again) == bench_codec(bench)


def test_files_are_read_beside_the_bench(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(TEXT, "utf-8")
    for each in DATABASES:
        (tmp_path / each.name).write_text(each.text, "utf-8")
    assert load_bench(tmp_path / "bench.toml").dbc_text == sensor_bench().dbc_text
    (tmp_path / "pot.dbc").unlink()
    with pytest.raises(InputError, match=r"pot\.dbc"):
        load_bench(tmp_path / "bench.toml")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t: t.replace('bus = "rear"', 'bus = "can7"', 1), "sensor imu_b is on bus can7"),
        (lambda t: t.replace('bus = "rear"', "bus = 2", 1), "sensor imu_b is on bus 2"),
        (lambda t: t.replace('bus = "rear"\n', "", 1), "sensor imu_b states no bus, and there"),
        (lambda t: t.replace('name = "imu_b"', 'name = "imu_a"', 1), "sensor imu_a occurs twice"),
        (
            lambda t: t.replace('dbc = "hubs.dbc"', ""),
            "sensor.2: a sensor has either dbc or layout",
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


def test_a_corrected_database_takes_the_place_of_its_namesake(tmp_path: Path) -> None:
    (tmp_path / "pot.dbc").write_text(POT.replace("(0.01,0)", "(0.02,0)"), "utf-8")
    (tmp_path / "foreign.dbc").write_text(POT, "utf-8")
    bench = with_database(sensor_bench(), tmp_path / "pot.dbc")
    pot = bench_codec(bench).message("pot_rr.TPDO1").signal("Position")
    assert pot.factor == 0.02
    assert bench_codec(bench).message("imu_b.Accel").bus == 1
    with pytest.raises(InputError, match="none of the 3 databases of the bench has this file name"):
        with_database(sensor_bench(), tmp_path / "foreign.dbc")


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
        parse_bench(
            text, "bench.toml", Path(), stored_text((Database("imu.dbc", twice), *DATABASES[1:]))
        )


def test_a_bench_on_several_buses_is_not_put_on_one() -> None:
    with pytest.raises(InputError, match=r"here sensors are on 2 \(change the \[\[bus\]\] of "):
        on_bus(sensor_bench(), "socketcan", "can5")


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
