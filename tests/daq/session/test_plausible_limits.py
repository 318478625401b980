"""What is hard to believe in a session: each limit on both sides, in numbers."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import RunStatus, SampleGroup
from daq.session.validate import check_session
from daq.sessions import Session
from daq.vehicle import AddedMass, BodyWeight, Fact, MassState, VehicleGeometry
from dbc import FrameBatch

from ..small_session import small_session

SESSION = small_session()
RUN = SESSION.runs[0]
PLACE = "/runs/r001_baseline_roll_1"


def _found(session: Session) -> list[tuple[str, str]]:
    """Return severity and place of each finding."""
    return [(f.severity.name.lower(), f.where) for f in check_session(session)]


def _of_run(**changes: Any) -> list[tuple[str, str]]:
    return _found(replace(SESSION, runs=(replace(RUN, **changes),)))


@pytest.mark.parametrize("name", ["a", "b", "t_f", "t_r"])
@pytest.mark.parametrize(
    ("length_m", "good"), [(0.0, False), (-1.0, False), (0.01, True), (29.9, True), (30.0, False)]
)
def test_lengths_of_a_vehicle(name: str, length_m: float, good: bool) -> None:
    lengths = dict.fromkeys(asdict(VehicleGeometry(1, 1, 1, 1)), 1.0) | {name: length_m}
    try:
        vehicle = replace(SESSION.vehicle, geometry=VehicleGeometry(**lengths))
    except ValueError:
        assert length_m <= 0.0  # such a one cannot even be made
        return
    found = _found(replace(SESSION, vehicle=vehicle))
    assert found == ([] if good else [("warning", "/session")])


@pytest.mark.parametrize(
    ("value", "sigma", "good"),
    [(1.0, 0.0, True), (np.inf, 1.0, False), (np.nan, 1.0, False), (1.0, np.inf, False)],
)
def test_a_fact_is_two_numbers(value: float, sigma: float, good: bool) -> None:
    fact = Fact("total_mass_kg", 1500.0, 1.0)
    object.__setattr__(fact, "value", value)  # a foreign file may have what a Fact refuses
    object.__setattr__(fact, "sigma", sigma)
    found = _found(replace(SESSION, vehicle=replace(SESSION.vehicle, facts=(fact,))))
    assert found == ([] if good else [("error", "/session/facts")])


def _with_mass(added: AddedMass) -> list[tuple[str, str]]:
    return _found(replace(SESSION, mass_states=(MassState("baseline"), MassState("added", added))))


@pytest.mark.parametrize(
    ("largest", "apart", "good"),
    [(1.0, 0.9e-9, True), (1.0, 1.1e-9, False), (1e6, 0.9e-3, True), (1e6, 1.1e-3, False)],
)
def test_a_mass_matrix_is_symmetric_to_rounding(largest: float, apart: float, good: bool) -> None:
    for row, column in ((0, 1), (5, 2)):
        matrix = largest * np.eye(7)
        matrix[row, column] = apart
        found = _with_mass(AddedMass(matrix=matrix))
        assert found == ([] if good else [("error", "/mass_states/added")])


@pytest.mark.parametrize(
    ("mass_kg", "sigma_kg", "position_sigma_m", "good"),
    [
        (0.001, 0.0, 0.0, True),
        (99_999.0, 1.0, 0.1, True),
        (0.0, 1.0, 0.1, False),
        (-1.0, 1.0, 0.1, False),
        (1e5, 1.0, 0.1, False),
        (np.nan, 1.0, 0.1, False),
        (10.0, np.inf, 0.1, False),
        (10.0, 1.0, np.inf, False),
    ],
)
def test_weights(mass_kg: float, sigma_kg: float, position_sigma_m: float, good: bool) -> None:
    weight = BodyWeight(10.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    values = {"mass_kg": mass_kg, "sigma_kg": sigma_kg, "position_sigma_m": position_sigma_m}
    for name, value in values.items():
        object.__setattr__(weight, name, value)
    found = _with_mass(AddedMass((weight,), np.eye(7)))
    assert found == ([] if good else [("warning", "/mass_states/added")])


@pytest.mark.parametrize(
    ("field", "value", "severity"),
    [
        ("x_m", 29.9, ""),
        ("x_m", -29.9, ""),
        ("x_m", 30.0, "warning"),
        ("x_m", -30.0, "warning"),
        ("y_m", 29.9, ""),
        ("y_m", 30.0, "warning"),
        ("y_m", -30.0, "warning"),
        ("y_m", np.nan, "warning"),
        ("sign", -1.0, ""),
        ("sign", 0.5, "error"),
        ("sign", 0.0, "error"),
        ("unit", "g", "error"),
        ("unit", "", "error"),
    ],
)
def test_where_and_how_a_channel_is_mounted(field: str, value: Any, severity: str) -> None:
    az = Channel("az", Quantity.BODY_ACCELERATION)
    object.__setattr__(az, field, value)
    found = _found(replace(SESSION, channels=(*SESSION.channels[:2], az, SESSION.channels[3])))
    assert found == ([(severity, "/channels az")] if severity else [])


@pytest.mark.parametrize(
    ("t0_ns", "good"), [(946_684_799_999_999_999, False), (946_684_800 * 10**9, True)]
)
def test_a_run_began_after_the_clock_was_set(t0_ns: int, good: bool) -> None:
    found = _of_run(t0_ns=t0_ns, groups=())
    assert found == ([] if good else [("warning", PLACE)])
    assert not _of_run(t0_ns=t0_ns, groups=(), frames=FrameBatch.empty())


def test_an_accepted_run_has_a_sample_in_some_group() -> None:
    hub, imu = RUN.groups
    nothing = SampleGroup("A_IMU", np.zeros(0), np.zeros(0, np.int64), {}, np.zeros(0, np.uint8))
    accepted = {"status": RunStatus.ACCEPTED, "reasons": ()}
    assert not _of_run(**accepted)
    assert not _of_run(**accepted, groups=(nothing, hub))
    assert _of_run(**accepted, groups=(nothing,)) == [("error", PLACE)]
    assert not _of_run(groups=(nothing, imu))


def _group(**changes: Any) -> list[tuple[str, str]]:
    return _of_run(groups=(replace(RUN.groups[1], **changes),))


@pytest.mark.parametrize(
    ("time_s", "good"),
    [
        ([0.0, 0.125, 0.25], True),
        ([0.0, 0.125, 0.125], False),
        ([0.0, 0.25, 0.125], False),
        ([0.0, np.nan, 0.25], False),
        ([0.0, 0.125, np.inf], False),
    ],
)
def test_time_increases(time_s: list[float], good: bool) -> None:
    found = _group(time_s=np.array(time_s))
    assert found == ([] if good else [("error", f"{PLACE}/A_IMU")])


@pytest.mark.parametrize(
    ("late_ms", "good"), [(490, True), (510, False), (-490, True), (-510, False)]
)
def test_the_two_times_of_a_sample_agree_within_half_a_second(late_ms: int, good: bool) -> None:
    t_ns = RUN.groups[1].t_ns.copy()
    t_ns[1] += late_ms * 1_000_000
    assert _group(t_ns=t_ns) == ([] if good else [("warning", f"{PLACE}/A_IMU")])


LARGEST = {
    Quantity.BODY_ACCELERATION: 1e3,
    Quantity.HUB_ACCELERATION: 1e4,
    Quantity.PITCH_ACCELERATION: 1e3,
    Quantity.ROLL_ACCELERATION: 1e3,
    Quantity.PITCH_RATE: 50.0,
    Quantity.ROLL_RATE: 50.0,
    Quantity.SUSPENSION_TRAVEL: 2.0,
    Quantity.BODY_DISPLACEMENT: 5.0,
    Quantity.HUB_DISPLACEMENT: 5.0,
    Quantity.UNUSED: 1e300,
}


@pytest.mark.parametrize("quantity", LARGEST)
@pytest.mark.parametrize("sign", [1, -1])
def test_the_largest_value_that_a_bump_can_give(quantity: Quantity, sign: int) -> None:
    corner: dict[str, Any] = (
        {"corner": "FL"}
        if quantity
        in (
            Quantity.HUB_ACCELERATION,
            Quantity.SUSPENSION_TRAVEL,
            Quantity.HUB_DISPLACEMENT,
        )
        else {}
    )
    channel = Channel("x", quantity, **corner)
    session = replace(SESSION, channels=(*SESSION.channels, channel))
    limit = LARGEST[quantity]
    for value, good in ((limit, True), (1.01 * limit, quantity is Quantity.UNUSED)):
        values = {"x": np.array([0.0, sign * value, np.nan])}
        run = replace(RUN, groups=(replace(RUN.groups[1], values=values),))
        found = _found(replace(session, runs=(run,)))
        assert found == ([] if good else [("warning", f"{PLACE}/A_IMU/x")])


@pytest.mark.parametrize(
    ("quality", "values", "good"),
    [
        ([0, 0, 0], [np.nan, np.nan, np.nan], False),
        ([0, 0, 0], [np.nan, 1.0, np.nan], True),
        ([0, 2, 0], [np.nan, 1.0, np.nan], False),
        ([2, 0, 2], [1.0, 1.0, 1.0], True),
        ([1, 1, 1], [1.0, 1.0, 1.0], True),  # a gap in a counter leaves a sample usable
    ],
)
def test_a_group_has_a_usable_sample(quality: list[int], values: list[float], good: bool) -> None:
    found = _group(
        quality=np.array(quality, np.uint8),
        values={"az": np.array(values), "pitch": np.full(3, np.nan)},
    )
    assert (("warning", f"{PLACE}/A_IMU") in found) is not good
    silent = ["az", "pitch"] if np.isnan(values).all() else ["pitch"]
    inner = [where for _, where in found if where != f"{PLACE}/A_IMU"]
    assert inner == [f"{PLACE}/A_IMU/{name}" for name in silent]
    assert not _group(values={})


def _frames(**columns: Any) -> list[tuple[str, str]]:
    one = {
        "t_ns": [10**18],
        "can_id": [0x123],
        "flags": [0],
        "bus": [0],
        "length": [8],
        "data": np.zeros((len(columns.get("t_ns", [0])), 8)),
    } | columns
    types = {"t_ns": "i8", "can_id": "u4", "flags": "u2", "bus": "u1", "length": "u1", "data": "u1"}
    frames = FrameBatch(**{name: np.array(one[name], dtype) for name, dtype in types.items()})
    return _of_run(frames=frames)


@pytest.mark.parametrize(
    ("can_id", "flags", "good"),
    [
        (0x7FF, 0, True),
        (0x800, 0, False),
        (0x800, 1, True),
        (0x800, 4, True),
        (0x1FFF_FFFF, 1, True),
        (0x2000_0000, 1, False),
        (0x800, 2, False),
    ],
)
def test_an_identifier_fits_its_bits(can_id: int, flags: int, good: bool) -> None:
    found = _frames(can_id=[can_id], flags=[flags])
    assert found == ([] if good else [("error", PLACE)])


def test_lengths_flags_and_times_of_raw_frames() -> None:
    assert not _frames(length=[8], flags=[127])
    assert _frames(length=[9]) == [("error", PLACE)]
    assert _frames(flags=[128]) == [("warning", PLACE)]
    two = {"can_id": [1, 1], "flags": [0, 0], "length": [8, 8]}
    assert not _frames(t_ns=[10**18, 10**18], bus=[0, 0], **two)
    assert _frames(t_ns=[10**18, 10**18 - 1], bus=[0, 0], **two) == [("warning", PLACE)]
    assert not _frames(t_ns=[10**18, 10**18 - 1], bus=[0, 1], **two)
