"""Files that can be read and are not right: what is wrong is found, each in its place."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import RunStatus
from daq.session import Severity, validate_session, write_session
from daq.session.plausible import check_session
from daq.sessions import Session
from daq.vehicle import AddedMass, MassState, VehicleGeometry

from ..small_session import small_session

pytestmark = pytest.mark.usefixtures("without_children")
RUN = "runs/r001_baseline_roll_1"
HUB = f"{RUN}/HUB_Front"


def _without(*names: str) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        for name in names:
            del file[name]

    return edit


def _attribute(place: str, name: str, value: object = None) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        if value is None:
            del file[place].attrs[name]
        else:
            file[place].attrs[name] = value

    return edit


def _instead(name: str, values: object) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return edit


def _other_text(file: h5py.File) -> None:
    file["config/dbc"][0] = 66 ^ 1


@pytest.mark.parametrize(
    ("edit", "where", "what"),
    [
        (_without("mass_states"), "/", "group mass_states is absent"),
        (_without("channels/unit"), "/channels", "column unit is absent"),
        (_instead("channels/x_m", np.zeros(9)), "/channels", "not equally long"),
        (_instead("channels/gain", np.full(4, b"a")), "/channels/gain", "has type"),
        (_attribute("/", "default", "runs/r009"), "/", "names runs/r009, which is absent"),
        (_attribute("session", "vehicle"), "/session", "attribute vehicle is absent"),
        (_attribute("session", "a_m"), "/session", "attribute a_m is absent, the others are not"),
        (_attribute("session", "structure_symmetric", "yes"), "/session", "'yes', not of type int"),
        (_without("session/facts/sigma"), "/session/facts", "column sigma is absent"),
        (_other_text, "/config/dbc", "does not match its attribute sha256"),
        (_attribute("config/dbc", "sha256"), "/config/dbc", "sha256 is absent"),
        (_attribute("mass_states/added", "order"), "/mass_states/added", "order is absent"),
        (_instead("mass_states/added/delta_mass", np.eye(6)), "/mass_states/added", "not a 7 x 7"),
        (_attribute(RUN, "t0_ns", 1.5), f"/{RUN}", "t0_ns is 1.5, not of type int"),
        (_attribute(RUN, "sample_groups", "HUB_Front\nX"), f"/{RUN}", "group X is absent"),
        (_without(f"{RUN}/events"), f"/{RUN}", "group events is absent"),
        (_without(f"{HUB}/time"), f"/{HUB}", "column time is absent"),
        (_instead(f"{HUB}/hub_fl", np.zeros(499)), f"/{HUB}", "not equally long"),
        (_attribute(f"{HUB}/hub_fl", "units"), f"/{HUB}/hub_fl", "attribute units is absent"),
        (_attribute(HUB, "channels", "hub_fl\nx"), f"/{HUB}", "column x is absent"),
        (_instead(f"{RUN}/raw_bus0/data", np.zeros((3, 9), "u1")), f"/{RUN}/raw_bus0", "data is"),
        (_attribute(f"{RUN}/raw_bus1", "bus"), f"/{RUN}/raw_bus1", "attribute bus is absent"),
        (_attribute(RUN, "excitation", "sneeze"), "/", "sneeze"),
        (
            _instead("channels/name", np.array([b"x", b"hub_fr", b"az", b"pitch"])),
            "/",
            "hub_fl is no",
        ),
        (_attribute(RUN, "repeat", np.uint64(2**63)), "/", "is not a whole number of 64 bits"),
    ],
)
def test_what_breaks_the_schema(
    tmp_path: Path, edit: Callable[[h5py.File], None], where: str, what: str
) -> None:
    path = tmp_path / "car.h5"
    write_session(path, small_session())
    with h5py.File(path, "r+") as file:
        edit(file)
    findings = validate_session(path)
    errors = [f for f in findings if f.severity is Severity.ERROR]
    assert any(f.where == where and what in f.text for f in errors), findings


def test_additions_are_noted_and_allowed(tmp_path: Path) -> None:
    path = tmp_path / "car.h5"
    write_session(path, small_session())
    with h5py.File(path, "r+") as file:
        file["identification/1/x"] = np.zeros(3)
        file["channels/serial"] = np.zeros(4, "S8")
    notes = [f.where for f in validate_session(path) if f.severity is Severity.NOTE]
    assert notes == ["/identification", "/channels/serial"]


def _changed(session: Session, **changes: Any) -> Session:
    """Change the first group of the first run, and keep only that."""
    run = session.runs[0]
    group = replace(run.groups[0], **changes)
    return replace(session, runs=(replace(run, groups=(group,)),))


def _findings(session: Session) -> list[str]:
    return [f"{f.severity.name.lower()} {f.where}: {f.text}" for f in check_session(session)]


def test_a_good_session_is_plausible() -> None:
    session = small_session()
    assert _findings(session) == []


def test_what_contradicts_itself() -> None:
    session = small_session()
    run, group = session.runs[0], session.runs[0].groups[0]
    where = f"error /{HUB}"
    assert _findings(_changed(session, time_s=group.time_s[::-1])) == [
        f"{where}: time is not increasing"
    ]
    infinite = {"hub_fl": np.where(np.arange(500) < 2, np.inf, 0.0)}
    assert _findings(_changed(session, values=infinite)) == [
        f"{where}/hub_fl: 2 values are infinite"
    ]
    twice = replace(session, runs=(run, run))
    assert _findings(twice) == ["error /runs/r002_baseline_roll_1: occurs in the file twice"]
    alone = replace(session, mass_states=session.mass_states[1:], runs=(run,))
    assert _findings(alone) == [f"error /{RUN}: mass state baseline is not described"]
    skew = np.eye(7)
    skew[0, 1] = 1.0
    skewed = replace(session, mass_states=(MassState("baseline", AddedMass(matrix=skew)),))
    assert "error /mass_states/baseline: delta_mass is not symmetric" in _findings(skewed)
    empty = replace(run, status=RunStatus.ACCEPTED, groups=())
    assert _findings(replace(session, runs=(empty,))) == [
        f"error /{RUN}: is accepted but has no sample"
    ]
    ids = replace(run.frames, can_id=np.full(len(run.frames), 0x2000_0000, np.uint32))
    assert _findings(replace(session, runs=(replace(run, frames=ids),))) == [
        f"error /{RUN}: a raw frame has an identifier that no frame can have"
    ]
    long = replace(run.frames, length=np.full(len(run.frames), 65, np.uint8))
    assert _findings(replace(session, runs=(replace(run, frames=long),))) == [
        f"error /{RUN}: a raw frame is longer than its data"
    ]
    degrees = Channel("r", Quantity.ROLL_RATE)
    object.__setattr__(degrees, "unit", "deg/s")  # a channel refuses it; a foreign file may have it
    strange = replace(session, channels=(*session.channels, degrees))
    assert _findings(strange) == ["error /channels r: roll_rate is in deg/s, not rad/s"]
    double = replace(session, channels=(*session.channels, session.channels[2]))
    assert _findings(double) == ["error /channels: az occurs in it twice"]


def test_what_is_hard_to_believe() -> None:
    session = small_session()
    run, group = session.runs[0], session.runs[0].groups[0]
    late = _findings(_changed(session, t_ns=group.t_ns + 10**9))
    assert len(late) == 1
    assert "time and t_ns are up to 1.1 s apart" in late[0]
    milli = _findings(_changed(session, values={"hub_fl": np.full(500, 9.81e5)}))
    assert milli == [f"warning /{HUB}/hub_fl: reaches 9.81e+05 m/s2: wrong scale or unit?"]
    unusable = _findings(_changed(session, quality=np.full(500, 2, np.uint8)))
    assert unusable == [f"warning /{HUB}: has no usable sample"]
    nowhere = replace(session.vehicle, geometry=VehicleGeometry(1.2, 1500.0, 0.7, 0.7))
    assert _findings(replace(session, vehicle=nowhere)) == ["warning /session: b_m is 1500 m"]
    assert _findings(replace(session, runs=())) == ["warning /runs: there is no run"]
    back = replace(run.frames, t_ns=run.frames.t_ns[::-1].copy(), bus=np.zeros(100, np.uint8))
    assert _findings(replace(session, runs=(replace(run, frames=back),))) == [
        f"warning /{RUN}: the time stamps of bus 0 go back 99 times"
    ]
    silent = replace(run, reasons=())
    assert _findings(replace(session, runs=(silent,))) == [
        f"warning /{RUN}: is rejected without a reason"
    ]
