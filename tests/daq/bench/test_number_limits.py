"""Every number and text of bench.toml from both sides of its limits; what it is if not stated."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.campaign import Method
from daq.bench.channel_map import load_channel_map
from daq.bench.config import Bench, load_bench, parse_bench
from daq.errors import InputError
from daq.runs import Excitation
from daq.vehicle import Corner, HubWeight


def parse(text: str) -> Bench:
    return parse_bench(text, "bench.toml", Path(), "")


CHANNEL = '[[channel]]\nname = "a"\nsignal = "IMU_Accel.acc_z"\nquantity = "{}"\n'
UNUSED = CHANNEL.format("unused")
TRAVEL = CHANNEL.format("suspension_travel") + 'corner = "FL"\n'
BUS = "[bus]\n"
SENSOR = '[[sensor]]\nname = "a"\n'
MESSAGE = '[[message]]\nname = "M"\n'
HUB = '[[weight]]\nhub = "FL"\nmass_kg = 4.0\n'
FACT = '[[fact]]\nquantity = "total_mass_kg"\nvalue = 1500.0\n'


def text(length: int) -> str:
    return '"' + "a" * length + '"'


@pytest.mark.parametrize(
    ("before", "key", "accepted", "refused"),
    [
        (BUS, "bitrate", ("1", "1000000"), ("0", "1000001")),
        (BUS, "name", (text(60),), (text(61),)),
        (SENSOR + 'dbc = "a.dbc"\n', "bus", ("0",), ("-1",)),
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
        ("[campaign]\n", "bump_height_mm", ("0.001", "200.0"), ("0.0", "200.1")),
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
        (UNUSED + 'serial_number = "' + 33 * "ä" + '"\n', "more than 64 bytes"),
        (UNUSED.replace("IMU_Accel.acc_z", 129 * "x"), "more than 128 bytes"),
        (HUB + "position_sigma_m = 0.1\n", "for a weight on the body"),
        (CHANNEL.format("suspension_travel"), "suspension_travel needs a corner"),
        (CHANNEL.format("hub_displacement"), "hub_displacement needs a corner"),
        (CHANNEL.format("pitch_rate") + 'corner = "FL"\n', "pitch_rate has no corner"),
        (UNUSED + "motion_ratio = 0.9\n", "motion_ratio is for suspension_travel"),
        (UNUSED + "motion_ratio_sigma = 0.1\n", "motion_ratio is for suspension_travel"),
        ('[[bus]]\nchannel = "a"\n[[bus]]\nchannel = "a"\n', "bus virtual a occurs twice"),
        (
            '[[bus]]\nchannel = "a"\ninterface = "x"\n'
            '[[bus]]\n[[bus]]\nchannel = "a"\ninterface = "x"\n',
            "bus x a occurs twice",
        ),
        ("bus = []\n", "bus"),
        ('[[bus]]\n' * 17, "bus"),
    ],
)  # fmt: skip
def test_what_excludes_each_other_is_refused(written: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        parse(written)


@pytest.mark.parametrize(
    ("written", "why"),
    [
        ('[campaign]\nexcitations = ["roll", "pitch", "roll"]\n', "names a kind of bump twice"),
        ('[[fact]]\nquantity = "total_mass_kg"\nvalue = 0\nsigma = 1\n', "is 0 .state a value"),
        ('[[fact]]\nquantity = "k_sf"\nvalue = -1\nsigma = 1\n', "k_sf: is -1"),
    ],
)
def test_a_slip_is_refused_in_a_file_and_read_where_it_was_recorded(
    written: str, why: str, tmp_path: Path
) -> None:
    (tmp_path / "bench.toml").write_text(written)
    with pytest.raises(InputError, match=why):
        load_bench(tmp_path / "bench.toml")
    parse(written)


def test_what_a_bench_is_if_nothing_is_stated() -> None:
    bench = parse("")
    assert (bench.bus.interface, bench.bus.channel) == ("virtual", "bumpbench")
    assert (bench.bus.bitrate, bench.bus.name) == (1_000_000, "")
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
    assert bench.calibration_days == 365
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
    third = MAP.replace('"a"', '"c"').replace('"A"', '"C"') + "rate_hz = 1e7\n"
    path.write_text(
        '[time]\ncolumn = "t"\nunit = "ms"\n' + MAP + more + third + RUN + "stop_s = 3610.0\n",
        "utf-8",
    )
    found = load_channel_map(path)
    first, second, last = (found.clocks[name] for name in "abc")
    assert (first.column, first.unit, first.rate_hz) == ("t", "ms", None)
    assert (second.column, second.unit, second.rate_hz) == ("u", "ms", None)
    assert (last.column, last.rate_hz) == ("", 1e7)
    assert found.columns == ("A", "a" * 120, "C", "t", "u")
    (run,) = found.runs
    assert (run.step.label, run.start_s, run.stop_s) == ("baseline_roll_1", 10.0, 3610.0)


@pytest.mark.parametrize(("length", "refused"), [(60, False), (61, True)])
def test_a_channel_has_a_name_of_sixty_letters_at_most(length: int, refused: bool) -> None:
    written = UNUSED.replace('"a"', text(length))
    if refused:
        with pytest.raises(InputError, match="name"):
            parse(written)
    else:
        assert parse(written).channels[0].name == "a" * length
    sensor = SENSOR.replace('"a"', text(length - 30)) + 'dbc = "a.dbc"\n'
    if refused:
        with pytest.raises(InputError, match="name"):
            parse(sensor)
    else:
        parse(sensor)


def test_a_bar_may_be_negative(tmp_path: Path) -> None:
    """Springs of a solid axle act with a lever in roll."""
    bars = '[vehicle.structure]\nanti_roll_bars = true\n[[fact]]\nquantity = "k_af"\nsigma = 1\n'
    (tmp_path / "bench.toml").write_text(bars + "value = -1\n")
    assert load_bench(tmp_path / "bench.toml").vehicle.facts[0].value == -1.0


def test_what_goes_together_is_taken() -> None:
    two = parse('[[bus]]\nchannel = "a"\n[[bus]]\nchannel = "a"\ninterface = "x"\n')
    assert [(bus.interface, bus.channel) for bus in two.buses] == [("virtual", "a"), ("x", "a")]
    names = "".join(f'[[bus]]\nchannel = "c{n}"\n' for n in range(16))
    assert len(parse(names).buses) == 16
    parse(SENSOR + 'dbc = "a.dbc"\nids = { M = 0 }\n')
    parse(SENSOR + 'dbc = "a.dbc"\nid_offset = 1\n')
    parse(UNUSED.replace("IMU_Accel.acc_z", 128 * "x") + f'serial_number = "{32 * "ä"}"\n')
    (weight,) = parse(HUB + "sigma_kg = 0.1\n").mass_states[1].added.weights
    assert weight == HubWeight(4.0, Corner.FRONT_LEFT, 0.1)
    travel = parse(TRAVEL + "motion_ratio = 0.6\nmotion_ratio_sigma = 0.15\n").channels[0]
    assert (travel.motion_ratio, travel.motion_ratio_sigma) == (0.6, 0.15)


def test_the_recorders_numbers_are_taken_in_their_units() -> None:
    stated = (
        "[recorder]\nsegment_mb = 2.0\nsegment_minutes = 3.0\nkeep_gb = 4.0\nreserve_mb = 5.0\n"
        "silent_s = 6.0\n"
    )
    recorder = parse(stated).recorder
    assert (recorder.segment_bytes, recorder.segment_s) == (2e6, 180.0)
    assert (recorder.keep_bytes, recorder.reserve_bytes) == (4e9, 5e6)
    assert recorder.silent_s == 6.0


def test_a_channel_map_describes_car_campaign_trigger_and_weights(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(
        '[vehicle]\nname = "T5"\n[campaign]\nrepeats = 7\n[trigger]\nlevel = 4.5\n'
        "[calibration]\nmax_age_days = 30\n" + HUB + FACT + "sigma = 2.0\n" + MAP,
        "utf-8",
    )
    bench = load_channel_map(path).bench
    assert (bench.vehicle.name, bench.campaign.repeats, bench.trigger.level) == ("T5", 7, 4.5)
    assert bench.calibration_days == 30
    assert bench.mass_states[1].added.weights == (HubWeight(4.0, Corner.FRONT_LEFT),)
    assert [(fact.value, fact.sigma) for fact in bench.vehicle.facts] == [(1500.0, 2.0)]
