"""Forms and weights: each error names field, limit and reason; step 4 as a person uses it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from daq.bench.config import default_bench_text, load_bench, parse_bench
from daq.control.messages import Configure, Mark
from daq.runs import Excitation
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, Structure
from tui.terminal.campaign import read_draft
from tui.terminal.form import Field, FieldError, Form
from tui.terminal.screens.masses import (
    Entry,
    MassesScreen,
    WeightScreen,
    check_inventory,
    check_weight,
    entries_of,
    entry_values,
)
from tui.terminal.screens.vehicle import VehicleScreen, check_vehicle, vehicle_text, vehicle_values

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .operated import (
    Make,
    Shown,
    alone,
    check_items,
    cursor,
    front,
    on_screen,
    orders_of,
    pressed,
    seen,
)

BENCH = load_bench(None)
EMPTY = vehicle_values(BENCH, "MK")
MEASURED = EMPTY | {
    "total_mass_kg": "1552",
    "front_axle_kg": "845,5",
    "rear_axle_kg": "706",
    "wheelbase_m": "2.76",
    "front_track_m": "1.48",
    "rear_track_m": "1.48",
}
WEIGHT = {"place": "body", "mass_kg": "20", "sigma_kg": "0.01", "x_m": "-0.4",
          "y_m": "0.55", "position_sigma_m": "0.005", "height_m": "0"}  # fmt: skip


def errors_of(typed: dict[str, str], vehicle: dict[str, str]) -> tuple[FieldError, ...]:
    """Return the errors of a weight, or of the vehicle, with what was typed into its fields."""
    if typed.keys() <= WEIGHT.keys():
        return check_weight(WEIGHT | typed)
    return check_vehicle(vehicle | typed)


@pytest.mark.parametrize(
    ("name", "lowest", "below", "highest", "above"),
    [
        ("total_mass_kg", "100", "99.9", "10000", "10001"),
        ("total_mass_kg.sigma", "0.001", "0.0009", "500", "501"),
        ("front_axle_kg", "40", "39.9", "6000", "6001"),
        ("wheelbase_m", "1", "0.99", "6", "6.01"),
        ("wheelbase_m.sigma", "0.0001", "0.00009", "0.3", "0.31"),
        ("front_track_m", "0.8", "0.79", "2.6", "2.61"),
        ("repeats", "1", "0", "100", "101"),
        ("bump_height_mm", "0.1", "0.09", "200", "200.1"),
        ("accept_after_s", "0", "-0.1", "60", "60.1"),
        ("name", "T", "", "x" * 60, "x" * 61),
        ("operator", "M", "", "x" * 40, "x" * 41),
        ("method", "drop", "", "push", "kick"),
        ("flag.cg_offset", "yes", "perhaps", "no", "1"),
        ("mass_kg", "0.1", "0.09", "500", "501"),
        ("sigma_kg", "0", "-0.1", "5", "5.01"),
        ("x_m", "-8", "-8.1", "3", "3.1"),
        ("y_m", "-1.5", "-1.6", "1.5", "1.6"),
        ("position_sigma_m", "0", "-0.1", "0.2", "0.21"),
        ("height_m", "-1", "-1.1", "2", "2.1"),
    ],
)
def test_a_field_takes_its_limits_and_nothing_beyond(
    name: str, lowest: str, below: str, highest: str, above: str
) -> None:
    for typed in (lowest, highest):
        assert errors_of({name: typed}, EMPTY) == ()
    for typed in (below, above):
        assert [error.field for error in errors_of({name: typed}, EMPTY)] == [name]


@pytest.mark.parametrize(
    ("typed", "field", "words"),
    [
        ({"name": " "}, "name", "Vehicle: is empty, and is needed (limit: 1 to 60 characters)"),
        ({"operator": "x" * 41}, "operator", "Operator: has 41 characters (limit: 1 to 40"),
        ({"name": "a\x1b[2Jb"}, "name", "Vehicle: has characters that cannot be printed"),
        ({"total_mass_kg": "1.5 t"}, "total_mass_kg",
         "Total mass: '1.5 t' is not a number (limit: 100 to 10000 kg)"),
        ({"total_mass_kg": "20000"}, "total_mass_kg", "20000 kg is above the limit: from a form"),
        ({"rear_axle_kg": "650"}, "total_mass_kg", "the axles carry 1495.5 kg together"),
        ({"front_track_m": "nan"}, "front_track_m", "'nan' is not a number"),
        ({"rear_track_m.sigma": " "}, "rear_track_m.sigma", "needs the uncertainty"),
        ({"repeats": "2.5"}, "repeats", "2.5 is not a whole number (limit: a whole number 1 to"),
        ({"repeats": "1_0"}, "repeats", "'1_0' is not a number"),
        ({"method": "kick"}, "method", "'kick' is not on the list (limit: one of roll_over, drop"),
        ({"bump_height_mm": "0"}, "bump_height_mm",
         "0 mm is below the limit: less moves nothing"),
        ({"bump.bounce": "no", "bump.pitch": "no", "bump.roll": "no"}, "bump.bounce",
         "nothing would be bumped (limit: at least one"),
        ({"place": "roof"}, "place", "'roof' is not on the list (limit: one of body, FL, FR"),
        ({"mass_kg": ""}, "mass_kg", "Mass: is empty, and is needed (limit: 0.1 to 500 kg)"),
        ({"x_m": ""}, "x_m", "x: is empty, and is needed (limit: -8 to 3 m)"),
        ({"x_m": "-400"}, "x_m", "-400 m is below the limit"),
    ],
)  # fmt: skip
def test_each_error_names_field_limit_and_reason(
    typed: dict[str, str], field: str, words: str
) -> None:
    (error,) = errors_of(typed, MEASURED)
    assert error.field == field
    assert words in error.text
    assert error.text.isprintable()


def test_a_form_is_without_errors_where_all_fits() -> None:
    assert check_vehicle(EMPTY) == check_vehicle(MEASURED) == ()
    assert check_vehicle(EMPTY | {"wheelbase_m.sigma": ""}) == (), "it is not measured"


def test_all_weights_together_must_be_some_and_at_most_half_of_the_car() -> None:
    assert check_inventory([HubWeight(4.0, Corner.FRONT_LEFT)], 1500.0) == ""
    assert check_inventory([BodyWeight(750.0, 0.0, 0.0)], 1500.0) == ""
    assert "more than half" in check_inventory([BodyWeight(750.1, 0.0, 0.0)], 1500.0)
    assert "baseline again" in check_inventory([], 1500.0)


def test_what_was_typed_is_what_the_bench_says() -> None:
    text = default_bench_text() + '\n[[fact]]\nquantity = "k_sf"\nvalue = 17000.0\nsigma = 50.0\n'
    bench = parse_bench(text, "bench.toml", Path(), "")
    typed = MEASURED | {
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
    assert vehicle_text(BENCH.text, BENCH, EMPTY) == BENCH.text, "nothing is changed"


async def test_a_draft_is_whole_or_absent(make_app: Make, tmp_path: Path) -> None:
    path = tmp_path / "draft.json"
    assert read_draft(path) == {}
    app = make_app(FakeRecorder())
    app.store_form("draft.json", {"name": "T5", "entries": [1]})
    assert read_draft(path) == {"name": "T5", "entries": [1]}
    assert [p.name for p in tmp_path.iterdir()] == ["draft.json"]
    path.write_text('{"name": "T')
    assert read_draft(path) == {}
    async with on_screen(app, VehicleScreen) as (pilot, _):
        app.store_form("gone/draft.json", {})
        await pilot.pause()
        assert "gone/draft.json cannot be written: No such file" in seen(app)


FIELDS = (
    Field("name", "Name", needed=True),
    Field("kind", "Kind", choices=("one", "two", "three")),
    Field("bars", "Bars", choices=("yes", "no")),
    Field("mass", "Mass", "kg", 0.0, 9.0),
    Field("mass.sigma", "Mass ±", "kg", 0.0, 9.0),
)


async def test_a_form_is_filled_marked_and_sent() -> None:
    form = Form({"Car": [FIELDS[:2], FIELDS[2:]]})
    async with alone(form, 100, 12) as pilot:
        app = pilot.app
        assert isinstance(app, Shown)
        form.fill({"name": "a", "kind": "two", "bars": "yes", "mass": "1", "absent": "x"})
        assert app.messages == []
        values = {"name": "a", "kind": "two", "bars": "yes", "mass": "1", "mass.sigma": ""}
        assert form.values == values
        form.fill({"kind": "four"})
        assert form.values == values, "it is not on the list"
        form.enter("kind")
        await pilot.pause()
        assert form.current is FIELDS[1]
        await pilot.press("enter", "down", "enter")
        await pilot.pause()
        assert form.values["kind"] == "three"
        await pilot.press("tab", "space")
        await pilot.pause()
        assert form.values["bars"] == "no"
        assert app.messages == ["changed"] * 2
        await pilot.press("tab", *"2", "enter", "up", "down", "enter")
        assert form.values["mass"] == "2", "what is typed takes the place of what was there"
        assert app.messages[-1] == "submitted"
        form.mark([FieldError("mass", "Mass: no (limit: 0 to 9)")])
        labels = [str(label.render()) for label in form.query("Label")]
        assert labels == ["Car", " Name ", " Kind ", " Bars ", "!Mass, kg ", " ± "]


def loaded() -> FakeRecorder:
    recorder = FakeRecorder(check=check_items())
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    return recorder


async def test_a_weight_is_added_edited_and_taken_off(make_app: Make) -> None:
    recorder = loaded()
    app = make_app(recorder)
    async with on_screen(app, MassesScreen) as (pilot, screen):
        count = len(screen._weights)
        await pressed(pilot, "a", *"12.5")
        await pressed(pilot, "ctrl+s")
        assert isinstance(app.screen, WeightScreen), "its place is missing"
        assert "x: is empty, and is needed" in seen(app)
        await pressed(pilot, *"-1.25", "tab", *"0.5", "tab", "tab", "enter")
        assert front(app) is screen
        assert screen._weights[count] == BodyWeight(12.5, -1.25, 0.5, 0.0, 0.01, 0.005)
        assert cursor(app) == count
        await pressed(pilot, "e")
        assert f"Weight {count + 1}" in seen(app)
        await pressed(pilot, "ctrl+u", *"13", "ctrl+s")
        assert screen._weights[count].mass_kg == 13.0
        assert "13.00" in seen(app)
        await pressed(pilot, "delete")
        assert len(screen._weights) == count
        await pressed(pilot, *["delete"] * (count + 2))
        assert screen._weights == ()
        assert "no weight: A adds one" in seen(app)
        assert "there is no weight" in seen(app)
        assert not screen.ready
        assert not screen.next_enabled
        await pressed(pilot, "e")
        assert front(app) is screen
        await screen.action_next()
        await pilot.pause()
        assert front(app) is screen
        assert orders_of(recorder, Mark) == []
        assert not orders_of(recorder, Configure)


async def test_space_bolts_one_weight_after_the_other_and_goes_on(make_app: Make) -> None:
    recorder = loaded()
    app = make_app(recorder)
    async with on_screen(app, MassesScreen) as (pilot, screen):
        count = len(screen._weights)
        assert "SPACE = weight 1 is bolted" in seen(app)
        await pressed(pilot, "down", "down")
        for number in range(2, count + 1):
            assert f"SPACE = weight {number} is bolted" in await pressed(pilot, "space")
        assert "all are bolted" in await pressed(pilot, "space")
        recorder.refuse = "a run is being recorded"
        await pressed(pilot, "space")
        assert front(app) is screen
        recorder.refuse = ""
        await pressed(pilot, "space")
        assert front(app) is not screen
        assert Mark("step masses done") in recorder.orders
        assert orders_of(recorder, Configure) == []
        assert not (app.folder / "draft_masses.json").exists()
        recorder.publish(recording="1f" * 16)
        await app.open("masses")
        assert "SPACE = weight 1 is bolted" in await pressed(pilot, "up"), "the next vehicle"


ENTRIES = (
    Entry(BodyWeight(20.0, 0.0, 0.6)),
    Entry(BodyWeight(20.0, -2.76, -0.6, 0.1, 0.01), True),
    Entry(HubWeight(4.0, Corner.FRONT_LEFT)),
)


def test_a_draft_of_the_weights_is_read_back() -> None:
    reported = json.loads(json.dumps({"entries": entry_values(ENTRIES)}))
    assert entries_of((), reported) == ENTRIES
    weights = tuple(e.weight for e in ENTRIES)
    assert entries_of(weights, {}) == tuple(Entry(w) for w in weights)
    assert entries_of(weights, {"entries": [{"mass_kg": "much"}, 3]}) == ()


async def test_weights_survive_a_crash_and_esc_discards_what_is_typed(
    make_app: Make, snapshot: Callable[..., None]
) -> None:
    app = make_app(loaded())
    async with on_screen(app, MassesScreen, (140, 40)) as (pilot, _):
        await pressed(pilot, "space")
        snapshot(app, "masses_140x40")
        await pilot.resize_terminal(80, 24)
        await pilot.pause()
        snapshot(app, "masses_80x24")
        await pilot.press("a", *"2x", "ctrl+s")
        await pilot.pause()
        assert "Mass: '2x' is not a number (limit: 0.1 to 500 kg)" in seen(app)
        await pilot.press("escape", "a")
        await pilot.pause()
        assert "2x" not in seen(app)
    after = make_app(loaded())
    async with on_screen(after, MassesScreen) as (pilot, _):
        assert " 1 ✓ yes  body" in screen_text(after)
