"""A session decoded anew: whose reasons stay, what it needs, and what the new one says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import Bench, parse_bench
from daq.derive.redecode import redecoded
from daq.errors import InputError
from daq.runs import Event, Losses, Run, RunStatus
from daq.sessions import Session
from dbc import FrameBatch

from .test_sensors_on_buses import imported


def _bench(session: Session) -> Bench:
    said = session.provenance
    return parse_bench(said["bench_toml"], "bench.toml", Path("/nowhere"), said["dbc"])


def _with(**changes: Any) -> Session:
    return replace(imported(), runs=(replace(imported().runs[0], **changes),))


def _again(session: Session, **provenance: str) -> Session:
    return redecoded(session, _bench(imported()), "old.h5", provenance)


def _verdict(run: Run) -> tuple[str, tuple[str, ...]]:
    return run.status.value, run.reasons


def test_what_the_operator_decided_stays() -> None:
    was = _verdict(_again(imported()).runs[0])
    assert was == ("accepted", ())
    leaned = _with(status=RunStatus.REJECTED, reasons=("somebody leaned on the car",))
    assert _verdict(_again(leaned).runs[0]) == ("rejected", ("somebody leaned on the car",))
    silent = _with(status=RunStatus.REJECTED, reasons=())
    assert _verdict(_again(silent).runs[0]) == ("rejected", ())


def test_losses_before_the_session_are_kept_and_the_rest_is_counted_anew() -> None:
    lost = Losses(
        bus_dropped=1, bus_garbled=2, queue_dropped=3, counter_gaps=40, crc_bad=50, wrong_length=60
    )
    found = _again(_with(losses=lost)).runs[0].losses
    fresh = _again(imported()).runs[0].losses
    assert (found.bus_dropped, found.bus_garbled, found.queue_dropped) == (1, 2, 3)
    assert (found.counter_gaps, found.crc_bad, found.wrong_length) == (
        fresh.counter_gaps,
        fresh.crc_bad,
        fresh.wrong_length,
    )
    assert fresh.counter_gaps < 40


def test_the_new_session_says_where_it_comes_from() -> None:
    old = replace(imported(), provenance={**imported().provenance, "uuid": "7", "place": "hall"})
    new = _again(old, software="new")
    assert new.provenance["redecoded"] == "7"
    assert new.provenance["place"] == "hall"
    assert new.provenance["software"] == "new"
    assert new.provenance["dbc"] == imported().provenance["dbc"]
    assert new.provenance["uuid"] not in ("", "7")
    assert new.provenance["uuid"] == _again(old).provenance["uuid"]
    assert new.runs[0].events == old.runs[0].events
    other = replace(old, provenance={**old.provenance, "uuid": "8"})
    assert _again(other).provenance["uuid"] != new.provenance["uuid"]
    commented = parse_bench(
        f"# x\n{old.provenance['bench_toml']}",
        "bench.toml",
        Path("/nowhere"),
        old.provenance["dbc"],
    )
    again = redecoded(old, commented, "old.h5", {}).provenance
    assert again["uuid"] != new.provenance["uuid"]
    assert again["bench_toml"].startswith("# x")


def test_a_run_without_raw_frames_is_refused_and_named() -> None:
    label = imported().runs[0].label
    with pytest.raises(InputError, match=f"{label} has no raw frames") as refused:
        _again(_with(frames=FrameBatch.empty()))
    assert refused.value.where == "old.h5"


def test_a_run_that_does_not_state_when_its_bump_was_is_refused() -> None:
    run = imported().runs[0]
    bump = next(event for event in run.events if event.text == run.label)
    others = (Event(bump.t_ns, "note", 1.0, run.label), replace(bump, text="baseline_roll_9"))
    with pytest.raises(InputError, match=run.label):
        _again(_with(events=others))
    assert _again(_with(events=(*others, bump))).runs[0].t0_ns == run.t0_ns
