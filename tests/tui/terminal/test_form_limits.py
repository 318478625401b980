"""Both sides of every limit of the forms, and what the weights do to the car, in round numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.config import load_bench
from daq.errors import InputError
from daq.loading import Loading
from daq.vehicle import (
    FORD_GRANADA,
    BodyWeight,
    Corner,
    HubWeight,
    VehicleGeometry,
)
from tui.jobs.gain import Gain, Shift
from tui.terminal.screens.vehicle import VEHICLE_FIELDS, check_vehicle, vehicle_values
from tui.terminal.screens.weights import (
    NEW_WEIGHT,
    AxleLimits,
    Entry,
    axle_loads_with,
    axles_line,
    check_inventory,
    check_weight,
    effect_line,
    gain_line,
    known_car,
    parse_limits,
    read_limits,
    sag_line,
    shift_line,
    sketch,
    weight_of,
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


@pytest.mark.parametrize(
    ("name", "good", "bad", "limit"),
    [
        ("sigma_kg", "5", "5.1", "0 to 5 kg"),
        ("x_m", "-8", "-8.1", "-8 to 3 m"),
        ("x_m", "3", "3.1", "-8 to 3 m"),
        ("y_m", "1.5", "1.6", "-1.5 to 1.5 m"),
        ("y_m", "-1.5", "-1.6", "-1.5 to 1.5 m"),
    ],
)
def test_a_weight_is_on_no_car_however_large_beyond_these(
    name: str, good: str, bad: str, limit: str
) -> None:
    for typed, refused in ((good, False), (bad, True)):
        errors = check_weight(WEIGHT | {"mass_kg": "60", name: typed}, 9.0, 2.0)
        assert (limit in [error.limit for error in errors]) is refused


def test_axles_and_total_agree_within_one_percent_and_none_carries_all() -> None:
    def bad(total: str, front: str, rear: str) -> list[str]:
        typed = {"total_mass_kg": total, "front_axle_kg": front, "rear_axle_kg": rear}
        return [error.field for error in check_vehicle(EMPTY | typed, BENCH)]

    assert bad("1500", "785", "700") == []
    assert bad("1500", "784.9", "700") == ["total_mass_kg"]
    assert bad("1500", "815", "700") == []
    assert bad("1500", "815.1", "700") == ["total_mass_kg"]
    assert bad("1500", "1499", "") == []
    assert bad("1500", "1500", "") == ["front_axle_kg"]
    assert bad("1500", "", "1500") == ["rear_axle_kg"]
    assert bad("", "1500", "1500") == []


def test_lengths_agree_with_the_stated_geometry_within_two_percent() -> None:
    vehicle = replace(BENCH.vehicle, geometry=VehicleGeometry(1.0, 2.0, 0.75, 1.0))
    stated = replace(BENCH, vehicle=vehicle)
    for name, low, high in (
        ("wheelbase_m", ("2.939", "2.941"), ("3.059", "3.061")),
        ("front_track_m", ("1.469", "1.471"), ("1.529", "1.531")),
        ("rear_track_m", ("1.959", "1.961"), ("2.039", "2.041")),
    ):
        found = [
            [error.field for error in check_vehicle(EMPTY | {name: typed}, stated)]
            for typed in (*low, *high)
        ]
        assert found == [[name], [], [], [name]]


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


def test_a_new_weight_has_the_usual_uncertainties() -> None:
    typed = NEW_WEIGHT | {"mass_kg": "20", "x_m": "-1", "y_m": "0.5"}
    assert check_weight(typed, 2.76, 0.74) == ()
    assert weight_of(typed) == BodyWeight(20.0, -1.0, 0.5, 0.0, 0.01, 0.005)
    assert weight_of(typed | {"sigma_kg": "", "height_m": "", "position_sigma_m": ""}) == (
        BodyWeight(20.0, -1.0, 0.5)
    )


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


def test_the_axles_carry_the_car_and_the_weights() -> None:
    car = replace(
        FORD_GRANADA, m_s=1200.0, a=1.0, b=2.0, m_uf=40.0, m_ur=50.0
    )  # 800 kg of the body on the front axle
    load = Loading(
        body_kg=60.0, hub_kg=8.0, x_shift_m=-0.0125, y_shift_m=0.004, I_xx=12.4, I_yy=-3.6,
        front_kg=30.0, rear_kg=38.0,
    )  # fmt: skip
    total, axles = axle_loads_with(load, car)
    assert total == 1380.0
    assert axles == (910.0, 538.0)
    assert effect_line(load) == "body +60, hubs +8 kg, CG -12 +4 mm, Ixx +12 Iyy -4 kg m2"


def test_the_sketch_is_a_car_of_13_by_7_cells_with_its_hubs() -> None:
    entries = (
        Entry(BodyWeight(20.0, 0.35, 1.09)),  # the outermost place, front left
        Entry(BodyWeight(20.0, -3.11, -1.09)),  # and rear right
        *(Entry(HubWeight(4.0, Corner.REAR_RIGHT)) for _ in range(3)),
        Entry(HubWeight(4.0, Corner.FRONT_RIGHT)),
    )
    lines = sketch(entries, FORD_GRANADA)
    assert lines == [
        "         front         ",
        "  FL+-------------+6   ",
        "    |1            |",
        "    |             |",
        "    |             |",
        "    |      +      |",
        "    |             |",
        "    |             |",
        "    |            2|",
        "  RL+-------------+,4,5",
    ]
    far = sketch((Entry(BodyWeight(20.0, 9.0, -9.0)),), FORD_GRANADA)
    assert far[2] == "    |            1|"


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


def test_an_outlook_without_remedies_names_what_is_lost() -> None:
    assert gain_line(Gain(undetermined=("m_s",)))[1] == "WEAK, not determined: m_s"
    assert gain_line(Gain(error="no DBC")) == ("", "no outlook: no DBC")


def test_a_body_that_sinks_by_less_than_half_a_millimetre_has_not() -> None:
    weights = [BodyWeight(100.0, -1.38, 0.0)]
    car = known_car(BENCH, None)

    def said(sunk_m: float) -> str:
        return sag_line(BENCH, weights, dict.fromkeys(Corner, sunk_m), car)

    assert "has not sunk" in said(0.00049)
    # 25 kg on each corner: 245.2 N over 0.51 mm.
    assert said(0.00051) == ("spring front 480.7 kN/m (expected 17), rear 480.7 kN/m (expected 22)")
