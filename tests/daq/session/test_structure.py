"""What of a tree breaks schema v1: each rule with a tree that keeps it and one that does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.session import write_session
from daq.session.load import load_tree
from daq.session.structure import check_structure
from daq.session.tree import Dataset, Group

from ..small_session import small_session

RUN = "runs/r001_baseline_roll_1"
HUB = f"{RUN}/HUB_Front"
RAW = f"{RUN}/raw_bus0"


@cache
def _tree() -> Group:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "car.h5"
        session = small_session()
        write_session(path, replace(session, runs=session.runs[:1]))
        return load_tree(path)


def _changed(group: Group, path: str, change: Callable[[Group], Group]) -> Group:
    """Return a tree with another group in the place of the one at a path."""
    if not path:
        return change(group)
    name, _, rest = path.partition("/")
    inner = _changed(group.groups[name], rest, change)
    return replace(group, groups={**group.groups, name: inner})


def _attribute(path: str, name: str, value: Any) -> Group:
    return _changed(_tree(), path, lambda g: replace(g, attributes={**g.attributes, name: value}))


def _no_attribute(path: str, name: str) -> Group:
    def change(group: Group) -> Group:
        kept = {key: value for key, value in group.attributes.items() if key != name}
        return replace(group, attributes=kept)

    return _changed(_tree(), path, change)


def _column(path: str, name: str, values: NDArray[Any] | None) -> Group:
    def change(group: Group) -> Group:
        kept = {key: value for key, value in group.datasets.items() if key != name}
        if values is not None:
            about = group.datasets[name].attributes if name in group.datasets else {}
            kept[name] = Dataset(values, about)
        return replace(group, datasets=kept)

    return _changed(_tree(), path, change)


def _member(path: str, name: str, *, there: bool) -> Group:
    def change(group: Group) -> Group:
        kept = {key: value for key, value in group.groups.items() if key != name}
        return replace(group, groups=kept | ({name: Group()} if there else {}))

    return _changed(_tree(), path, change)


def _found(tree: Group) -> list[str]:
    return [f"{f.severity.name.lower()} {f.where}" for f in check_structure(tree)]


def test_what_is_written_keeps_the_schema() -> None:
    assert _found(_tree()) == []


FRAMES = len(_tree().group("runs").group("r001_baseline_roll_1").group("raw_bus0").values("t_ns"))
BREAKS: dict[str, tuple[Group, list[str]]] = {
    "another group": (_member("", "mine", there=True), ["note /mine"]),
    "no runs": (
        _member("", "runs", there=False),
        ["error /", "error /"],  # and the first of them is named as the default
    ),
    "no channels": (_member("", "channels", there=False), ["error /"]),
    "no mass states": (_member("", "mass_states", there=False), ["error /"]),
    "no default": (_no_attribute("", "default"), []),
    "another default": (_attribute("", "default", RUN), []),
    "a default of nothing": (_attribute("", "default", f"{RUN}/x"), ["error /"]),
    "a group in the configuration": (_member("config", "x", there=True), []),
    "dbc as numbers": (_column("config", "dbc", np.zeros(3, "i8")), ["error /config/dbc"]),
    "dbc as a table": (_column("config", "dbc", np.zeros((2, 2), "u1")), ["error /config/dbc"]),
    "another dbc": (_column("config", "dbc", np.zeros(3, "u1")), ["error /config/dbc"]),
    "the vehicle as a number": (_attribute("session", "vehicle", 1), ["error /session"]),
    "a whole length": (_attribute("session", "a_m", 1), []),
    "a length in words": (_attribute("session", "a_m", "1"), ["error /session"]),
    "no length": (_no_attribute("session", "t_r_m"), ["error /session"]),
    "a structure in words": (
        _attribute("session", "structure_cg_offset", "no"),
        ["error /session"],
    ),
    "no structure": (_no_attribute("session", "structure_cg_offset"), []),
    "another group of the session": (
        _member("session", "x", there=True),
        ["note /session/x"],
    ),
    "no facts": (_member("session", "facts", there=False), []),
    "no unit": (_column("channels", "unit", None), ["error /channels"]),
    "no gain": (_column("channels", "gain", None), []),
    "gains as whole numbers": (
        _column("channels", "gain", np.ones(4, "i8")),
        ["error /channels/gain"],
    ),
    "names as numbers": (_column("channels", "name", np.ones(4)), ["error /channels/name"]),
    "names as a table": (
        _column("channels", "name", np.full((4, 1), b"x")),
        ["error /channels/name"],
    ),
    "signs of another width": (_column("channels", "sign", np.ones(4, "f4")), []),
    "orders without a sign": (_column("channels", "low_pass_order", np.ones(4, "u1")), []),
    "one gain less": (_column("channels", "gain", np.ones(3)), ["error /channels"]),
    "another column": (_column("channels", "x", np.ones(9)), ["note /channels/x"]),
    "the count of the channels": (_column("channels", "channel", np.arange(4)), []),
    "no place ± of a weight": (_column("mass_states/added", "position_sigma_m", None), []),
    "no mass": (
        _column("mass_states/added", "mass_kg", None),
        ["error /mass_states/added"],
    ),
    "no matrix": (
        _column("mass_states/added", "delta_mass", None),
        ["error /mass_states/added"],
    ),
    "a matrix of whole numbers": (
        _column("mass_states/added", "delta_mass", np.eye(7, dtype="i8")),
        ["error /mass_states/added"],
    ),
    "order in words": (
        _attribute("mass_states/added", "order", "first"),
        ["error /mass_states/added"],
    ),
    **{
        f"no {name}": (_no_attribute(RUN, name), [f"error /{RUN}"])
        for name in ("mass_state", "excitation", "repeat", "t0_ns", "bump_s", "status", "reasons")
    },
    "a whole bump": (_attribute(RUN, "bump_s", 1), []),
    "a bump in words": (_attribute(RUN, "bump_s", "1"), [f"error /{RUN}"]),
    "losses in words": (_attribute(RUN, "lost_crc_bad", "few"), [f"error /{RUN}"]),
    "no losses": (_no_attribute(RUN, "lost_crc_bad"), []),
    "another group of a run": (_member(RUN, "x", there=True), [f"note /{RUN}/x"]),
    "no raw frames": (_member(RUN, "raw_bus0", there=False), []),
    "no events": (_member(RUN, "events", there=False), [f"error /{RUN}"]),
    "no text of events": (_column(f"{RUN}/events", "text", None), [f"error /{RUN}/events"]),
    "no list of channels": (_no_attribute(HUB, "channels"), [f"error /{HUB}", *["note"] * 2]),
    "quality as signed numbers": (_column(HUB, "quality", np.zeros(500, "i8")), []),
    "quality as floats": (_column(HUB, "quality", np.zeros(500)), [f"error /{HUB}/quality"]),
    "no quality": (_column(HUB, "quality", None), [f"error /{HUB}"]),
    "a frame column less": (_column(RAW, "can_id", None), [f"error /{RAW}"]),
    "the bus in words": (_attribute(RAW, "bus", "can0"), [f"error /{RAW}"]),
    "data of 8 bytes": (_column(RAW, "data", np.zeros((FRAMES, 8), "u1")), []),
    "data of 64 bytes": (_column(RAW, "data", np.zeros((FRAMES, 64), "u1")), []),
    "data of 16 bytes": (_column(RAW, "data", np.zeros((FRAMES, 16), "u1")), [f"error /{RAW}"]),
    "a row of data less": (
        _column(RAW, "data", np.zeros((FRAMES - 1, 8), "u1")),
        [f"error /{RAW}"],
    ),
    "signed data": (_column(RAW, "data", np.zeros((FRAMES, 8), "i1")), [f"error /{RAW}"]),
    "no data": (_column(RAW, "data", None), [f"error /{RAW}"]),
    "no times": (_column(RAW, "t_ns", None), [f"error /{RAW}"] * 2),
    "another column of frames": (_column(RAW, "x", np.zeros(3)), [f"note /{RAW}/x"]),
}


@pytest.mark.parametrize("name", BREAKS)
def test_a_change_of_a_tree(name: str) -> None:
    tree, expected = BREAKS[name]
    found = _found(tree)
    assert len(found) == len(expected)
    assert all(f.startswith(e) for f, e in zip(sorted(found), sorted(expected), strict=True)), found
