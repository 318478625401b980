"""Every error of a form names field, limit and reason; the bench says what was typed."""

from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.config import default_bench_text, load_bench, parse_bench
from daq.runs import Excitation
from daq.vehicle import Corner, Fact, HubWeight, Structure, VehicleGeometry
from tui.terminal.screens.vehicle import (
    check_vehicle,
    vehicle_text,
    vehicle_values,
)
from tui.terminal.screens.weights import (
    check_inventory,
    check_weight,
)
from tui.terminal.state.drafts import last_form, read_draft, remove_draft, write_draft

BENCH = load_bench(None)
GOOD = vehicle_values(BENCH, "MK") | {
    "total_mass_kg": "1552",
    "front_axle_kg": "845,5",
    "rear_axle_kg": "706",
    "wheelbase_m": "2.76",
    "front_track_m": "1.48",
    "rear_track_m": "1.48",
}
WEIGHT = {"place": "body", "serial": "M-07", "mass_kg": "20", "sigma_kg": "0.01", "x_m": "-0.4",
          "y_m": "0.55", "position_sigma_m": "0.005", "height_m": "0"}  # fmt: skip


def test_the_bench_in_force_fills_a_form_without_errors() -> None:
    assert check_vehicle(vehicle_values(BENCH, "MK"), BENCH) == ()
    assert check_vehicle(GOOD, BENCH) == ()


@pytest.mark.parametrize(
    ("typed", "field", "label", "limit", "reason"),
    [
        ({"name": " "}, "name", "Vehicle", "1 to 60 characters", "empty"),
        ({"operator": "x" * 41}, "operator", "Operator", "1 to 40", "41 characters"),
        ({"name": "a\x1b[2Jb"}, "name", "Vehicle", "1 to 60", "cannot be printed"),
        ({"total_mass_kg": "1.5 t"}, "total_mass_kg", "Total mass", "100 to 10000 kg", "'1.5 t'"),
        ({"total_mass_kg": "20000"}, "total_mass_kg", "Total mass", "100 to 10000 kg", "above"),
        ({"rear_axle_kg": "650"}, "total_mass_kg", "Total mass", "within 1 %", "1495.5 kg"),
        ({"front_axle_kg": "1600", "rear_axle_kg": ""}, "front_axle_kg", "Front axle",
         "less than the total", "1600 kg on one axle"),
        ({"wheelbase_m": "0.276"}, "wheelbase_m", "Wheelbase", "1 to 6 m", "below"),
        ({"front_track_m": "nan"}, "front_track_m", "Front track", "0.8 to 2.6 m", "'nan'"),
        ({"rear_track_m.sigma": ""}, "rear_track_m.sigma", "Rear track ±", "above 0 m", "needs"),
        ({"total_mass_kg.sigma": "0"}, "total_mass_kg.sigma", "Total mass ±", "0.001", "below"),
        ({"repeats": "2.5"}, "repeats", "Repeats", "whole number 1 to 100", "2.5"),
        ({"repeats": "1_0"}, "repeats", "Repeats", "whole number", "'1_0'"),
        ({"method": "kick"}, "method", "Method", "roll_over, drop, push", "'kick'"),
        ({"bump_height_mm": "201"}, "bump_height_mm", "Bump height", "above 0, up to 200 mm",
         "leave the"),
        ({"bump_height_mm": "0"}, "bump_height_mm", "Bump height", "above 0, up to 200 mm",
         "0 mm is not above 0"),
        ({"bump_height_mm": "-1"}, "bump_height_mm", "Bump height", "above 0, up to", "below"),
        ({"accept_after_s": "-1"}, "accept_after_s", "Accept after", "0 to 60 s", "below"),
        ({"bump.bounce": "no", "bump.pitch": "no", "bump.roll": "no"}, "bump.bounce", "Bounce",
         "at least one", "nothing would be bumped"),
        ({"notes": "x" * 501}, "notes", "Notes", "0 to 500", "501 characters"),
    ],
)  # fmt: skip
def test_each_error_names_field_limit_and_reason(
    typed: dict[str, str], field: str, label: str, limit: str, reason: str
) -> None:
    (error,) = check_vehicle(GOOD | typed, BENCH)
    assert error.field == field
    assert label in str(error)
    assert limit in str(error)
    assert reason in str(error)
    assert str(error).isprintable()


def test_lengths_must_fit_the_geometry_that_bench_toml_states() -> None:
    vehicle = replace(BENCH.vehicle, geometry=VehicleGeometry(1.25, 1.51, 0.74, 0.74))
    stated = replace(BENCH, vehicle=vehicle)
    assert check_vehicle(GOOD, stated) == ()
    (error,) = check_vehicle(GOOD | {"wheelbase_m": "2.9"}, stated)
    assert (error.field, error.limit) == ("wheelbase_m", "2.76 m within 2 %")


def test_what_was_typed_is_what_the_bench_says() -> None:
    text = default_bench_text() + '\n[[fact]]\nquantity = "k_sf"\nvalue = 17000.0\nsigma = 50.0\n'
    bench = parse_bench(text, "bench.toml", Path(), "")
    typed = GOOD | {
        "name": 'T5 "x"',
        "flag.anti_roll_bars": "yes",
        "bump.warp": "yes",
        "bump.rear_pitch": "yes",
        "repeats": "5",
        "method": "drop",
        "bump_height_mm": "47.5",
        "accept_after_s": "1.5",
    }
    after = parse_bench(vehicle_text(text, bench, typed), "bench.toml", Path(), "")
    assert after.vehicle.name == 'T5 "x"'
    assert after.vehicle.structure == Structure(anti_roll_bars=True)
    assert set(after.vehicle.facts) == {
        Fact("k_sf", 17000.0, 50.0),
        Fact("total_mass_kg", 1552.0, 1.0),
        Fact("front_axle_kg", 845.5, 1.0),
        Fact("rear_axle_kg", 706.0, 1.0),
        Fact("wheelbase_m", 2.76, 0.003),
        Fact("front_track_m", 1.48, 0.003),
        Fact("rear_track_m", 1.48, 0.003),
    }
    assert after.campaign.excitations == tuple(Excitation)
    assert after.campaign.repeats == 5
    assert after.campaign.bump_height_m == pytest.approx(0.0475, abs=1e-15)
    assert after.campaign.accept_after_s == 1.5
    back = vehicle_values(after, "MK")
    assert back == {k: v.replace(",", ".") for k, v in typed.items()}
    assert vehicle_text(after.text, after, back) == after.text


def test_a_form_that_changes_nothing_leaves_the_text_alone() -> None:
    values = vehicle_values(BENCH, "MK")
    assert vehicle_text(BENCH.text, BENCH, values) == BENCH.text


@pytest.mark.parametrize(
    ("typed", "field", "limit", "reason"),
    [
        ({"place": "roof"}, "place", "one of body, FL, FR, RL, RR", "'roof'"),
        ({"mass_kg": ""}, "mass_kg", "0.1 to 500 kg", "empty"),
        ({"mass_kg": "501"}, "mass_kg", "0.1 to 500 kg", "above"),
        ({"sigma_kg": "3"}, "sigma_kg", "0 to 2 kg", "weigh it"),
        ({"x_m": ""}, "x_m", "-3.96 to 1.20 m", "empty"),
        ({"x_m": "-4.5"}, "x_m", "-3.96 to 1.20 m", "outside the car"),
        ({"x_m": "-400"}, "x_m", "-8 to 3 m", "below"),
        ({"y_m": "1.2"}, "y_m", "-1.04 to 1.04 m", "outside the car"),
        ({"position_sigma_m": "0.21"}, "position_sigma_m", "0 to 0.2 m", "above"),
        ({"height_m": "3"}, "height_m", "-1 to 2 m", "above"),
    ],
)
def test_each_error_of_a_weight_names_field_limit_and_reason(
    typed: dict[str, str], field: str, limit: str, reason: str
) -> None:
    errors = check_weight(WEIGHT | typed, 2.76, 0.74)
    error = next(e for e in errors if e.field == field)
    assert limit in str(error)
    assert reason in str(error)


def test_all_weights_together_must_be_some_and_not_too_much() -> None:
    hub = HubWeight(4.0, Corner.FRONT_LEFT)
    assert check_inventory([hub], 1500.0) == ()
    (error,) = check_inventory([], 1500.0)
    assert "baseline again" in str(error)
    (error,) = check_inventory([hub] * 200, 1500.0)
    assert "750 kg in all" in str(error)


def test_a_draft_is_whole_or_absent(tmp_path: Path) -> None:
    path = tmp_path / "draft.json"
    assert read_draft(path) == {}
    assert write_draft(path, {"name": "T5", "entries": [1]}) == ""
    assert read_draft(path) == {"name": "T5", "entries": [1]}
    assert [p.name for p in tmp_path.iterdir()] == ["draft.json"]
    path.write_text('{"name": "T')
    assert read_draft(path) == {}
    assert "No such file" in write_draft(tmp_path / "gone" / "draft.json", {})
    remove_draft(path)
    remove_draft(path)
    assert read_draft(path) == {}


def test_the_last_form_of_a_vehicle_is_found_beside_the_folder(tmp_path: Path) -> None:
    for folder, name in (("a", "T5"), ("b", "X1"), ("now", "T5")):
        (tmp_path / folder).mkdir()
        write_draft(tmp_path / folder / "vehicle.json", {"name": name, "repeats": folder})
    now = tmp_path / "now"
    assert last_form(now, "vehicle.json", "T5") == {"name": "T5", "repeats": "a"}
    assert last_form(now, "vehicle.json", "Z9") == {}
