"""The states of a bus and its controller, on turns made by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.alarms.buses import BusWatch, advance_buses, bus_status, bus_symptoms
from daq.bus.error_frames import ControllerState, ErrorClass
from daq.bus.source import LinkFacts, SourceLosses
from daq.control.messages import BusState
from dbc import FrameBatch
from dbc.finding import Finding

from ..watched_bench import error_frames, frames

LINK = LinkFacts("can0", 500_000, True, "", "", 0.0, 0, SourceLosses())
T_NS = 1_800_000_000_000_000_000
NOTHING = FrameBatch.concatenate([frames(0x700, [bytes(8)], T_NS)]).select(np.zeros(0, np.intp))


def watched(**facts: Any) -> BusWatch:
    fresh = BusWatch("can0", 0.0, 0.0, 0.0, recent=((0.0, 0, 0, 0.0, 0),))
    return replace(fresh, **facts)


@pytest.mark.parametrize(
    ("quiet_s", "controller", "connected", "state"),
    [
        (1.9, None, True, BusState.OK),
        (2.0, None, True, BusState.SILENT),
        (1.9, ControllerState.PASSIVE, True, BusState.ERROR_PASSIVE),
        (2.0, ControllerState.PASSIVE, True, BusState.SILENT),
        (1.9, ControllerState.WARNING, True, BusState.OK),
        (0.0, ControllerState.BUS_OFF, True, BusState.BUS_OFF),
        (0.0, ControllerState.BUS_OFF, False, BusState.DISCONNECTED),
    ],
)
def test_states_of_a_bus(
    quiet_s: float, controller: ControllerState | None, connected: bool, state: BusState
) -> None:
    watch = watched(good_s=10.0 - quiet_s, controller=controller)
    assert bus_status(watch, replace(LINK, connected=connected), 2.0, 10.0).state is state


def test_load_and_frames_a_second_are_those_of_the_turns_after_the_first() -> None:
    """Two turns with 100 frames and 25,000 bits each in 0.4 s at 500 kbit/s: 25 %."""
    turns = ((9.6, 70, 1, 9e4, 0), (9.8, 100, 0, 25e3, 0), (10.0, 100, 0, 25e3, 0))
    status = bus_status(watched(recent=turns, frames=270), LINK, 2.0, 10.0)
    assert status.load == pytest.approx(0.25)
    assert status.frames_per_s == pytest.approx(500.0)
    stamped = tuple((*t[:4], T_NS + n * 10**9) for n, t in enumerate(turns))
    slow = bus_status(watched(recent=stamped), LINK, 2.0, 10.0)
    assert slow.frames_per_s == pytest.approx(100.0)  # 2 s by the stamps
    sudden = bus_status(watched(recent=((9.99, 0, 0, 0.0, 0), turns[2])), LINK, 2.0, 10.0)
    assert sudden.frames_per_s == pytest.approx(1000.0)  # over a tenth of a second at least


def test_a_block_is_taken_in() -> None:
    batch = FrameBatch.concatenate(
        [
            frames(0x10, [bytes(8)] * 3, T_NS),
            frames(0x11, [bytes(8)], T_NS + 5_000),  # earlier than the one before
            error_frames(ErrorClass.PROTOCOL, bytes(8), T_NS + 90_000, bus=0, n=2),
            frames(0x12, [bytes(8)] * 4, T_NS, bus=1),
        ]
    )
    links = (replace(LINK, losses=SourceLosses(7, 5, 3)), replace(LINK, name="can1"))
    before = (watched(last_ns=T_NS + 1, losses=SourceLosses(1, 1, 1)),)
    (first, second), counts = advance_buses(before, links, batch, 10.0)
    assert {key: count.number for key, count in counts.items()} == {
        ("overrun", "can0"): 6,
        ("garbled", "can0"): 4,
        ("restamped", "can0"): 2,
        ("time_back", "can0"): 2,
        ("error_frames", "can0"): 2,
    }
    assert (first.frames, first.error_frames, first.last_ns) == (4, 2, T_NS + 100_000)
    assert (first.heard_s, first.good_s, first.error_s) == (10.0, 10.0, 10.0)
    assert (second.frames, second.error_frames, second.connected_s) == (4, 0, 10.0)
    assert [turn[:3] for turn in first.recent] == [(0.0, 0, 0), (10.0, 4, 2)]
    assert first.losses == SourceLosses(7, 5, 3)
    (later, _), none = advance_buses((first, second), links, NOTHING, 10.5)
    assert none == {}
    assert (later.frames, later.heard_s, later.last_ns) == (4, 10.0, T_NS + 100_000)
    (gone, _), _ = advance_buses(
        (later, second), (replace(links[0], connected=False), links[1]), NOTHING, 11.0
    )
    assert (gone.connected_s, gone.heard_s, gone.good_s) == (11.0, 11.0, 11.0)
    (other,), _ = advance_buses((gone,), (replace(LINK, name="vcan"),), NOTHING, 12.0)
    assert (other.name, other.frames, other.good_s) == ("vcan", 0, 12.0)


def test_the_turns_of_the_last_second_and_one_before_are_kept() -> None:
    watches: tuple[BusWatch, ...] = ()
    for at_s in (1.0, 1.5, 2.0, 2.5, 3.0):
        batch = frames(0x10, [bytes(8)], T_NS + round(at_s * 1e9))
        watches, _ = advance_buses(watches, (LINK,), batch, at_s)
    assert [turn[0] for turn in watches[0].recent] == [2.0, 2.5, 3.0]


@pytest.mark.parametrize(("calm_s", "state"), [(1.9, "error-passive"), (2.0, "error-active")])
def test_a_controller_that_receives_is_well_two_seconds_after_its_last_error(
    calm_s: float, state: str
) -> None:
    watch = watched(
        controller=ControllerState.PASSIVE, tx_errors=130, rx_errors=1, error_s=10.0, good_s=10.0
    )
    (after,), _ = advance_buses((watch,), (LINK,), frames(0x10, [bytes(8)], T_NS), 10.0 + calm_s)
    assert after.controller == state
    assert (after.tx_errors, after.rx_errors) == ((130, 1) if calm_s < 2.0 else (None, None))
    deaf = watched(controller=ControllerState.PASSIVE, error_s=10.0, good_s=10.0)
    (still,), _ = advance_buses((deaf,), (LINK,), NOTHING, 20.0)
    assert still.controller is ControllerState.PASSIVE


def test_a_controller_is_off_until_a_frame_comes_after_its_report() -> None:
    off = error_frames(ErrorClass.BUS_OFF, bytes(8), T_NS, bus=0)
    good = frames(0x10, [bytes(8)], T_NS + 10)
    for batch, state in (
        (off, ControllerState.BUS_OFF),
        (FrameBatch.concatenate([good, off]), ControllerState.BUS_OFF),
        (FrameBatch.concatenate([off, good]), ControllerState.ACTIVE),
        (FrameBatch.concatenate([off, good, off]), ControllerState.BUS_OFF),
    ):
        (after,), counts = advance_buses((watched(),), (LINK,), batch, 1.0)
        assert after.controller is state
        assert counts["bus_off", "can0"].number == int(np.count_nonzero(batch.flags))
    other = error_frames(ErrorClass.PROTOCOL, bytes(8), T_NS + 20, bus=0)
    (after,), _ = advance_buses((watched(),), (LINK,), FrameBatch.concatenate([off, other]), 1.0)
    assert after.controller is ControllerState.BUS_OFF  # another error is no frame


def test_error_frames_are_no_load() -> None:
    good = frames(0x10, [bytes(8)] * 3, T_NS)
    bad = error_frames(ErrorClass.PROTOCOL, bytes(8), T_NS + 10, bus=0, n=2)
    (alone,), _ = advance_buses((watched(),), (LINK,), good, 1.0)
    both = FrameBatch.concatenate([good, bad])
    (disturbed,), _ = advance_buses((watched(),), (LINK,), both, 1.0)
    assert disturbed.recent[-1][3] == pytest.approx(alone.recent[-1][3])


def symptoms(watch: BusWatch, link: LinkFacts = LINK, now_s: float = 10.0) -> list[Finding]:
    return bus_symptoms(watch, link, bus_status(watch, link, 2.0, now_s), 2.0, now_s)


@pytest.mark.parametrize(("beat_s", "named"), [(8.1, False), (8.0, True)])
def test_a_bus_is_given_two_seconds_to_be_opened(beat_s: float, named: bool) -> None:
    link = replace(LINK, connected=False, heartbeat_s=beat_s)
    assert [s.text for s in symptoms(watched(), link)] == ["not connected"] * named
    (at_once,) = symptoms(watched(), replace(link, error="gone", advice="plug it in"))
    assert (at_once.code, at_once.text, at_once.advice) == ("disconnected", "gone", "plug it in")


def test_a_silent_bus_with_error_frames_has_another_bit_rate() -> None:
    silent = watched(good_s=7.5)
    (found,) = symptoms(silent)
    assert (found.code, found.text) == ("bus_silent", "no frame for 2.5 s")
    (found,) = symptoms(replace(silent, recent=((9.0, 0, 3, 0.0, 0), (10.0, 0, 4, 0.0, 0))))
    assert found.code == "check_bitrate"
    assert found.text == "7 error frames in the last second and no good frame for 2.5 s"
    (found,) = symptoms(silent, replace(LINK, interface_down=True, name="socketcan can3"))
    assert (found.code, found.advice.split("`")[1]) == (
        "interface_down",
        "sudo ip link set can3 up",
    )
    passive = watched(good_s=9.5, controller=ControllerState.PASSIVE, error_text="as it says")
    assert [s.text for s in symptoms(passive)] == ["as it says"]
    counted = replace(passive, tx_errors=0, rx_errors=130)
    assert [s.text for s in symptoms(counted)] == ["0 transmit and 130 receive errors counted"]
