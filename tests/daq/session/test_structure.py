"""What of a tree breaks schema v1: each rule with a tree that keeps it and one that does not."""

from __future__ import annotations

import numpy as np
import pytest

from daq.session.structure import check_structure
from daq.session.tree import Group

from .trees import HUB, RAW, RUN, attribute, column, member, no_attribute, tree


def _found(root: Group) -> list[str]:
    return [f"{f.severity.name.lower()} {f.where}" for f in check_structure(root)]


def test_what_is_written_keeps_the_schema() -> None:
    assert _found(tree()) == []


FRAMES = len(tree().group("runs").group("r001_baseline_roll_1").group("raw_bus0").values("t_ns"))
BREAKS: dict[str, tuple[Group, list[str]]] = {
    "another group": (member("", "mine", there=True), ["note /mine"]),
    "no runs": (
        member("", "runs", there=False),
        ["error /", "error /"],  # and the first of them is named as the default
    ),
    "no channels": (member("", "channels", there=False), ["error /"]),
    "no mass states": (member("", "mass_states", there=False), ["error /"]),
    "no default": (no_attribute("", "default"), []),
    "another default": (attribute("", "default", RUN), []),
    "a default of nothing": (attribute("", "default", f"{RUN}/x"), ["error /"]),
    "a group in the configuration": (member("config", "x", there=True), []),
    "dbc as numbers": (column("config", "dbc", np.zeros(3, "i8")), ["error /config/dbc"]),
    "dbc as a table": (column("config", "dbc", np.zeros((2, 2), "u1")), ["error /config/dbc"]),
    "another dbc": (column("config", "dbc", np.zeros(3, "u1")), ["error /config/dbc"]),
    "the vehicle as a number": (attribute("session", "vehicle", 1), ["error /session"]),
    "a whole length": (attribute("session", "a_m", 1), []),
    "a length in words": (attribute("session", "a_m", "1"), ["error /session"]),
    "no length": (no_attribute("session", "t_r_m"), ["error /session"]),
    "a structure in words": (
        attribute("session", "structure_cg_offset", "no"),
        ["error /session"],
    ),
    "no structure": (no_attribute("session", "structure_cg_offset"), []),
    "another group of the session": (
        member("session", "x", there=True),
        ["note /session/x"],
    ),
    "no facts": (member("session", "facts", there=False), []),
    "no unit": (column("channels", "unit", None), ["error /channels"]),
    "no gain": (column("channels", "gain", None), []),
    "gains as whole numbers": (
        column("channels", "gain", np.ones(4, "i8")),
        ["error /channels/gain"],
    ),
    "names as numbers": (column("channels", "name", np.ones(4)), ["error /channels/name"]),
    "names as a table": (
        column("channels", "name", np.full((4, 1), b"x")),
        ["error /channels/name"],
    ),
    "signs of another width": (column("channels", "sign", np.ones(4, "f4")), []),
    "orders without a sign": (column("channels", "low_pass_order", np.ones(4, "u1")), []),
    "one gain less": (column("channels", "gain", np.ones(3)), ["error /channels"]),
    "another column": (column("channels", "x", np.ones(9)), ["note /channels/x"]),
    "the count of the channels": (column("channels", "channel", np.arange(4)), []),
    "no place ± of a weight": (column("mass_states/added", "position_sigma_m", None), []),
    "no mass": (
        column("mass_states/added", "mass_kg", None),
        ["error /mass_states/added"],
    ),
    "no matrix": (
        column("mass_states/added", "delta_mass", None),
        ["error /mass_states/added"],
    ),
    "a matrix of whole numbers": (
        column("mass_states/added", "delta_mass", np.eye(7, dtype="i8")),
        ["error /mass_states/added"],
    ),
    "order in words": (
        attribute("mass_states/added", "order", "first"),
        ["error /mass_states/added"],
    ),
    **{
        f"no {name}": (no_attribute(RUN, name), [f"error /{RUN}"])
        for name in ("mass_state", "excitation", "repeat", "t0_ns", "bump_s", "status", "reasons")
    },
    "a whole bump": (attribute(RUN, "bump_s", 1), []),
    "a bump in words": (attribute(RUN, "bump_s", "1"), [f"error /{RUN}"]),
    "losses in words": (attribute(RUN, "lost_crc_bad", "few"), [f"error /{RUN}"]),
    "no losses": (no_attribute(RUN, "lost_crc_bad"), []),
    "another group of a run": (member(RUN, "x", there=True), [f"note /{RUN}/x"]),
    "no raw frames": (member(RUN, "raw_bus0", there=False), []),
    "no events": (member(RUN, "events", there=False), [f"error /{RUN}"]),
    "no text of events": (column(f"{RUN}/events", "text", None), [f"error /{RUN}/events"]),
    "no list of channels": (no_attribute(HUB, "channels"), [f"error /{HUB}", *["note"] * 2]),
    "quality as signed numbers": (column(HUB, "quality", np.zeros(500, "i8")), []),
    "quality as floats": (column(HUB, "quality", np.zeros(500)), [f"error /{HUB}/quality"]),
    "no quality": (column(HUB, "quality", None), [f"error /{HUB}"]),
    "a frame column less": (column(RAW, "can_id", None), [f"error /{RAW}"]),
    "the bus in words": (attribute(RAW, "bus", "can0"), [f"error /{RAW}"]),
    "data of 8 bytes": (column(RAW, "data", np.zeros((FRAMES, 8), "u1")), []),
    "data of 64 bytes": (column(RAW, "data", np.zeros((FRAMES, 64), "u1")), []),
    "data of 16 bytes": (column(RAW, "data", np.zeros((FRAMES, 16), "u1")), [f"error /{RAW}"]),
    "a row of data less": (
        column(RAW, "data", np.zeros((FRAMES - 1, 8), "u1")),
        [f"error /{RAW}"],
    ),
    "signed data": (column(RAW, "data", np.zeros((FRAMES, 8), "i1")), [f"error /{RAW}"]),
    "no data": (column(RAW, "data", None), [f"error /{RAW}"]),
    "no times": (column(RAW, "t_ns", None), [f"error /{RAW}"] * 2),
    "another column of frames": (column(RAW, "x", np.zeros(3)), [f"note /{RAW}/x"]),
}


@pytest.mark.parametrize("name", BREAKS)
def test_a_change_of_a_tree(name: str) -> None:
    changed, expected = BREAKS[name]
    found = _found(changed)
    assert len(found) == len(expected)
    assert all(f.startswith(e) for f, e in zip(sorted(found), sorted(expected), strict=True)), found
