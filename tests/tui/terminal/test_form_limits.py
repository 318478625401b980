"""Both sides of every limit of the forms, and what the weights do to the car, in round numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.config import load_bench
from daq.errors import InputError
from daq.vehicle import (
    FORD_GRANADA,
    BodyWeight,
)
from tui.jobs.gain import Shift
from tui.terminal.screens.vehicle import VEHICLE_FIELDS, check_vehicle, vehicle_values
from tui.terminal.screens.weights import (
    AxleLimits,
    Entry,
    axles_line,
    check_inventory,
    check_weight,
    parse_limits,
    read_limits,
    shift_line,
    with_bolted,
)
from tui.terminal.widgets.form import Field, check_fields

BENCH = load_bench(None)
EMPTY = vehicle_values(BENCH, "MK")
WEIGHT = {"place": "body", "serial": "M-07", "mass_kg": "20", "sigma_kg": "0.01", "x_m": "-0.4",
          "y_m": "0.55", "position_sigma_m": "0.005", "height_m": "0"}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "lowest", "below", "highest", "above"),
    [
        ("total_mass_kg", "100", "99.9", "10000", "10001"),
        ("total_mass_kg.sigma", "0.001", "0.0009", "500", "501"),
        ("front_axle_kg", "40", "39.9", "6000", "6001"),
        ("front_axle_kg.sigma", "0.001", "0.0009", "300", "301"),
        ("rear_axle_kg", "40", "39.9", "6000", "6001"),
        ("rear_axle_kg.sigma", "0.001", "0.0009", "300", "301"),
        ("wheelbase_m", "1", "0.99", "6", "6.01"),
        ("wheelbase_m.sigma", "0.0001", "0.00009", "0.3", "0.31"),
        ("front_track_m", "0.8", "0.79", "2.6", "2.61"),
        ("front_track_m.sigma", "0.0001", "0.00009", "0.13", "0.131"),
        ("rear_track_m", "0.8", "0.79", "2.6", "2.61"),
        ("repeats", "1", "0", "100", "101"),
        ("bump_height_mm", "0.001", "0", "200", "200.1"),
        ("accept_after_s", "0", "-0.1", "60", "60.1"),
        ("name", "T", "", "x" * 60, "x" * 61),
        ("operator", "M", "", "x" * 40, "x" * 41),
        ("notes", "", "\x07", "x" * 500, "x" * 501),
        ("method", "drop", "", "push", "kick"),
        ("flag.cg_offset", "yes", "perhaps", "no", "1"),
        ("bump.warp", "yes", "perhaps", "no", "1"),
    ],
)
def test_a_field_of_the_vehicle_takes_its_limits_and_nothing_beyond(
    name: str, lowest: str, below: str, highest: str, above: str
) -> None:
    for typed in (lowest, highest):
        assert check_vehicle(EMPTY | {name: typed}, BENCH) == ()
    for typed in (below, above):
        assert [error.field for error in check_vehicle(EMPTY | {name: typed}, BENCH)] == [name]


@pytest.mark.parametrize(
    ("name", "lowest", "below", "highest", "above"),
    [
        ("serial", "", "\x07", "x" * 20, "x" * 21),
        ("mass_kg", "0.1", "0.09", "500", "501"),
        ("sigma_kg", "0", "-0.1", "2", "2.01"),  # a tenth of the mass
        ("x_m", "-3.96", "-3.97", "1.2", "1.21"),
        ("y_m", "-1.04", "-1.05", "1.04", "1.05"),
        ("position_sigma_m", "0", "-0.1", "0.2", "0.21"),
        ("height_m", "-1", "-1.1", "2", "2.1"),
    ],
)
def test_a_field_of_a_weight_takes_its_limits_and_nothing_beyond(
    name: str, lowest: str, below: str, highest: str, above: str
) -> None:
    for typed in (lowest, highest):
        assert check_weight(WEIGHT | {name: typed}, 2.76, 0.74) == ()
    for typed in (below, above):
        errors = check_weight(WEIGHT | {name: typed}, 2.76, 0.74)
        assert {error.field for error in errors} >= {name}


def test_a_measured_fact_needs_its_uncertainty_and_an_absent_one_does_not() -> None:
    typed = {"wheelbase_m": "2.76", "wheelbase_m.sigma": " "}
    (error,) = check_vehicle(EMPTY | typed, BENCH)
    assert (error.field, error.label, error.limit) == (
        "wheelbase_m.sigma", "Wheelbase ±", "above 0 m"
    )  # fmt: skip
    assert check_vehicle(EMPTY | {"wheelbase_m.sigma": ""}, BENCH) == ()
    assert [EMPTY[f"{name}.sigma"] for name in ("rear_axle_kg", "rear_track_m")] == ["1", "0.003"]


def test_a_field_says_its_limits_in_words() -> None:
    fields = {field.name: field for field in VEHICLE_FIELDS}
    assert fields["bump_height_mm"].limit == "above 0, up to 200 mm"
    assert fields["repeats"].limit == "a whole number 1 to 100 runs"
    assert fields["notes"].limit == "0 to 500 characters"
    assert fields["name"].limit == "1 to 60 characters"
    assert fields["method"].advice.endswith(
        "(one of roll_over, drop, push; left and right change it)"
    )
    assert fields["wheelbase_m"].advice.endswith("(1 to 6 m)")
    open_ended = Field("n", "N", "m", 0.0, above_low=True)
    assert [e.field for e in check_fields([open_ended], {"n": "0"})] == ["n"]
    assert check_fields([open_ended], {"n": "1e9"}) == ()
    assert check_fields([open_ended], {}) == ()


def test_weights_may_be_half_of_the_car() -> None:
    assert check_inventory([BodyWeight(750.0, 0.0, 0.0)], 1500.0) == ()
    (error,) = check_inventory([BodyWeight(750.1, 0.0, 0.0)], 1500.0)
    assert (error.field, error.limit) == ("mass_kg", "750 kg in all")
    (none,) = check_inventory([], 1500.0)
    assert none.limit == "one weight at least"


def test_axle_limits_are_from_100_to_10000_kg(tmp_path: Path) -> None:
    assert parse_limits("100 10000") == AxleLimits(100.0, 10_000.0)
    for typed in ("99.9 500", "500 99.9", "10001 500", "500 10001"):
        with pytest.raises(InputError):
            parse_limits(typed)
    assert axles_line((915.2, 785.0), 1552.4, None) == (
        "front 915 kg, rear 785 kg (the car alone 1552 kg)   L = limits"
    )
    (tmp_path / "axle_limits.json").write_text('{"front_kg": 1050}')
    assert read_limits(tmp_path) is None


def test_a_frequency_must_move_by_three_spreads() -> None:
    entries = (Entry(BodyWeight(20.0, 0.0, 0.6)),)

    def said(after_hz: float, spread: float | None) -> tuple[str, str]:
        return shift_line(Shift("pitch", 1.0, after_hz), spread, entries, FORD_GRANADA)

    assert said(1.25, 0.0625)[0] == "pitch  1.00 -> 1.25 Hz +25.0%  4x spread: good"
    assert said(1.1875, 0.0625)[1] == ""
    assert said(1.18, 0.0625)[1].startswith("WEAK 3x, want 3x: ")
    assert said(1.016, None)[0].endswith("3x usual spread: good")
    assert said(1.014, None)[1].startswith("WEAK 3x")
    assert said(1.00004, 0.0)[0].endswith("4x spread: good"), "no spread is below 1e-5"
    assert said(0.75, 0.0625)[0].endswith("-25.0%  4x spread: good")
    bounce = shift_line(Shift("bounce", 1.0, 1.0), 0.1, entries, FORD_GRANADA)
    assert bounce[1].endswith("more kg on body")
    moved = with_bolted((*entries, *entries), 1, True)
    assert [entry.bolted for entry in moved] == [False, True]
