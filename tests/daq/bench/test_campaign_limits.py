"""Numbers of bench.toml have a lowest and a highest: most of what lies beyond is a wrong unit."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.bench_tables import campaign_limits
from daq.bench.config import parse_bench
from daq.errors import InputError


@pytest.mark.parametrize(
    ("key", "accepted", "refused", "limits"),
    [
        ("repeats", ("1", "100"), ("0", "101"), (1.0, 100.0, False)),
        ("bump_height_mm", ("0.001", "0.5", "200.0"), ("0.0", "200.1"), (0.0, 200.0, True)),
        ("accept_after_s", ("0.0", "60.0"), ("-0.01", "60.1"), (0.0, 60.0, False)),
    ],
)
def test_numbers_of_a_campaign_have_a_lowest_and_a_highest(
    key: str,
    accepted: tuple[str, ...],
    refused: tuple[str, ...],
    limits: tuple[float, float, bool],
) -> None:
    for number in accepted:
        parse_bench(f"[campaign]\n{key} = {number}\n", "bench.toml", Path())
    for number in refused:
        with pytest.raises(InputError, match=key):
            parse_bench(f"[campaign]\n{key} = {number}\n", "bench.toml", Path())
    assert campaign_limits(key) == limits


WEIGHT = "[[weight]]\nmass_kg = {}\nx_m = {}\ny_m = {}\n"
CHANNEL = '[[channel]]\nname = "a"\nsignal = "IMU_Accel.acc_z"\nquantity = "unused"\n'
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
        (CHANNEL + "x_m = {}\n", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (CHANNEL + "y_m = {}\n", ("-20.0", "20.0"), ("-20.1", "20.1")),
        (CHANNEL + "position_sigma_m = {}\n", ("0.0", "1.0"), ("-0.1", "1.1")),
        (CHANNEL + "delay_s = {}\n", ("-1.0", "1.0"), ("-1.1", "2.5")),
        (CHANNEL + "delay_sigma_s = {}\n", ("0.0", "1.0"), ("-0.1", "1.1")),
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
