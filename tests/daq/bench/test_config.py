"""What bench.toml may say of channels and messages; every mistake is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import bench_codec, load_bench, parse_bench
from daq.errors import InputError
from daq.samples.mapping import map_channels
from daq.session import read_session, write_session
from daq.vehicle import Structure
from dbc.frames import FrameBatch

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


def test_a_bench_may_add_what_the_dbc_does_not_say() -> None:
    text = _message(
        "Acc", "cycle_ms = 5", 'counter = "count"', "counter_modulus = 15", 'crc = "crc"',
        'crc_rule = "crc8_8h2f"',
    ) + "[calibration]\nmax_age_days = 100\n"  # fmt: skip
    bench = parse_bench(text + CHANNEL, "bench.toml", Path(), DBC)
    (channel,) = bench.channels
    assert (channel.serial_number, channel.calibrated) == ("A-17", "2026-03-01")
    assert bench.calibration_days == 100
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
    "lone modulus": (_message("Acc", "counter_modulus = 3"), "says nothing without counter"),
    "lone rule": (_message("Acc", 'crc_rule = "xor8"'), "crc_rule says nothing without crc"),
    "crc rule": (_message("Acc", 'crc = "crc"', 'crc_rule = "md5"'), "is none of crc8_j1850"),
    "crc of a nibble": (_message("Acc", 'crc = "count"'), "count is not one whole byte"),
    "crc of two bytes": (_message("Slow", 'crc = "wide"'), "wide is not one whole byte"),
    "time is no time": (_message("Slow", 'time_signal = "speed"'), "the unit 'm/s', not of time"),
    "time unit": (
        _message("Acc", 'time_signal = "up"', 'time_unit = "fortnight"'),
        "unknown unit 'fortnight'",
    ),
    "float time": (_message("Slow", 'time_signal = "real"'), "a float, whose bits set no wrap"),
    "twice": (_message("Acc") + _message("Acc"), "message Acc occurs twice"),
    "cycle": (_message("Acc", "cycle_ms = 0"), "message.0.cycle_ms"),
    "unknown key": (_message("Acc", "colour = 1"), "unknown key message.0.colour"),
    "set of nothing": ('[[sample_set]]\nname = "s"\nmessages = []\nbound_by = "x"\n', "messages"),
    "set message": (
        '[[sample_set]]\nname = "s"\nmessages = ["No"]\nbound_by = "Stamp.ticks"\n',
        "sample set s: the DBC has no message No",
    ),
    "set signal": (
        '[[sample_set]]\nname = "s"\nmessages = ["Acc"]\nbound_by = "Stamp.x"\n',
        "message Stamp: has no signal x",
    ),
    "set role": (
        '[[sample_set]]\nname = "s"\nmessages = ["Acc"]\nbound_by = "Stamp.ticks"\n',
        "neither the counter nor the time_signal",
    ),
    "set cycle": (
        _message("Acc", 'counter = "count"')
        + '[[sample_set]]\nname = "s"\nmessages = ["Acc"]\nbound_by = "count"\n',
        "Acc has no cycle time",
    ),
    "two sets": (
        _message("Stamp", 'time_signal = "ticks"')
        + '[[sample_set]]\nname = "s"\nmessages = ["Acc"]\nbound_by = "Stamp.ticks"\n'
        + '[[sample_set]]\nname = "t"\nmessages = ["Acc"]\nbound_by = "Stamp.ticks"\n',
        "sample set t: Acc is also in s",
    ),
    "calibration": ('[calibration]\nmax_age_days = 0\n', "calibration.max_age_days"),
    "calibrated": (
        '[[channel]]\nname = "a"\nsignal = "Acc.up"\nquantity = "unused"\ncalibrated = "May"\n',
        "calibrated is not a day",
    ),
    "calibrated when": (
        '[[channel]]\nname = "a"\nsignal = "Acc.up"\nquantity = "unused"\n'
        "calibrated = 2026-01-01T10:00:00\n",
        "channel.0.calibrated: must be a valid string",
    ),
    "unit of another kind": (
        '[[channel]]\nname = "a"\nsignal = "Acc.up"\nsignal_unit = "mm"\n'
        'quantity = "body_acceleration"\n',
        "has unit 'mm' in its [[channel]]",
    ),
    "no unit": (
        '[[channel]]\nname = "a"\nsignal = "Acc.up"\nquantity = "pitch_rate"\n',
        "has unit '' in car.dbc",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name: str) -> None:
    text, reason = MISTAKES[name]
    with pytest.raises(InputError) as caught:
        _parse(text)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.advice


# A mistake in bench.toml is named with its line and the nearest name that there is ----------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[campaign]\nrepeat = 1\n",
            "b.toml:2: unknown key campaign.repeat"
            " (remove it or correct its name; did you mean repeats?)",
        ),
        (
            "\n[campain]\n",
            "b.toml:2: unknown key campain (remove it or correct its name; did you mean campaign?)",
        ),
        (
            "[campaign]\nrepeats = 2\nexcitations = [\n  'bounce', 'pich',\n]\n",
            "did you mean pitch?)",
        ),
        ("[campaign]\nrepeats = 'two'\n", "b.toml:2: campaign.repeats: must be a valid integer ("),
        (
            "\n[[weigh]]\nmass_kg = 1.0\n[[weigh]]\n",
            "b.toml:2: unknown key weigh (remove it or correct its name; did you mean weight?)",
        ),
        (
            "[[weight]]\nhub = 'FL'\nmass_kgg = 1.0\n",
            "b.toml:3: unknown key weight.0.mass_kgg"
            " (remove it or correct its name; did you mean mass_kg?)",
        ),
        ("[[weight]]\nhub = 'FL'\n", "b.toml:1: weight.0.mass_kg is missing (state it)"),
        (
            "[bus]\nchanel = 'can0'\n",
            "b.toml:2: unknown key bus.0.chanel"
            " (remove it or correct its name; did you mean channel?)",
        ),
        (
            "[campaign]\nhub = 'FL'\n",  # a key of another table
            "b.toml:2: unknown key campaign.hub (remove it: it has no meaning here)",
        ),
        ("[bus]\nchannel =\n", "b.toml:2: is not TOML: Invalid value, column 10 (correct"),
    ],
)
def test_the_line_and_the_nearest_name_are_said(text: str, said: str) -> None:
    with pytest.raises(InputError) as reported:
        parse_bench(text, "b.toml", Path())
    assert said in str(reported.value)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ('\ndbc = "gone.dbc"', 2, "dbc: {}/gone.dbc: No such file or directory"),
        ('dbc = "folder"', 1, "dbc: {}/folder: not a file"),
        ('dbc = "layout:nix"', 1, "dbc: layout:nix: there is no such layout"),
        (
            '[[sensor]]\nname = "a"\ndbc = "a.dbc"\n\n[[sensor]]\nname = "b"\ndbc = "gone.dbc"',
            7,
            "sensor.1.dbc: {}/gone.dbc: No such file or directory",
        ),
        (
            '[[sensor]]\nname = "a"\nlayout = "nix"',
            3,
            "sensor.0.layout: layout:nix: there is no such layout",
        ),
        (
            '[[sensor]]\nname = "a"\ndbc = "layout:nix"',
            3,
            "sensor.0.dbc: layout:nix: there is no such layout",
        ),
    ],
)
def test_a_file_that_the_bench_names_and_that_cannot_be_read_is_named_with_its_line(
    tmp_path: Path, text: str, line: int, said: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.dbc").write_text('VERSION ""\n', "ascii")
    bench = tmp_path / "my.toml"
    bench.write_text(text, "ascii")
    with pytest.raises(InputError) as caught:
        load_bench(bench)
    assert str(caught.value).startswith(f"{bench}:{line}: {said.format(tmp_path)} (")


# Numbers of bench.toml have a lowest and a highest: most of what lies beyond is a wrong unit ------


WEIGHT = "[[weight]]\nmass_kg = {}\nx_m = {}\ny_m = {}\n"
CHANNEL_OF_CAMPAIGN_LIMITS = (
    '[[channel]]\nname = "a"\nsignal = "IMU_Accel.acc_z"\nquantity = "unused"\n'
)
GEOMETRY = "[vehicle.geometry]\na_m = {}\nb_m = 1.5\nt_f_m = 0.7\nt_r_m = 0.7\n"


@pytest.mark.parametrize(
    ("text", "accepted", "refused"),
    [
        ("[campaign]\nbump_s = {}\n", ("0.001", "10.0"), ("0.0", "10.1")),
        ("[trigger]\nlevel = {}\n", ("0.001", "1000.0"), ("0.0", "1001.0")),
        (WEIGHT.format("{}", 0, 0), ("0.001", "10000.0"), ("0.0", "10001.0")),
        (WEIGHT.format(30, "{}", 0), ("-20.0", "20.0"), ("-20.1", "1250.0")),
        (WEIGHT.format(30, 0, "{}"), ("-20.0", "20.0"), ("-20.1", "20.1")),
        (WEIGHT.format(30, 0, 0) + "height_m = {}\n", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (WEIGHT.format(30, 0, 0) + "position_sigma_m = {}\n", ("0.0", "1.0"), ("-0.1", "5.0")),
        (CHANNEL_OF_CAMPAIGN_LIMITS + "x_m = {}\n", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (CHANNEL_OF_CAMPAIGN_LIMITS + "y_m = {}\n", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (CHANNEL_OF_CAMPAIGN_LIMITS + "position_sigma_m = {}\n", ("0.0", "1.0"), ("-0.1", "1.1")),
        (CHANNEL_OF_CAMPAIGN_LIMITS + "delay_s = {}\n", ("-1.0", "1.0"), ("-1.1", "2.5")),
        (CHANNEL_OF_CAMPAIGN_LIMITS + "delay_sigma_s = {}\n", ("0.0", "1.0"), ("-0.1", "1.1")),
        (GEOMETRY, ("0.1", "20.0"), ("0.0", "1250.0")),
    ],
)
def test_a_number_in_the_wrong_unit_is_refused(
    text: str, accepted: tuple[str, str], refused: tuple[str, str]
) -> None:
    key = text.partition(" = {}")[0].splitlines()[-1]
    for number in accepted:
        parse_bench(text.format(number), "bench.toml", Path())
    for number in refused:
        with pytest.raises(InputError, match=key):
            parse_bench(text.format(number), "bench.toml", Path())


def test_the_checksum_rule_of_the_bench_decides_which_frames_count() -> None:
    text = _message("Acc", 'crc = "crc"', 'crc_rule = "xor8"')
    codec = bench_codec(parse_bench(text + CHANNEL, "b", Path(), DBC))
    data = np.zeros((2, 8), np.uint8)
    data[:, :4] = [[1, 2, 4, 7], [1, 2, 4, 6]]
    n = np.zeros(2)
    frames = FrameBatch(
        np.arange(2), np.full(2, 16, np.uint32), n.astype(np.uint16), n.astype(np.uint8),
        np.full(2, 4, np.uint8), data,
    )  # fmt: skip
    decoded = codec.decode(frames)
    assert decoded.counts.crc_bad == 1
    assert (decoded["Acc.up"].quality != 0).tolist() == [False, True]
    sent = codec.encode("Acc", {"up": np.array([5.13])})
    assert sent[0, 3] == sent[0, 0] ^ sent[0, 1] ^ sent[0, 2]


def test_a_unit_stated_for_a_signal_takes_the_place_of_that_of_the_dbc() -> None:
    bench = parse_bench(CHANNEL, "b", Path(), DBC)
    (mapped,) = map_channels(bench.channels, bench_codec(bench).messages, "car.dbc")
    assert (mapped.channel.unit, mapped.factor) == ("m/s2", 9.80665)


def test_what_is_known_of_a_sensor_goes_into_the_session(tmp_path: Path) -> None:
    from daq.sessions import session_from_arrays

    bench = parse_bench(CHANNEL, "b", Path(), DBC)
    time_s = np.arange(10) * 0.01
    session = session_from_arrays(
        [("baseline", "bounce", {"z": (time_s, np.ones(10))})], channels=bench.channels
    )
    write_session(tmp_path / "s.h5", session)
    (channel,) = read_session(tmp_path / "s.h5").channels
    assert (channel.serial_number, channel.calibrated) == ("A-17", "2026-03-01")
    assert channel.signal_unit == "g"
