"""Two like IMUs on two buses, one of them upside down, through every way that frames go."""

from __future__ import annotations

from datetime import date
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.sensors import stored_databases
from daq.bus.source import HopLosses
from daq.check.check import check_bench
from daq.errors import InputError
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from daq.session import read_session, write_session
from daq.session.build import derive
from daq.session.from_frames import Intake, labelled, redecoded, session_from_parts
from daq.sessions import Session, session_part
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch, Severity
from dbc.units import G_M_S2

from ..sensor_bench import IMU, START_NS, sensor_bench

OLD = """
dbc = "imu.dbc"
[[bus]]
interface = "virtual"
channel = "can0"
[[bus]]
interface = "virtual"
channel = "can1"
[[channel]]
name = "acc"
signal = "Accel.AccZ"
quantity = "body_acceleration"
"""


@cache
def frames() -> FrameBatch:
    """Return the frames of one bounce, on both buses."""
    return next(
        campaign_frames(sensor_bench(), bench_codec(sensor_bench()), SimulatedCar(), 1, START_NS)
    )


@cache
def imported() -> Session:
    bench = sensor_bench()
    codec = bench_codec(bench)
    intake = Intake(bench, codec)
    intake.take(frames(), HopLosses())
    parts = labelled([intake.part()], bench.campaign.steps, 0)
    return session_from_parts(bench, codec, parts, {})


def rest() -> FrameBatch:
    return frames().select(frames().t_ns < START_NS + 1_200_000_000)


def level(session: Session, channel: str) -> float:
    """Return the mean of a channel before the bump, SI."""
    run = session.runs[0]
    (group,) = (group for group in run.groups if channel in group.values)
    return float(np.mean(group.values[channel][group.time_s < run.bump_s - 0.1]))


def test_one_dbc_for_two_buses_does_not_pass_the_check() -> None:
    bench = parse_bench(OLD, "bench.toml", Path(), IMU)
    report = check_bench(bench, bench_codec(bench), rest(), date(2026, 6, 1))
    (line,) = [each for each in report.lines if each.code == "mixed_buses"]
    assert line.severity is Severity.ERROR
    assert line.text == "comes on the buses 0 and 1: two sensors read as one"


def test_a_session_has_each_sensor_for_itself(tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    write_session(path, imported())
    session = read_session(path)
    assert level(session, "acc_a") == pytest.approx(G_M_S2, abs=0.2)
    assert level(session, "acc_b") == pytest.approx(G_M_S2, abs=0.2)  # by its sign
    assert {group.name for group in session.runs[0].groups} == {
        "imu_a_Accel", "imu_a_Rate", "imu_b_Accel", "imu_b_Rate", "hubs_Accel",
        "pot_fl_TPDO1", "pot_fr_TPDO1", "pot_rl_TPDO1", "pot_rr_TPDO1",
    }  # fmt: skip
    assert len(stored_databases(session.provenance["dbc"])) == 3
    again = redecoded(session, _bench_of(session), str(path), {})
    assert level(again, "acc_b") == level(session, "acc_b")
    np.testing.assert_array_equal(again.runs[0].frames.bus, session.runs[0].frames.bus)


def _bench_of(session: Session) -> Bench:
    text, databases = session.provenance["bench_toml"], session.provenance["dbc"]
    return parse_bench(text, "bench.toml", Path("/nowhere"), databases)


def test_a_part_of_a_session_has_the_sensors_and_buses_that_are_asked_for() -> None:
    part = session_part(imported(), ["imu_b"], [1])
    assert [channel.name for channel in part.channels] == ["acc_b", "pitch_b"]
    assert {group.name for group in part.runs[0].groups} == {"imu_b_Accel", "imu_b_Rate"}
    assert set(part.runs[0].frames.bus.tolist()) == {1}
    whole = session_part(imported(), [], [])
    assert whole.channels == imported().channels
    assert len(whole.runs[0].frames) == len(imported().runs[0].frames)
    with pytest.raises(InputError, match="its sensors: hubs, imu_a, imu_b, pot_fl"):
        session_part(imported(), ["imu_c"], [])


def test_a_journal_needs_nothing_else(tmp_path: Path) -> None:
    bench = sensor_bench()
    head = JournalHead(bench.text, bench.dbc_text, "test", START_NS, 5)
    with JournalWriter(tmp_path, head) as journal:
        journal.append(frames(), HopLosses())
        journal.append_events(list(imported().runs[0].events))
    derive(journal.paths, tmp_path / "session.h5")
    session = read_session(tmp_path / "session.h5")
    for name in ("acc_a", "acc_b", "pot_rr", "hub_fl"):
        assert level(session, name) == level(imported(), name)
