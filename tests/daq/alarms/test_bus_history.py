"""What a turn leaves of a bus: times, counts, the controller, as frames and reports come."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.alarms.buses import BusWatch, advance_buses, bus_status, bus_symptoms
from daq.bus.error_frames import ControllerState, ErrorClass, tally_error_frames
from daq.bus.source import LinkFacts, SourceLosses
from dbc import FrameBatch

from ..watched_bench import error_frames, frames

T_NS = 1_800_000_000_000_000_000
LINK = LinkFacts("can0", 500_000, True, "", "", 0.0, 0, SourceLosses())
NOTHING = FrameBatch.empty()


def watched(**facts: Any) -> BusWatch:
    return replace(
        BusWatch("can0", 1.0, 2.0, 3.0, 4.0, recent=((9.5, 1, 0, 100.0, T_NS),)), **facts
    )


def reported(classes: int, data: str = "", n: int = 1, at_ns: int = T_NS) -> FrameBatch:
    payload = bytes.fromhex(data).ljust(8, b"\0")
    return error_frames(ErrorClass(classes), payload, at_ns, bus=0, n=n)


def advanced(
    watch: BusWatch, batch: FrameBatch, now_s: float = 10.0, link: LinkFacts = LINK
) -> tuple[BusWatch, dict[str, int]]:
    (after,), counts = advance_buses((watch,), (link,), batch, now_s)
    return after, {code: count.number for (code, _), count in counts.items()}


GOOD = frames(0x10, [bytes(8)] * 2, T_NS)


@pytest.mark.parametrize(
    ("batch", "heard_s", "good_s", "frame_s", "error_s"),
    [
        (NOTHING, 2.0, 3.0, 4.0, 5.0),
        (GOOD, 10.0, 10.0, 10.0, 5.0),
        (reported(0x8), 10.0, 3.0, 4.0, 10.0),
        (FrameBatch.concatenate([GOOD, reported(0x8)]), 10.0, 10.0, 10.0, 10.0),
    ],
)
def test_when_a_bus_was_heard_last(
    batch: FrameBatch, heard_s: float, good_s: float, frame_s: float, error_s: float
) -> None:
    after, _ = advanced(watched(error_s=5.0), batch)
    assert (after.heard_s, after.good_s, after.frame_s, after.error_s) == (
        heard_s, good_s, frame_s, error_s,
    )  # fmt: skip
    assert after.connected_s == 1.0


def test_a_bus_that_has_gone_is_heard_anew_and_its_controller_forgotten() -> None:
    passive = watched(
        controller=ControllerState.PASSIVE,
        tx_errors=130,
        rx_errors=7,
        error_text="bus error",
        error_s=9.0,
    )
    gone, _ = advanced(passive, NOTHING, link=replace(LINK, connected=False))
    assert (gone.controller, gone.tx_errors, gone.rx_errors) == (None, None, None)
    assert (gone.connected_s, gone.heard_s, gone.good_s) == (10.0, 10.0, 10.0)
    assert (gone.frame_s, gone.error_text) == (4.0, "bus error")
    here, _ = advanced(passive, NOTHING)
    assert (here.controller, here.tx_errors, here.rx_errors) == (ControllerState.PASSIVE, 130, 7)


def test_losses_are_news_only_while_they_are_counted() -> None:
    counted = replace(LINK, losses=SourceLosses(5, 6, 7))
    (first,), counts = advance_buses((), (counted,), NOTHING, 10.0)
    assert counts == {}
    assert (first.name, first.connected_s, first.heard_s, first.good_s) == ("can0", 10, 10, 10)
    assert first.frame_s is None
    more = replace(LINK, losses=SourceLosses(6, 8, 10))
    after, numbers = advanced(first, reported(0x4, "00 01", n=3), link=more)
    assert numbers == {"overrun": 1 + 3, "garbled": 2, "restamped": 3, "error_frames": 3}
    assert advanced(after, NOTHING, link=more)[1] == {}


@pytest.mark.parametrize(
    ("stamps", "last_ns", "back"),
    [
        ((0, 10, 20), -1, 0),
        ((0, 0, 0), 0, 0),  # equal stamps are in order
        ((0, 10, 5), -1, 1),
        ((20, 10, 5), -1, 2),
        ((0, 10, 20), 1, 1),
        ((5, 3, 1), 9, 3),
    ],
)
def test_stamps_that_go_back_are_counted(stamps: tuple[int, ...], last_ns: int, back: int) -> None:
    batch = replace(frames(0x10, [bytes(8)] * 3, T_NS), t_ns=T_NS + np.array(stamps))
    after, numbers = advanced(watched(last_ns=T_NS + last_ns), batch)
    assert numbers.get("time_back", 0) == back
    assert after.last_ns == T_NS + stamps[-1]


def test_the_last_error_frame_is_kept_in_words() -> None:
    batch = FrameBatch.concatenate([reported(0x8), reported(0x40, at_ns=T_NS + 9)])
    (after,), counts = advance_buses((watched(),), (LINK,), batch, 10.0)
    assert (after.error_text, after.error_frames) == ("bus-off", 2)
    assert (counts["bus_off", "can0"].number, counts["bus_off", "can0"].detail) == (1, "bus-off")
    assert counts["error_frames", "can0"].detail == "bus-off"
    later, _ = advanced(after, GOOD, 10.1)
    assert later.error_text == "bus-off"
    assert later.controller is ControllerState.ACTIVE


def test_counters_are_those_of_the_last_report_that_has_them() -> None:
    batch = FrameBatch.concatenate(
        [reported(0x204, "00 00 00 00 00 00 82 07"), reported(0x8, at_ns=T_NS + 9)]
    )
    after, _ = advanced(watched(), batch)
    assert (after.controller, after.tx_errors, after.rx_errors) == (ControllerState.PASSIVE, 130, 7)
    again, _ = advanced(after, reported(0x8), 10.1)
    assert (again.controller, again.tx_errors, again.rx_errors) == (ControllerState.PASSIVE, 130, 7)


def test_a_summary_of_reports_has_the_last_of_each() -> None:
    batch = FrameBatch.concatenate(
        [
            reported(0x4, "00 01"),
            reported(0x40),
            reported(0x204, "00 00 00 00 00 00 05 60"),
            reported(0x8, "ff ff"),
            reported(0x4, "00 03"),
        ]
    )
    tally = tally_error_frames(batch)
    assert (tally.frames, tally.bus_off, tally.overruns) == (5, 1, 2)
    assert (tally.state, tally.state_row) == (ControllerState.WARNING, 2)
    assert (tally.tx_errors, tally.rx_errors) == (5, 96)
    assert tally.text.startswith("controller (receive buffer overflow, transmit buffer overflow")
    plain = tally_error_frames(reported(0x8, n=2))
    assert (plain.state, plain.state_row) == (None, -1)
    assert (plain.tx_errors, plain.rx_errors) == (None, None)
    old = tally_error_frames(reported(0x4, "00 00 00 00 00 00 00 80"))  # before Linux 6.0
    assert (old.state, old.tx_errors, old.rx_errors) == (ControllerState.PASSIVE, 0, 128)
    assert tally_error_frames(reported(0x100)).state is ControllerState.ACTIVE


@pytest.mark.parametrize(("bits", "full"), [(472_000.0, False), (476_000.0, True)])
def test_a_bus_is_full_from_95_percent_on(bits: float, full: bool) -> None:
    turns = ((9.0, 0, 0, 1e9, 0), (10.0, 1, 0, bits, 0))
    watch = watched(good_s=10.0, recent=turns)
    status = bus_status(watch, LINK, 2.0, 10.0)
    assert status.load == pytest.approx(bits / 500_000)
    found = bus_symptoms(watch, LINK, status, 2.0, 10.0)
    assert [s.code for s in found] == ["bus_full"] * full
    if full:
        assert found[0].text == "load 95% of 500 kbit/s"


def test_the_status_has_what_link_and_watch_have_counted() -> None:
    watch = watched(good_s=10.0, frames=7, error_frames=3, tx_errors=1, rx_errors=2)
    status = bus_status(watch, replace(LINK, reopened=4), 2.0, 10.0)
    assert (status.frames, status.error_frames, status.reopened) == (7, 3, 4)
    assert (status.tx_errors, status.rx_errors, status.name) == (1, 2, "can0")


def test_before_its_first_frame_a_bus_has_no_stamp_to_count_from() -> None:
    """A replay at twice the speed: 0.2 s of stamps in 0.1 s."""
    silent = watched(last_ns=0, recent=((9.7, 0, 0, 0.0, 0), (9.9, 0, 0, 0.0, 0)))
    batch = replace(GOOD, t_ns=np.array([T_NS, T_NS + 200_000_000]))
    after, _ = advanced(silent, batch)
    assert [turn[4] for turn in after.recent] == [T_NS, T_NS, T_NS + 200_000_000]
    assert [turn[:3] for turn in after.recent] == [(9.7, 0, 0), (9.9, 0, 0), (10.0, 2, 0)]
    assert bus_status(after, LINK, 2.0, 10.0).frames_per_s == pytest.approx(2 / 0.3)
    next_one, _ = advanced(after, frames(0x10, [bytes(8)], T_NS + 900_000_000), 10.1)
    assert bus_status(next_one, LINK, 2.0, 10.1).frames_per_s == pytest.approx(3 / 0.9)
