"""A channel knows its unit, and refuses what does not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from daq.bumps import kinds_of
from daq.channels import Channel, Quantity
from daq.runs import Excitation, RunStatus, SampleGroup
from daq.session import read_session, write_session
from daq.session.from_frames import parse_runs
from daq.sessions import notes_of, overrides_of, session_from_arrays
from daq.vehicle import (
    FORD_GRANADA,
    PARAMETER_NAMES,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    Structure,
    Vehicle,
    VehicleGeometry,
    Weight,
    expected_car,
    parameter_names,
    parameter_unit,
)
from dbc.words import InputError

from .small_session import small_session

TEXT: dict[str, Any] = {"name": "fl", "quantity": "hub_acceleration", "corner": "FL"}


def test_a_channel_has_the_unit_of_its_quantity_and_takes_texts() -> None:
    assert Channel("r", Quantity.ROLL_RATE).unit == "rad/s"
    assert Channel("yaw", Quantity.UNUSED, "deg/s").unit == "deg/s"
    assert Channel("yaw", Quantity.UNUSED).unit == ""
    hub = Channel("fl", Quantity("hub_acceleration"), corner=Corner("FL"))
    assert Channel(**TEXT) == hub
    assert Channel(**TEXT).corner is Corner.FRONT_LEFT


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"unit": "g"}, "channel fl: hub_acceleration is in m/s2, not g"),
        ({"corner": "FM"}, r"channel fl: no corner is 'FM' .* FL, FR, RL, RR"),
        ({"quantity": "speed"}, r"channel fl: no quantity is 'speed' .*hub_acceleration"),
        ({"corner": None}, "channel fl: hub_acceleration needs a corner"),
        ({"quantity": "pitch_rate"}, "channel fl: pitch_rate has no corner"),
    ],
)
def test_what_does_not_fit_a_channel_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Channel(**TEXT | changes)


# Samples of a run, which cannot be changed afterwards, and what of a session is used ------------


def test_the_columns_of_a_group_cannot_be_changed() -> None:
    given = {"az": np.zeros(3)}
    group = SampleGroup("imu", np.arange(3.0), np.arange(3), given, np.zeros(3, np.uint8))
    columns = (group.time_s, group.t_ns, group.quality, group.values["az"])
    assert not any(column.flags.writeable for column in columns)
    given["later"] = np.zeros(7)
    assert list(group.values) == ["az"]
    with pytest.raises(ValueError, match=r"group imu: az has shape \(4,\), not \(3,\)"):
        replace(group, values={"az": np.zeros(4)})


def test_a_session_knows_its_accepted_runs_and_its_used_channels() -> None:
    session = small_session()
    first, second, third = session.runs
    assert not session.accepted
    second = replace(second, status=RunStatus.ACCEPTED)
    session = replace(session, runs=(first, second, third))
    assert [run.is_accepted for run in session.runs] == [False, True, False]
    assert session.accepted == (second,)
    az = replace(session.channels[2], quantity=Quantity.UNUSED)
    session = replace(session, channels=(*session.channels[:2], az, session.channels[3]))
    assert [c.name for c in session.used_channels] == ["hub_fl", "hub_fr", "pitch"]


# The names and units of a vehicle's parameters, and where its corners are -----------------------


BODY = ("m_s", "I_yy", "I_xx")
AXLES = ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr")
PLACES = ("a", "b", "t_f", "t_r")


def test_a_model_has_fifteen_parameters_and_those_of_what_it_has_more() -> None:
    usual = (*BODY, *AXLES, *PLACES)
    assert parameter_names(Structure()) == PARAMETER_NAMES == usual
    assert parameter_names(Structure(cg_offset=True)) == (*usual, "y_s")
    more = ("k_af", "k_ar", "c_tf", "c_tr", "y_s")
    assert parameter_names(Structure(True, True, True, True)) == (*usual, *more)
    corners = [f"{name}{side}" for name in AXLES for side in "lr"]
    assert parameter_names(Structure(symmetric=False)) == (*BODY, *corners, *PLACES)


def test_units_follow_from_the_first_letter() -> None:
    units = [parameter_unit(name) for name in PARAMETER_NAMES]
    assert units == [
        "kg", "kg m2", "kg m2", "kg", "kg", "N/m", "N/m", "N/m", "N/m", "N s/m", "N s/m",
        "m", "m", "m", "m",
    ]  # fmt: skip
    assert (parameter_unit("F_cf"), parameter_unit("y_s")) == ("N", "m")


def test_added_mass_is_a_matrix_of_seven_that_cannot_be_changed() -> None:
    assert AddedMass().matrix.shape == (7, 7)
    assert not AddedMass().matrix.any()
    assert not AddedMass().matrix.flags.writeable
    with pytest.raises(ValueError, match=r"7 x 7, not \(7, 6\)"):
        AddedMass(matrix=np.zeros((7, 6)))


# Remarks on a session, from a provenance that may come from any program -------------------------


@pytest.mark.parametrize("text", ["plain words", "[1]", '[{"by": 1}]', "{", "[" * 100_000, "7"])
def test_what_is_not_as_we_write_it_is_returned_as_it_is(text: str) -> None:
    assert notes_of({"notes": text}) == overrides_of({"overrides": text}) == (text,)


# The table of the kinds of bump, and which struck wheels count as which kind --------------------


FL, FR, RL, RR = Corner
BOUNCE, PITCH, ROLL, WARP, REAR = Excitation
USUAL = (BOUNCE, PITCH, ROLL)


@pytest.mark.parametrize(
    ("wheels", "planned", "kinds"),
    [
        ({FL, FR, RL, RR}, USUAL, (BOUNCE,)),
        ({FL, FR}, USUAL, (PITCH,)),
        # Without rear pitch in the campaign a pitch at either axle will do ..
        ({RL, RR}, USUAL, (PITCH, REAR)),
        # .. with it the axles are two kinds, and without pitch the same holds the other way.
        ({RL, RR}, (*USUAL, REAR), (REAR,)),
        ({FL, FR}, (*USUAL, REAR), (PITCH,)),
        ({FL, FR}, (BOUNCE, REAR, ROLL), (PITCH, REAR)),
        ({FL, RL}, USUAL, (ROLL,)),
        ({FR, RR}, USUAL, (ROLL,)),
        ({FR, RL}, USUAL, (WARP,)),
        ({FL, RR}, (*USUAL, WARP), (WARP,)),
        ({FL}, USUAL, ()),
        ({FL, FR, RL}, (*USUAL, REAR), ()),
    ],
)
def test_struck_wheels_make_a_kind(
    wheels: set[Corner], planned: tuple[Excitation, ...], kinds: tuple[Excitation, ...]
) -> None:
    assert kinds_of(frozenset(wheels), planned) == kinds


def test_a_rear_pitch_keeps_its_name_from_import_to_session(tmp_path: Path) -> None:
    first, second = parse_runs("baseline:rear_pitch, baseline:rear_pitch")
    assert (first.label, second.label) == ("baseline_rear_pitch_1", "baseline_rear_pitch_2")
    time_s = np.arange(10) / 100.0
    runs = [("baseline", "rear_pitch", {"z_s": (time_s, time_s)})]
    write_session(tmp_path / "car.h5", session_from_arrays(runs))
    (run,) = read_session(tmp_path / "car.h5").runs
    assert (run.excitation, run.label) == (Excitation.REAR_PITCH, "baseline_rear_pitch_1")


T = np.arange(10) / 100.0
RUN = {"z_s": (T, np.sin(T)), "theta": (T, np.cos(T))}


def test_channels_of_one_clock_share_a_group_and_repeats_are_counted() -> None:
    missing = np.where(np.arange(10) == 4, np.nan, 1.0)
    first = {**RUN, "z_uA": (T + 0.001, missing)}
    session = session_from_arrays(
        [("baseline", "bounce", first), ("added", "bounce", RUN), ("baseline", "bounce", RUN)]
    )
    body, hub = session.runs[0].groups
    assert (list(body.values), list(hub.values)) == (["z_s", "theta"], ["z_uA"])
    np.testing.assert_array_equal(hub.time_s, T + 0.001)
    assert hub.quality.nonzero()[0].tolist() == [4]
    assert [channel.name for channel in session.channels] == ["z_s", "theta", "z_uA"]
    labels = [run.label for run in session.runs]
    assert labels == ["baseline_bounce_1", "added_bounce_1", "baseline_bounce_2"]


def test_added_mass_as_matrix_diagonal_or_weights() -> None:
    diagonal = [130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]
    for given in (diagonal, np.diag(diagonal), AddedMass(matrix=np.diag(diagonal))):
        session = session_from_arrays([("added", "roll", RUN)], delta_mass=given)
        np.testing.assert_array_equal(session.mass_states[1].added.matrix, np.diag(diagonal))
    weights: list[Weight] = [BodyWeight(30.0, -1.0, 0.5), HubWeight(4.0, Corner.REAR_LEFT)]
    session = session_from_arrays([("added", "roll", RUN)], delta_mass=weights)
    assert session.mass_states[1].added.weights == tuple(weights)


@pytest.mark.parametrize(
    ("run", "names"),
    [
        (("loaded", "bounce", RUN), "loaded"),
        (("baseline", "jump", RUN), "jump"),
        (("baseline", "bounce", {"speed": (T, T)}), "speed"),
        (("baseline", "bounce", {"phi": (T, T[:5])}), "phi"),
        (("baseline", "bounce", {"phi": (T[::-1], T)}), "phi"),
        (("baseline", "bounce", {"phi": (0.1, 2.0)}), "phi"),
        (("baseline", "bounce", {"phi": (T.reshape(2, 5), T.reshape(2, 5))}), "phi"),
        (("baseline", "bounce", {"phi": (T, ["a"] * 10)}), "phi"),
        (("baseline", "bounce", {"phi": (np.where(T > 0.05, np.nan, T), T)}), "phi"),
        (("baseline", "bounce", {}), "no channel"),
    ],
)
def test_what_does_not_fit_is_named(run: Any, names: str) -> None:
    with pytest.raises(InputError, match=names) as caught:
        session_from_arrays([("baseline", "bounce", RUN), run])
    assert caught.value.where == "run 2"


@pytest.mark.parametrize("given", [np.eye(6), [1.0, 2.0], "heavy", np.full((7, 7), np.nan)])
def test_what_is_no_mass_matrix(given: ArrayLike) -> None:
    with pytest.raises(InputError, match="delta_mass"):
        session_from_arrays([("added", "roll", RUN)], delta_mass=given)


@pytest.mark.parametrize("given", [None, "vehicle", Vehicle("vehicle")])
def test_the_vehicle_may_be_a_name_or_nothing(given: Vehicle | str | None) -> None:
    session = session_from_arrays([("baseline", "roll", RUN)], vehicle=given)
    assert session.vehicle == Vehicle("vehicle")


def test_channels_of_one_name_are_refused() -> None:
    hub = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT)
    with pytest.raises(InputError, match="same name"):
        session_from_arrays([("baseline", "roll", {"hub": (T, T)})], channels=[hub, hub])


@pytest.mark.parametrize(
    "loads",
    [
        {"total_mass_kg": 1000.0, "front_axle_kg": 600.0, "rear_axle_kg": 400.0},
        {
            "corner_fl_kg": 310.0,
            "corner_fr_kg": 290.0,
            "corner_rl_kg": 190.0,
            "corner_rr_kg": 210.0,
        },
    ],
)
def test_the_expected_car_has_the_loads_and_lengths_that_were_measured(
    loads: dict[str, float],
) -> None:
    usual = expected_car(Vehicle("car"))
    np.testing.assert_allclose(usual.to_array(), FORD_GRANADA.to_array(), rtol=1e-12)
    facts = {
        **loads,
        FactQuantity.WHEELBASE: 2.4,
        FactQuantity.FRONT_TRACK: 1.4,
        FactQuantity.REAR_TRACK: 1.5,
    }
    reported = tuple(Fact(quantity, value, 1.0) for quantity, value in facts.items())
    car = expected_car(Vehicle("car", facts=reported))
    assert car.m_s + 2 * car.m_uf + 2 * car.m_ur == pytest.approx(1000.0)
    assert car.m_s * car.b / (car.a + car.b) + 2 * car.m_uf == pytest.approx(600.0)
    assert (car.a + car.b, 2 * car.t_f, 2 * car.t_r) == pytest.approx((2.4, 1.4, 1.5))
    front_kg, rear_kg = (car.m_s * length / 2.4 for length in (car.b, car.a))
    assert [car.k_sf / front_kg, car.k_sr / rear_kg, car.I_yy / (car.m_s * car.a * car.b)] == (
        pytest.approx(
            [
                usual.k_sf / (usual.m_s * usual.b / (usual.a + usual.b)),
                usual.k_sr / (usual.m_s * usual.a / (usual.a + usual.b)),
                usual.I_yy / (usual.m_s * usual.a * usual.b),
            ]
        )
    )
    geometry = VehicleGeometry(1.1, 1.3, 0.7, 0.75)
    assert expected_car(Vehicle("car", geometry, facts=reported)).geometry == geometry
