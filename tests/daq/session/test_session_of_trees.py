"""From the tree of a session file to the session: what is refused, and what older files lack."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import InputError
from daq.runs import RunStatus
from daq.session.read import session_of
from daq.session.tree import Group
from daq.vehicle import BodyWeight

from .trees import HUB, RAW, RUN, attribute, column, member, no_attribute, tree

REFUSED: dict[str, tuple[Group, str]] = {
    "t0 beyond 64 bits": (attribute(RUN, "t0_ns", 2**63), "64 bits"),
    "t0 below 64 bits": (attribute(RUN, "t0_ns", -(2**63) - 1), "64 bits"),
    "t0 with a fraction": (attribute(RUN, "t0_ns", 1.0), "64 bits"),
    "a bump in words": (attribute(RUN, "bump_s", "1"), "not a number"),
    "a length in words": (attribute("session", "a_m", "1"), "not a number"),
    "bus 256": (attribute(RAW, "bus", 256), "no bus 256"),
    "bus -1": (attribute(RAW, "bus", -1), "no bus -1"),
    "another excitation": (attribute(RUN, "excitation", "jump"), "jump"),
    "another status": (attribute(RUN, "status", "maybe"), "maybe"),
    "no status": (no_attribute(RUN, "status"), "status is absent"),
    "no vehicle": (no_attribute("session", "vehicle"), "vehicle is absent"),
    "no channels": (member("", "channels", there=False), "channels is absent"),
    "no events": (member(RUN, "events", there=False), "events is absent"),
    "no samples": (member(RUN, "HUB_Front", there=False), "HUB_Front is absent"),
    "a sample less": (column(HUB, "quality", np.zeros(499, "u1")), "quality"),
    "no times": (column(HUB, "time", None), "time is absent"),
    "a channel that is not described": (
        column("channels", "name", np.array([b"x", b"hub_fr", b"az", b"pitch"])),
        "hub_fl is not a channel",
    ),
    "names as numbers": (column("channels", "name", np.zeros(4)), "column name"),
    "gains as text": (column("channels", "gain", np.full(4, b"1")), "column gain"),
    "gains as a table": (column("channels", "gain", np.ones((4, 1))), "column gain"),
    "a gain less": (column("channels", "gain", np.ones(3)), "shorter|longer|zip"),
    "another quantity": (column("channels", "quantity", np.full(4, b"x")), "x"),
    "a matrix of another size": (column("mass_states/added", "delta_mass", np.eye(6)), "6"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_tree_that_is_no_session_is_refused(name: str) -> None:
    changed, why = REFUSED[name]
    with pytest.raises(InputError, match=f"is damaged: .*({why})") as refused:
        session_of(changed, "a.h5")
    assert refused.value.where == "a.h5"


@pytest.mark.parametrize("t0_ns", [2**63 - 1, -(2**63), 0])
def test_times_of_64_bits(t0_ns: int) -> None:
    assert session_of(attribute(RUN, "t0_ns", t0_ns), "a").runs[0].t0_ns == t0_ns


@pytest.mark.parametrize("bus", [0, 255])
def test_buses_of_8_bits(bus: int) -> None:
    frames = session_of(attribute(RAW, "bus", bus), "a").runs[0].frames
    assert bus in frames.bus
    assert np.all(np.diff(frames.t_ns) >= 0)


def test_frames_of_one_bus_keep_their_order() -> None:
    one = session_of(member(RUN, "raw_bus1", there=False), "a").runs[0].frames
    assert set(one.bus.tolist()) == {0}
    raw = tree().group("runs").group("r001_baseline_roll_1").group("raw_bus0")
    assert one.t_ns.tolist() == raw.values("t_ns").tolist()


def test_what_older_files_lack_has_its_default() -> None:
    assert session_of(no_attribute(RUN, "lost_crc_bad"), "a").runs[0].losses.crc_bad == 0
    assert session_of(tree(), "a").runs[0].losses.crc_bad == 3
    gains = session_of(column("channels", "gain", None), "a").channels
    assert [channel.gain for channel in gains] == [1.0] * 4
    weights = session_of(column("mass_states/added", "position_sigma_m", None), "a").mass_states
    (weight,) = [w for w in weights[1].added.weights if isinstance(w, BodyWeight)]
    assert weight.position_sigma_m == 0.0
    vehicle = session_of(member("session", "facts", there=False), "a").vehicle
    assert vehicle.facts == ()
    plain = session_of(no_attribute("session", "structure_anti_roll_bars"), "a").vehicle.structure
    assert (plain.anti_roll_bars, plain.symmetric) == (False, False)
    assert session_of(
        no_attribute("session", "structure_symmetric"), "a"
    ).vehicle.structure.symmetric


@pytest.mark.parametrize("name", ["a_m", "b_m", "t_f_m", "t_r_m"])
def test_a_vehicle_without_one_of_its_lengths_has_none(name: str) -> None:
    assert session_of(no_attribute("session", name), "a").vehicle.geometry is None


def test_what_was_decided_and_what_somebody_said() -> None:
    run = session_of(attribute(RUN, "status", "accepted"), "a").runs[0]
    assert run.status is RunStatus.ACCEPTED
    assert run.reasons == ("too weak: 0.3 m/s2", "µ-Zeichen")
    assert session_of(attribute(RUN, "reasons", "\na\n\nb"), "a").runs[0].reasons == ("a", "b")
    assert session_of(attribute(RUN, "reasons", ""), "a").runs[0].reasons == ()
    said = session_of(attribute("session", "provenance_place", 7), "a").provenance
    assert said["place"] == "7"
    assert said["dbc"] == "BO_ \udce9 \x00"


def test_mass_states_are_in_their_order() -> None:
    states = session_of(tree(), "a").mass_states
    assert [state.name for state in states] == ["baseline", "added"]
    turned = session_of(attribute("mass_states/added", "order", -1), "a").mass_states
    assert [state.name for state in turned] == ["added", "baseline"]


def test_elements_that_are_mounted_or_not() -> None:
    for stored, mounted in ((1, True), (0, False)):
        vehicle = session_of(attribute("session", "element_friction", stored), "a").vehicle
        assert dict(vehicle.elements)["friction"] is mounted
    assert "friction" not in session_of(tree(), "a").vehicle.elements
