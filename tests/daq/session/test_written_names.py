"""Names and texts of a session file, each limit on both sides."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import pytest

from daq.errors import InputError
from daq.runs import Event
from daq.session import read_session, write_session
from daq.sessions import Session
from daq.vehicle import MassState
from dbc import FrameBatch

from ..small_session import small_session

SESSION = small_session()
_RUN = replace(SESSION.runs[0], groups=SESSION.runs[0].groups[1:], frames=FrameBatch.empty())
BARE = replace(SESSION, runs=(_RUN,), mass_states=SESSION.mass_states[:1], provenance={})


def _renamed(kind: str, name: str) -> Session:
    """Return a session in which a channel, a group or a mass state has another name."""
    run = BARE.runs[0]
    if kind == "state":
        return replace(BARE, mass_states=(*BARE.mass_states, MassState(name)))
    group = run.groups[0]
    if kind == "group":
        return replace(BARE, runs=(replace(run, groups=(replace(group, name=name),)),))
    channels = tuple(replace(c, name=name) if c.name == "az" else c for c in BARE.channels)
    values = {name if n == "az" else n: v for n, v in group.values.items()}
    runs = (replace(run, groups=(replace(group, values=values),)),)
    return replace(BARE, channels=channels, runs=runs)


@pytest.mark.parametrize("kind", ["channel", "group", "state"])
@pytest.mark.parametrize(
    ("name", "good"),
    [
        ("q", True),
        ("q" * 64, True),
        ("q" * 65, False),
        ("ä" * 32, True),
        ("ä" * 33, False),
        ("a b-c", True),
        ("", False),
        ("a/b", False),
        ("a.b", False),
        ("a\tb", False),
    ],
)
def test_a_name_has_1_to_64_printable_bytes(
    tmp_path: Path, kind: str, name: str, good: bool
) -> None:
    path, session = tmp_path / "car.h5", _renamed(kind, name)
    if not good:
        with pytest.raises(InputError, match="cannot be written"):
            write_session(path, session)
        return
    write_session(path, session)
    found = read_session(path)
    assert [channel.name for channel in found.channels] == [c.name for c in session.channels]
    assert {state.name for state in found.mass_states} == {s.name for s in session.mass_states}
    assert [g.name for g in found.runs[0].groups] == [g.name for g in session.runs[0].groups]


@pytest.mark.parametrize(("text", "good"), [("ä" * 80, True), ("ä" * 80 + "b", False)])
def test_a_text_of_an_event_has_160_bytes(tmp_path: Path, text: str, good: bool) -> None:
    run = replace(BARE.runs[0], events=(Event(1, "note", 0.0, text),))
    session = replace(BARE, runs=(run,))
    if good:
        write_session(tmp_path / "car.h5", session)
        assert read_session(tmp_path / "car.h5").runs[0].events == run.events
        return
    with pytest.raises(InputError, match="longer than 160 bytes"):
        write_session(tmp_path / "car.h5", session)


def test_the_first_group_of_the_first_run_is_the_default(tmp_path: Path) -> None:
    path = tmp_path / "car.h5"
    write_session(path, SESSION)
    with h5py.File(path) as file:
        assert file.attrs["default"] == "runs/r001_baseline_roll_1/HUB_Front"
        hub = file["runs/r002_baseline_roll_2/HUB_Front"]
        assert hub.attrs["signal"] == "hub_fl"
        assert hub.attrs["auxiliary_signals"].tolist() == [b"hub_fr"]
        assert (hub.attrs["axes"], hub.attrs["channels"]) == ("time", "hub_fl\nhub_fr")
        assert hub["quality"].attrs["flag_masks"].tolist() == [1, 2, 4, 8, 16, 32]
        assert len(hub["quality"].attrs["flag_meanings"].split()) == 6
        assert hub["hub_fl"].attrs["dbc_signal"] == "HUB_Front.a"
        assert hub["hub_fl"].attrs["quantity"] == "hub_acceleration"
        assert hub["time"].attrs["units"] == "s"
        assert hub["t_ns"].attrs["units"] == "ns"
        assert file["mass_states/added"].attrs["order"] == 1
    none = replace(BARE, runs=(replace(BARE.runs[0], groups=()), *SESSION.runs[1:2]))
    write_session(path, none)
    with h5py.File(path) as file:
        assert "default" not in file.attrs
