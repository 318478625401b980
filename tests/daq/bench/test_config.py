"""What bench.toml may say of channels and messages; every mistake is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.bench.campaign import Method
from daq.bench.channel_map import load_channel_map
from daq.bench.config import Bench, bench_codec, load_bench, parse_bench
from daq.runs import Excitation
from daq.samples.mapping import map_channels
from daq.vehicle import Structure
from dbc.words import InputError

from ..small_campaign import frames_at

DBC = """VERSION ""
BU_: A B
BO_ 16 Acc: 4 A
 SG_ up : 0|16@1- (0.01,0) [0|0] "" A
 SG_ count : 16|4@1+ (1,0) [0|0] "" A
 SG_ half : 20|4@1+ (0.5,0) [0|0] "" A
 SG_ crc : 24|8@1+ (1,0) [0|0] "" A
BO_ 17 Stamp: 5 B
 SG_ ticks : 0|32@1+ (1,0) [0|0] "us" A
 SG_ count : 32|4@1+ (1,0) [0|0] "" A
 SG_ signed : 36|4@1- (1,0) [0|0] "" A
BO_ 18 Slow: 8 B
 SG_ real : 0|32@1- (1,0) [0|0] "s" A
 SG_ speed : 32|16@1- (1,0) [0|0] "m/s" A
 SG_ wide : 48|16@1+ (1,0) [0|0] "" A
SIG_VALTYPE_ 18 real : 1;
"""

CHANNEL = """
[[channel]]
name = "z"
signal = "Acc.up"
signal_unit = "g"
quantity = "body_acceleration"
serial_number = "A-17"
calibrated = 2026-03-01
"""


def _parse(text: str) -> object:
    bench = parse_bench(text + CHANNEL, "bench.toml", Path(), DBC)
    codec = bench_codec(bench)
    map_channels(bench.channels, codec.messages, "car.dbc")
    return bench


def _message(name: str, *lines: str) -> str:
    return "\n".join([f'[[message]]\nname = "{name}"', *lines, ""])


def _set(name: str, message: str, bound_by: str) -> str:
    return f'[[sample_set]]\nname = "{name}"\nmessages = ["{message}"]\nbound_by = "{bound_by}"\n'


def _channel(quantity: str, *lines: str) -> str:
    given = ["[[channel]]", 'name = "a"', 'signal = "Acc.up"', f'quantity = "{quantity}"', *lines]
    return "\n".join([*given, ""])


def test_a_bench_may_add_what_the_dbc_does_not_say() -> None:
    text = _message(
        "Acc", "cycle_ms = 5", 'counter = "count"', "counter_modulus = 15", 'crc = "crc"',
        'crc_rule = "crc8_8h2f"',
    ) + "[calibration]\nmax_age_days = 100\n"  # fmt: skip
    bench = parse_bench(text + CHANNEL, "bench.toml", Path(), DBC)
    (channel,) = bench.channels
    assert (channel.serial_number, channel.calibrated) == ("A-17", "2026-03-01")
    assert bench.calibration.max_age_days == 100
    acc = bench_codec(bench).message("Acc")
    assert acc.cycle_s == 0.005
    assert acc.counter is not None
    assert (acc.counter.signal, acc.counter.modulus) == ("count", 15)
    assert (acc.crc, acc.crc_rule) == ("crc", "crc8_8h2f")


@pytest.mark.parametrize(
    ("lines", "structure", "elements"),
    [
        ("", (True, False, False, False), {}),
        ("symmetric = false", (False, False, False, False), {}),
        (
            "anti_roll_bars = true\nfriction = true\nbump_stops = false",
            (True, True, False, False),
            {"anti_roll_bars": True, "friction": True, "bump_stops": False},
        ),
        ("tyre_damping = true", (True, False, True, False), {"tyre_damping": True}),
        ("cg_offset = true", (True, False, False, True), {"cg_offset": True}),
    ],
)
def test_an_element_that_is_not_stated_is_neither_forced_nor_forbidden(
    lines: str, structure: tuple[bool, ...], elements: dict[str, bool]
) -> None:
    text = f"[vehicle.structure]\n{lines}\n{CHANNEL}"
    vehicle = parse_bench(text, "bench.toml", Path(), DBC).vehicle
    assert vehicle.structure == Structure(*structure)
    assert vehicle.elements == elements


MISTAKES = {
    "nosuch message": (_message("Nosuch"), "message Nosuch: is not in"),
    "nosuch counter": (_message("Acc", 'counter = "x"'), "message Acc: has no signal x"),
    "scaled counter": (_message("Acc", 'counter = "half"'), "half is not a plain unsigned"),
    "signed counter": (_message("Stamp", 'counter = "signed"'), "signed is not a plain unsigned"),
    "long counter": (
        _message("Acc", 'counter = "count"', "counter_modulus = 17"),
        "of 4 bits cannot run to 17",
    ),
    "crc rule": (_message("Acc", 'crc = "crc"', 'crc_rule = "md5"'), "is none of crc8_j1850"),
    "crc of a nibble": (_message("Acc", 'crc = "count"'), "count is not one whole byte"),
    "crc of two bytes": (_message("Slow", 'crc = "wide"'), "wide is not one whole byte"),
    "time is no time": (_message("Slow", 'time_signal = "speed"'), "'m/s', not one of time"),
    "time unit": (
        _message("Acc", 'time_signal = "up"', 'time_unit = "fortnight"'),
        "unit 'fortnight', not one of time",
    ),
    "float time": (_message("Slow", 'time_signal = "real"'), "a float, whose bits set no wrap"),
    "twice": (_message("Acc") + _message("Acc"), "message Acc occurs twice"),
    "cycle": (_message("Acc", "cycle_ms = 0"), "message.Acc.cycle_ms"),
    "unknown key": (_message("Acc", "colour = 1"), "unknown key message.Acc.colour"),
    "set of nothing": ('[[sample_set]]\nname = "s"\nmessages = []\nbound_by = "x"\n', "messages"),
    "set message": (_set("s", "No", "Stamp.ticks"), "sample set s: the DBC has no message No"),
    "set signal": (_set("s", "Acc", "Stamp.x"), "message Stamp: has no signal x"),
    "set role": (_set("s", "Acc", "Stamp.ticks"), "neither the counter nor the time_signal"),
    "set cycle": (
        _message("Acc", 'counter = "count"') + _set("s", "Acc", "count"),
        "Acc has no cycle time",
    ),
    "two sets": (
        _message("Stamp", 'time_signal = "ticks"')
        + _set("s", "Acc", "Stamp.ticks") + _set("t", "Acc", "Stamp.ticks"),
        "sample set t: Acc is also in s",
    ),
    "calibration": ('[calibration]\nmax_age_days = 0\n', "calibration.max_age_days"),
    "calibrated": (_channel("unused", 'calibrated = "May"'), "calibrated is not a day"),
    "calibrated when": (
        _channel("unused", "calibrated = 2026-01-01T10:00:00"),
        "channel.a: calibrated is not a day",
    ),
    "unit of another kind": (
        _channel("body_acceleration", 'signal_unit = "mm"'), "has unit 'mm' in its [[channel]]",
    ),
    "no unit": (_channel("pitch_rate"), "has unit '' in car.dbc"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name: str) -> None:
    text, reason = MISTAKES[name]
    with pytest.raises(InputError) as caught:
        _parse(text)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.advice


# A mistake in bench.toml is named with its key ----------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[campaign]\nrepeat = 1\n", "b.toml: unknown key campaign.repeat (remove it or"),
        ("\n[campain]\n", "b.toml: unknown key campain (remove it or correct its name)"),
        ("[campaign]\nexcitations = [\n 'bounce', 'pich',\n]\n", "excitations.2: must be"),
        ("[campaign]\nrepeats = 'two'\n", "b.toml: campaign.repeats: must be a valid integer ("),
        ("[[weigh]]\nmass_kg = 1.0\n[[weigh]]\n", "b.toml: unknown key weigh ("),
        ("[[weight]]\nhub = 'FL'\nmass_kgg = 1.0\n", "b.toml: unknown key weight.1.mass_kgg ("),
        ("[[weight]]\nhub = 'FL'\n", "b.toml: weight.1.mass_kg is missing (state it)"),
        ("[bus]\nchanel = 'can0'\n", "b.toml: unknown key bus.chanel ("),
        ("[[sensor]]\nnam = 'a'\ndbc = 'a.dbc'\n", "b.toml: unknown key sensor.1.nam ("),
        ("[[sensor]]\nname = 'a'\nbus_position = 1\n", "unknown key sensor.a.bus_position ("),
        ("[campaign]\nmass_states = ['a']\n", "b.toml: unknown key campaign.mass_states ("),
        *(
            (f"{name} = 'real'\n", f"b.toml: unknown key {name} (")
            for name in ("text", "where", "dbc_name", "dbc_text", "origin", "weights", "channels")
        ),
        ("[bus]\nchannel =\n", "b.toml:2: is not TOML: Invalid value, column 10 (correct"),
    ],
)
def test_the_key_of_a_mistake_is_said(text: str, said: str) -> None:
    with pytest.raises(InputError) as reported:
        parse_bench(text, "b.toml", Path())
    assert said in str(reported.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('\ndbc = "gone.dbc"', "{}/gone.dbc: No such file or directory"),
        ('dbc = "folder"', "{}/folder: Is a directory"),
        ('dbc = "layout:nix"', "layout:nix: there is no such layout"),
        (
            '[[sensor]]\nname = "a"\ndbc = "a.dbc"\n\n[[sensor]]\nname = "b"\ndbc = "gone.dbc"',
            "{}/gone.dbc: No such file or directory",
        ),
        ('[[sensor]]\nname = "a"\nlayout = "nix"', "layout:nix: there is no such layout"),
        ('[[sensor]]\nname = "a"\ndbc = "layout:nix"', "layout:nix: there is no such layout"),
    ],
)
def test_a_file_that_the_bench_names_and_that_cannot_be_read_is_named(
    tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.dbc").write_text('VERSION ""\n', "ascii")
    bench = tmp_path / "my.toml"
    bench.write_text(text, "ascii")
    with pytest.raises(InputError) as caught:
        load_bench(bench)
    assert str(caught.value).startswith(f"{said.format(tmp_path)} (")


def test_the_checksum_rule_of_the_bench_decides_which_frames_count() -> None:
    text = _message("Acc", 'crc = "crc"', 'crc_rule = "xor8"')
    codec = bench_codec(parse_bench(text + CHANNEL, "b", Path(), DBC))
    data = np.zeros((2, 8), np.uint8)
    data[:, :4] = [[1, 2, 4, 7], [1, 2, 4, 6]]
    decoded = codec.decode(frames_at(np.arange(2), data, 16, 4))
    assert decoded.counts.crc_bad == 1
    assert (decoded["Acc.up"].quality != 0).tolist() == [False, True]
    sent = codec.encode("Acc", {"up": np.array([5.13])})
    assert sent[0, 3] == sent[0, 0] ^ sent[0, 1] ^ sent[0, 2]


def test_a_unit_stated_for_a_signal_takes_the_place_of_that_of_the_dbc() -> None:
    bench = parse_bench(CHANNEL, "b", Path(), DBC)
    (mapped,) = map_channels(bench.channels, bench_codec(bench).messages, "car.dbc")
    assert (mapped.channel.unit, mapped.factor) == ("m/s2", 9.80665)


# Every number and text from both sides of its limits; what it is if not stated --------------------


def parse(text: str) -> Bench:
    return parse_bench(text, "bench.toml", Path(), "")


A_CHANNEL = '[[channel]]\nname = "a"\nsignal = "IMU_Accel.acc_z"\nquantity = "{}"\n'
UNUSED = A_CHANNEL.format("unused")
TRAVEL = A_CHANNEL.format("suspension_travel") + 'corner = "FL"\n'
BUS = "[bus]\n"
SENSOR = '[[sensor]]\nname = "a"\n'
MESSAGE = '[[message]]\nname = "M"\n'
HUB = '[[weight]]\nhub = "FL"\nmass_kg = 4.0\n'
PLACED = "[[weight]]\nmass_kg = 30\nx_m = 0\ny_m = 0\n"
GEOMETRY = "[vehicle.geometry]\nb_m = 1.5\nt_f_m = 0.7\nt_r_m = 0.7\n"
FACT = '[[fact]]\nquantity = "total_mass_kg"\nvalue = 1500.0\n'


def text(length: int) -> str:
    return '"' + "a" * length + '"'


@pytest.mark.parametrize(
    ("before", "key", "accepted", "refused"),
    [
        (BUS, "bitrate", ("1", "1000000"), ("0", "1000001")),
        (BUS, "name", (text(60),), (text(61),)),
        (SENSOR + 'dbc = "a.dbc"\n', "bus", ("0",), ("-1",)),
        ("[campaign]\n", "bump_s", ("0.001", "10.0"), ("0.0", "10.1")),
        (PLACED.replace("mass_kg = 30\n", ""), "mass_kg", ("0.001", "10000.0"), ("0.0", "10001.0")),
        (PLACED.replace("x_m = 0\n", ""), "x_m", ("-20.0", "20.0"), ("-20.1", "1250.0")),
        (PLACED.replace("y_m = 0\n", ""), "y_m", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (PLACED, "height_m", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (PLACED, "position_sigma_m", ("0.0", "1.0"), ("-0.1", "5.0")),
        (GEOMETRY, "a_m", ("0.1", "20.0"), ("0.0", "1250.0")),
        (UNUSED, "x_m", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (UNUSED, "y_m", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (UNUSED, "position_sigma_m", ("0.0", "1.0"), ("-0.1", "1.1")),
        (UNUSED, "delay_s", ("-1.0", "1.0"), ("-1.1", "2.5")),
        (UNUSED, "delay_sigma_s", ("0.0", "1.0"), ("-0.1", "1.1")),
        ("[trigger]\n", "level", ("0.001", "1000.0"), ("0.0", "1001.0")),
        ("[trigger]\n", "pre_s", ("0.1", "60.0"), ("0.09", "60.1")),
        ("[trigger]\n", "post_s", ("0.5", "600.0"), ("0.49", "601.0")),
        ("[trigger]\n", "rest_s", ("0.05", "60.0"), ("0.049", "60.1")),
        ("[recorder]\n", "segment_mb", ("1.0", "4096.0"), ("0.9", "4097.0")),
        ("[recorder]\n", "segment_minutes", ("0.1", "1440.0"), ("0.09", "1441.0")),
        ("[recorder]\n", "keep_gb", ("0.1", "1e9"), ("0.09",)),
        ("[recorder]\n", "reserve_mb", ("1.0", "1e9"), ("0.9",)),
        ("[recorder]\n", "silent_s", ("0.1", "60.0"), ("0.09", "60.1")),
        (HUB, "sigma_kg", ("0.0", "9.0"), ("-0.1",)),
        (FACT, "sigma", ("0.001",), ("0.0", "-1.0")),
        (UNUSED, "signal_unit", (text(16),), (text(17),)),
        (UNUSED, "sign", ("1", "-1"), ("0", "2")),
        (UNUSED, "gain", ("0.001", "1e6"), ("0.0", "-1.0")),
        (UNUSED, "gain_sigma", ("0.0", "0.3"), ("-0.1", "0.31")),
        (UNUSED, "low_pass_hz", ("0.0", "1e4"), ("-1.0",)),
        (UNUSED, "low_pass_order", ("1", "8"), ("0", "9")),
        (UNUSED, "serial_number", (text(60),), (text(61),)),
        (UNUSED, "tare", ("-1e9", "1e9"), ("nan", "inf")),
        (TRAVEL, "motion_ratio", ("0.001", "10.0"), ("0.0", "10.1")),
        (TRAVEL + "motion_ratio = 0.6\n", "motion_ratio_sigma", ("0.0", "0.19"), ("-0.1", "0.21")),
        (MESSAGE, "cycle_ms", ("0.001", "1e6"), ("0.0", "-1.0")),
        (MESSAGE + 'counter = "c"\n', "counter_modulus", ("2", "4294967296"), ("1", "4294967297")),
        (MESSAGE + 'time_signal = "t"\n', "time_unit", (text(16),), (text(17),)),
        (MESSAGE + 'time_signal = "t"\n', "time_wrap", ("0.001",), ("0.0",)),
        ("[calibration]\n", "max_age_days", ("1", "100000"), ("0",)),
        ("[campaign]\n", "excitations", ('["roll"]',), ("[]",)),
        ("[campaign]\n", "repeats", ("1", "100"), ("0", "101")),
        ("[campaign]\n", "bump_height_mm", ("0.1", "200.0"), ("0.09", "200.1")),
        ("[campaign]\n", "accept_after_s", ("0.0", "60.0"), ("-0.01", "60.1")),
        ("[campaign.instructions]\n", "roll", (text(200),), (text(201),)),
    ],
)  # fmt: skip
def test_a_number_or_a_text_has_its_limits(
    before: str, key: str, accepted: tuple[str, ...], refused: tuple[str, ...]
) -> None:
    for value in accepted:
        parse(f"{before}{key} = {value}\n")
    for value in refused:
        with pytest.raises(InputError, match=key):
            parse(f"{before}{key} = {value}\n")


@pytest.mark.parametrize(
    ("written", "why"),
    [
        (SENSOR, "either dbc or layout"),
        (SENSOR + 'dbc = "a.dbc"\nlayout = "x"\n', "either dbc or layout"),
        (
            SENSOR + 'dbc = "a.dbc"\nid_offset = 1\nids = { M = 5 }\n',
            "either id_offset or ids",
        ),
        (SENSOR + 'dbc = "a.dbc"\nids = { M = -5 }\n', "ids"),
        ('[[weight]]\nmass_kg = 4.0\n', "either x_m and y_m, or hub"),
        ('[[weight]]\nmass_kg = 4.0\nx_m = 0.0\n', "either x_m and y_m, or hub"),
        ('[[weight]]\nmass_kg = 4.0\ny_m = 0.0\n', "either x_m and y_m, or hub"),
        (HUB + "x_m = 0.0\ny_m = 0.0\n", "either x_m and y_m, or hub"),
        (HUB + "x_m = 0.0\n", "either x_m and y_m, or hub"),
        (HUB + "y_m = 0.0\n", "either x_m and y_m, or hub"),
        ("[[weight]]\nmass_kg = true\n", "mass_kg: is true or false"),
        ("[campaign]\nrepeats = true\n", "repeats: is true or false"),
        ('[vehicle]\nname = "a\\u0000b"\n', "name: has the character NUL"),
        (UNUSED + 'serial_number = "' + 33 * "ä" + '"\n', "serial_number more than 64"),
        (UNUSED.replace("IMU_Accel.acc_z", 129 * "x"), "more than 128 bytes"),
        (HUB + "position_sigma_m = 0.1\n", "for a weight on the body"),
        (A_CHANNEL.format("suspension_travel"), "suspension_travel needs a corner"),
        (A_CHANNEL.format("hub_displacement"), "hub_displacement needs a corner"),
        (A_CHANNEL.format("pitch_rate") + 'corner = "FL"\n', "pitch_rate has no corner"),
        (UNUSED.replace('signal = "IMU_Accel.acc_z"\n', ""), "channel.a: it states no signal"),
        (UNUSED + "motion_ratio = 0.9\n", "motion_ratio is for suspension_travel"),
        (UNUSED + "motion_ratio_sigma = 0.1\n", "motion_ratio is for suspension_travel"),
        ('[[bus]]\nchannel = "a"\n[[bus]]\nchannel = "a"\n', "bus virtual a occurs twice"),
        (
            '[[bus]]\nchannel = "a"\ninterface = "x"\n'
            '[[bus]]\n[[bus]]\nchannel = "a"\ninterface = "x"\n',
            "bus x a occurs twice",
        ),
        ('[campaign]\nexcitations = ["roll", "pitch", "roll"]\n', "bump roll occurs twice"),
        ('[[fact]]\nquantity = "total_mass_kg"\nvalue = 0\nsigma = 1\n', "is 0 .state a value"),
        ('[[fact]]\nquantity = "k_sf"\nvalue = -1\nsigma = 1\n', "k_sf: is -1"),
        ("bus = []\n", "bus"),
        ('[[bus]]\n' * 17, "bus"),
    ],
)  # fmt: skip
def test_what_excludes_each_other_is_refused(written: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        parse(written)


def test_what_a_bench_is_if_nothing_is_stated() -> None:
    bench = parse("")
    assert (bench.buses[0].interface, bench.buses[0].channel) == ("virtual", "bumpbench")
    assert (bench.buses[0].bitrate, bench.buses[0].name) == (1_000_000, "")
    trigger = bench.trigger
    assert (trigger.level, trigger.pre_s, trigger.post_s, trigger.rest_s) == (3.0, 1.0, 2.5, 0.3)
    assert bench.campaign.excitations == (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    assert (bench.campaign.repeats, bench.campaign.bump_s) == (2, 0.2)
    assert bench.campaign.method is Method.ROLL_OVER
    assert bench.campaign.bump_height_m == pytest.approx(0.04)
    assert bench.campaign.accept_after_s == 3.0
    recorder = bench.recorder
    assert (recorder.segment_bytes, recorder.segment_s) == (64e6, 900.0)
    assert (recorder.keep_bytes, recorder.reserve_bytes) == (100e9, 200e6)
    assert recorder.silent_s == 1.0
    assert bench.calibration.max_age_days == 365
    (channel,) = parse(UNUSED).channels
    assert (channel.sign, channel.gain, channel.tare, channel.motion_ratio) == (1, 1.0, 0.0, 1.0)
    assert (channel.delay_s, channel.low_pass_hz, channel.low_pass_order) == (0.0, 0.0, 2)
    assert (channel.x_m, channel.y_m, channel.position_sigma_m) == (0.0, 0.0, 0.0)


MAP = '[[channel]]\nname = "a"\nsignal = "A"\nquantity = "unused"\n'
RUN = '[[run]]\nmass_state = "baseline"\nexcitation = "roll"\nstart_s = 10.0\n'


@pytest.mark.parametrize(
    ("written", "why"),
    [
        (MAP + 'time_column = "t"\nrate_hz = 100.0\n', "either time_column or rate_hz"),
        ('[time]\ncolumn = "t"\nrate_hz = 100.0\n' + MAP, "either column or rate_hz"),
        (MAP + RUN + "stop_s = 10.0\n", "after start_s"),
        (MAP + RUN + "stop_s = 9.0\n", "after start_s"),
        (MAP + RUN + "stop_s = 3610.1\n", "after start_s"),
        (MAP + RUN.replace("baseline", "moon") + "stop_s = 11.0\n", "run.1.mass_state: must be"),
        ("[[chanel]]\n", "unknown key chanel"),
        ("[bus]\n" + MAP, "unknown key bus"),
        (MAP + "rate_hz = 0.0\n", "rate_hz"),
        (MAP + "rate_hz = 1.1e7\n", "rate_hz"),
        (MAP + f"time_unit = {text(17)}\n", "time_unit"),
        (f"[time]\nunit = {text(17)}\n" + MAP, "unit"),
        (MAP.replace('"A"', '""'), "signal"),
        (MAP.replace('"A"', text(121)), "signal"),
        ("", "channel"),
    ],
)
def test_what_a_channel_map_may_not_say(tmp_path: Path, written: str, why: str) -> None:
    path = tmp_path / "map.toml"
    path.write_text(written, "utf-8")
    with pytest.raises(InputError, match=why):
        load_channel_map(path)


def test_what_a_channel_map_says(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    more = MAP.replace('"a"', '"b"').replace('"A"', text(120)) + 'time_column = "u"\n'
    more += "x_m = -1.25\nposition_sigma_m = 0.01\ndelay_s = 0.002\n"
    third = MAP.replace('"a"', '"c"').replace('"A"', '"C"') + "rate_hz = 1e7\n"
    path.write_text(
        '[time]\ncolumn = "t"\nunit = "ms"\n' + MAP + more + third + RUN + "stop_s = 3610.0\n",
        "utf-8",
    )
    found = load_channel_map(path)
    first, second, last = (found.clock(channel) for channel in found.channels)
    assert (first.column, first.unit, first.rate_hz) == ("t", "ms", None)
    assert (second.column, second.unit, second.rate_hz) == ("u", "ms", None)
    assert (last.column, last.rate_hz) == ("", 1e7)
    placed = found.channels[1]
    assert (placed.x_m, placed.position_sigma_m, placed.delay_s) == (-1.25, 0.01, 0.002)
    assert found.columns == ("A", "a" * 120, "C", "t", "u")
    ((step, *span_s),) = found.runs
    assert (step.label, span_s) == ("baseline_roll_1", [10.0, 3610.0])


def test_a_channel_has_a_name_of_sixty_letters_at_most_and_a_sensor_one_of_thirty() -> None:
    sensor = SENSOR + 'dbc = "a.dbc"\n'
    for written, most in ((UNUSED, 60), (sensor, 30)):
        parse(written.replace('"a"', text(most)))
        with pytest.raises(InputError, match="name"):
            parse(written.replace('"a"', text(most + 1)))
