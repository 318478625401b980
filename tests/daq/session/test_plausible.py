"""What is hard to believe in a session: each limit on both sides, in numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import RunStatus, SampleGroup
from daq.session.validate import check_session
from daq.sessions import Session
from daq.vehicle import AddedMass, BodyWeight, Fact, MassState
from dbc import FrameBatch

from ..small_session import small_session

SESSION = small_session()
RUN = SESSION.runs[0]
IMU = RUN.groups[1]
PLACE = "/runs/r001_baseline_roll_1"


def _found(**changes: Any) -> list[tuple[str, str]]:
    """Return severity and place of each finding on a session with some parts changed."""
    session: Session = replace(SESSION, **changes)
    return [(f.severity.name.lower(), f.where) for f in check_session(session)]


def _of_run(**changes: Any) -> list[tuple[str, str]]:
    return _found(runs=(replace(RUN, **changes),))


def _forced(thing: Any, **values: Any) -> Any:
    """Return a noun with values that it refuses itself, as a foreign file may have them."""
    for name, value in values.items():
        object.__setattr__(thing, name, value)
    return thing


def test_the_session_itself_is_plausible() -> None:
    assert not _found()
    assert not _found(vehicle=replace(SESSION.vehicle, geometry=None))


def _with_mass(added: AddedMass) -> list[tuple[str, str]]:
    return _found(mass_states=(MassState("baseline"), MassState("added", added)))


@pytest.mark.parametrize(
    ("largest", "apart", "good"),
    [(1.0, 0.9e-9, True), (1.0, 1.1e-9, False), (1e6, 0.9e-3, True), (1.0, np.nan, False)],
)
def test_a_mass_matrix_is_finite_and_symmetric(largest: float, apart: float, good: bool) -> None:
    matrix = largest * np.eye(7)
    matrix[5, 2] = apart
    found = _with_mass(AddedMass(matrix=matrix))
    assert found == ([] if good else [("error", "/mass_states/added")])


@pytest.mark.parametrize(
    ("field", "value", "severity"),
    [
        ("sign", -1.0, ""),
        ("sign", 0.5, "error"),
        ("unit", "g", "error"),
    ],
)
def test_where_and_how_a_channel_is_mounted(field: str, value: Any, severity: str) -> None:
    az = _forced(Channel("az", Quantity.BODY_ACCELERATION), **{field: value})
    found = _found(channels=(*SESSION.channels[:2], az, SESSION.channels[3]))
    assert found == ([(severity, "/channels az")] if severity else [])


@pytest.mark.parametrize(
    ("time_s", "good"),
    [([0.0, 0.125, 0.25], True), ([0.0, 0.125, 0.125], False), ([0.0, np.nan, 0.25], False)],
)
def test_time_increases(time_s: list[float], good: bool) -> None:
    found = _of_run(groups=(replace(IMU, time_s=np.array(time_s)),))
    assert found == ([] if good else [("error", f"{PLACE}/A_IMU")])


@pytest.mark.parametrize(
    ("quantity", "limit"),
    [
        (Quantity.BODY_ACCELERATION, 1e3),
        (Quantity.HUB_ACCELERATION, 1e4),
        (Quantity.PITCH_ACCELERATION, 1e3),
        (Quantity.ROLL_RATE, 50.0),
        (Quantity.SUSPENSION_TRAVEL, 2.0),
        (Quantity.BODY_DISPLACEMENT, 5.0),
        (Quantity.UNUSED, np.inf),
    ],
)
def test_the_largest_value_that_a_bump_can_give(quantity: Quantity, limit: float) -> None:
    has_corner = quantity in (Quantity.HUB_ACCELERATION, Quantity.SUSPENSION_TRAVEL)
    corner: dict[str, Any] = {"corner": "FL"} if has_corner else {}
    channels = (*SESSION.channels, Channel("x", quantity, **corner))
    for value, good in ((min(limit, 1e300), True), (-1.01 * min(limit, 1e300), limit > 1e300)):
        group = replace(IMU, values={"x": np.array([0.0, value, np.nan])})
        found = _found(channels=channels, runs=(replace(RUN, groups=(group,)),))
        assert found == ([] if good else [("warning", f"{PLACE}/A_IMU/x")])


@pytest.mark.parametrize(
    ("columns", "severity"),
    [
        ({"can_id": [0x7FF, 0]}, ""),
        ({"can_id": [0x800, 0]}, "error"),
        ({"can_id": [0x800, 0], "flags": [1, 0]}, ""),
        ({"can_id": [0x800, 0], "flags": [4, 0]}, ""),
        ({"can_id": [0x2000_0000, 0], "flags": [1, 0]}, "error"),
        ({"length": [9, 8]}, "error"),
        ({"t_ns": [10**18, 10**18 - 1]}, "warning"),
        ({"t_ns": [10**18, 10**18 - 1], "bus": [0, 1]}, ""),
    ],
)
def test_raw_frames(columns: dict[str, list[int]], severity: str) -> None:
    whole: dict[str, Any] = {"t_ns": [10**18] * 2, "can_id": [0, 0], "flags": [0, 0]}
    whole |= {"bus": [0, 0], "length": [8, 8], "data": np.zeros((2, 8))} | columns
    types = {"t_ns": "i8", "can_id": "u4", "flags": "u2", "bus": "u1", "length": "u1", "data": "u1"}
    frames = FrameBatch(**{name: np.array(whole[name], dtype) for name, dtype in types.items()})
    assert _of_run(frames=frames) == ([(severity, PLACE)] if severity else [])


@pytest.mark.parametrize(
    ("value", "sigma", "good"), [(1.0, 0.0, True), (np.inf, 1.0, False), (1.0, np.nan, False)]
)
def test_a_fact_is_two_numbers(value: float, sigma: float, good: bool) -> None:
    fact = _forced(Fact("total_mass_kg", 1500.0, 1.0), value=value, sigma=sigma)
    found = _found(vehicle=replace(SESSION.vehicle, facts=(fact,)))
    assert found == ([] if good else [("error", "/session/facts")])


@pytest.mark.parametrize(("late_ms", "good"), [(490, True), (510, False), (-510, False)])
def test_the_two_times_of_a_sample_agree_within_half_a_second(late_ms: int, good: bool) -> None:
    t_ns = IMU.t_ns.copy()
    t_ns[1] += late_ms * 1_000_000
    found = _of_run(groups=(replace(IMU, t_ns=t_ns),))
    assert found == ([] if good else [("warning", f"{PLACE}/A_IMU")])


@pytest.mark.parametrize(
    ("quality", "values", "good"),
    [
        ([0, 0, 0], [np.nan, 1.0, np.nan], True),
        ([0, 2, 0], [np.nan, 1.0, np.nan], False),
        ([2, 0, 2], [1.0, 1.0, 1.0], True),
        ([1, 1, 1], [1.0, 1.0, 1.0], True),  # a gap in a counter leaves a sample usable
    ],
)
def test_a_group_has_a_usable_sample(quality: list[int], values: list[float], good: bool) -> None:
    group = replace(IMU, quality=np.array(quality, np.uint8), values={"az": np.array(values)})
    assert _of_run(groups=(group,)) == ([] if good else [("warning", f"{PLACE}/A_IMU")])


@pytest.mark.parametrize(
    ("mass_kg", "sigma_kg", "position_sigma_m", "good"),
    [
        (99_999.0, 1.0, 0.1, True),
        (0.0, 1.0, 0.1, False),
        (10.0, np.inf, 0.1, False),
        (10.0, 1.0, np.inf, False),
    ],
)
def test_weights(mass_kg: float, sigma_kg: float, position_sigma_m: float, good: bool) -> None:
    values = {"mass_kg": mass_kg, "sigma_kg": sigma_kg, "position_sigma_m": position_sigma_m}
    weight = _forced(BodyWeight(10.0, 0.0, 0.0, 0.0, 0.0, 0.0), **values)
    found = _with_mass(AddedMass((weight,), np.eye(7)))
    assert found == ([] if good else [("warning", "/mass_states/added")])


def test_samples_and_the_clock_of_a_run() -> None:
    nothing = SampleGroup("A_IMU", np.zeros(0), np.zeros(0, np.int64), {}, np.zeros(0, np.uint8))
    accepted = {"status": RunStatus.ACCEPTED, "reasons": ()}
    assert not _of_run(**accepted, groups=(nothing, RUN.groups[0]))
    assert _of_run(**accepted, groups=(nothing,)) == [("error", PLACE)]
    year_2000_ns = 946_684_800 * 10**9
    assert _of_run(t0_ns=year_2000_ns - 1, groups=()) == [("warning", PLACE)]
    assert not _of_run(t0_ns=year_2000_ns, groups=())
    assert not _of_run(t0_ns=year_2000_ns - 1, groups=(), frames=FrameBatch.empty())
