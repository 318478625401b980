"""What a bench.toml says is changed, and everything else that it says stays."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.bench.campaign import Method
from daq.bench.config import Bench, default_bench_text, parse_bench
from daq.bench.edit import with_campaign, with_channel, with_facts, with_vehicle, with_weights
from daq.runs import Excitation
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, Structure
from dbc.words import InputError

SHIPPED = default_bench_text()
WRITTEN = """# Bench of hall 3, ask Erna.
dbc = ""  # shipped

[vehicle]
name = 'old'   # plate T5
[vehicle.geometry]
a_m = 1.20
b_m = 1.50
t_f_m = 0.7
t_r_m = 0.7

[[weight]]
mass_kg = 32.50  # W-01
x_m = 0.1
y_m = 0.5

[[weight]]
hub = "FL"
mass_kg = 4.0

[campaign]
repeats = 2
[campaign.instructions]
bounce = "drop it"
"""


def _bench(text: str) -> Bench:
    return parse_bench(text, "bench.toml", Path(), dbc_text="")


EDITS: list[tuple[str, Callable[[str], str]]] = [
    ("vehicle", lambda t: with_vehicle(t, 'T5 "new"', Structure(symmetric=False))),
    ("fact", lambda t: with_facts(t, [Fact("total_mass_kg", 1500.0, 1.0)])),
    ("weight", lambda t: with_weights(t, [HubWeight(2.5, Corner.REAR_LEFT, 0.01)])),
    ("channel", lambda t: with_channel(t, "travel_fl", sign=-1, tare=0.0125)),
    (
        "campaign",
        lambda t: with_campaign(t, (Excitation.WARP,), 7, Method.DROP, 0.07, 1.5),
    ),
]


@pytest.mark.parametrize("text", [SHIPPED, WRITTEN, ""], ids=["shipped", "written", "empty"])
@pytest.mark.parametrize(("key", "edit"), EDITS, ids=[key for key, _ in EDITS])
def test_an_edit_changes_its_table_and_nothing_else(
    text: str, key: str, edit: Callable[[str], str]
) -> None:
    after = edit(text)
    old, new = tomllib.loads(text), tomllib.loads(after)
    assert old.get(key) != new[key]
    old.pop(key, None), new.pop(key)
    assert old == new
    assert edit(after) == after  # what is so already is not written again


def test_an_edit_that_changes_nothing_leaves_the_text_as_it_was_written() -> None:
    weights = _bench(WRITTEN).mass_states[1].added.weights
    assert with_weights(WRITTEN, weights) == WRITTEN
    assert with_vehicle(WRITTEN, "old", Structure()) == WRITTEN
    assert tomllib.loads(with_weights(WRITTEN, []))["weight"] == []


@pytest.mark.parametrize(
    "text",
    [
        "weight = [{mass_kg = 3, hub = 'FL'}]\ndbc = ''\n[vehicle]\nname = 'k'\n",
        "[[weight]]\nmass_kg = 3\nhub = 'FL'\n[bus]\n[[weight]]\nmass_kg = 3\nhub = 'FR'\n",
        "vehicle.name = 'k'\n# no newline at the end",
        "\r\n[vehicle]\r\nname = 'k'\r\n[[weight]]\r\nmass_kg = 3\r\nhub = 'FL'\r\n",
    ],
    ids=["inline", "scattered", "dotted", "crlf"],
)
def test_other_spellings_are_edited_too(text: str) -> None:
    weights = (BodyWeight(20.0, -0.5, 0.4, 0.1, 0.02, 0.01), HubWeight(3.0, Corner.REAR_LEFT))
    after = with_vehicle(with_weights(text, weights), "car", Structure())
    assert _bench(after).mass_states[1].added.weights == weights
    assert _bench(after).vehicle.name == "car"


_KG = st.floats(1e-3, 1e4)
_M = st.floats(-10.0, 10.0)
_WEIGHTS = st.lists(
    st.one_of(
        st.builds(BodyWeight, _KG, _M, _M, _M, st.floats(0.0, 10.0), st.floats(0.0, 1.0)),
        st.builds(HubWeight, _KG, st.sampled_from(Corner), st.floats(0.0, 10.0)),
    ),
    max_size=6,
)


@settings(max_examples=6, deadline=None)
@given(first=_WEIGHTS, second=_WEIGHTS, tare=st.floats(-1e9, 1e9))
def test_any_number_goes_through_to_the_last_bit(
    first: list[Any], second: list[Any], tare: float
) -> None:
    text = with_weights(with_weights(WRITTEN, first), second)
    text = with_channel(text, "pitch_rate", tare=tare)
    bench = _bench(text)
    assert bench.mass_states[1].added.weights == tuple(second)
    assert next(c for c in bench.channels if c.name == "pitch_rate").tare == tare


@pytest.mark.parametrize(
    ("edit", "named"),
    [
        (lambda t: with_weights(t, [HubWeight(-1.0, Corner.FRONT_LEFT)]), "weight.1.mass_kg"),
        (lambda t: with_facts(t, [Fact("colour", 1.0, 1.0)]), "colour"),
        (lambda t: with_channel(t, "travel_fl", sign=2), "travel_fl"),
        (lambda t: with_channel(t, "nose", sign=1), "nose"),
        (lambda t: with_channel(t, "travel_fl", tare=float("inf")), "tare"),
        (lambda t: with_campaign(t, (), 1, Method.DROP, 0.04, 3.0), "excitations"),
        (lambda t: with_vehicle(t + "\n[vehicle", "a", Structure()), "TOML"),
        (lambda t: with_vehicle(t + "\nodd = 1\n", "a", Structure()), "odd"),
    ],
)
def test_what_a_bench_may_not_say_names_its_field(edit: Callable[[str], Any], named: str) -> None:
    with pytest.raises(InputError) as error:
        edit(SHIPPED)
    assert named in str(error.value)
    assert "\n" not in str(error.value)
