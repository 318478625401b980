"""Names and texts of a session file, each limit on both sides."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daq.errors import InputError
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
