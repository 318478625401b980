"""A bench of three makers' sensors, proposed from rest and a push on each corner."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from functools import cache
from pathlib import Path

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.sensors import Databases, stored_text
from daq.channels import Quantity
from daq.check.check import check_bench
from daq.check.propose import Proposal, propose_sensors
from daq.vehicle import Corner
from dbc import FrameBatch, Severity

from ..wild_bench import DATABASES, rest_and_pushes, wild_bench

FL, FR, RL, RR = Corner.FRONT_LEFT, Corner.FRONT_RIGHT, Corner.REAR_LEFT, Corner.REAR_RIGHT


@cache
def proposal(with_pushes: bool) -> Proposal:
    rest, pushes = rest_and_pushes()
    return propose_sensors(DATABASES, (), rest, pushes if with_pushes else None)


def bench_of(proposed: Proposal, databases: Databases = DATABASES) -> Bench:
    """Return a proposal as a bench, which fits its databases."""
    bench = parse_bench(proposed.text, "proposed", Path(), stored_text(databases))
    bench_codec(bench)
    return bench


def by_signal(bench: Bench) -> dict[tuple[int, int, str], tuple[Quantity, float, Corner | None]]:
    """Return what channels are, by bus, identifier and signal: names of sensors do not matter."""
    codec = bench_codec(bench)
    found = {}
    for channel in bench.channels:
        name, _, signal = channel.signal.rpartition(".")
        message = codec.message(name)
        key = (message.bus or 0, message.can_id, signal)
        found[key] = (channel.quantity, channel.sign, channel.corner)
    return found


def test_every_sensor_is_found_as_it_is_mounted_in_truth() -> None:
    truth = {k: v for k, v in by_signal(wild_bench()).items() if v[0] != Quantity.UNUSED}
    found = by_signal(bench_of(proposal(True)))
    assert {key: found.get(key) for key in truth} == truth
    assert {v[0] for k, v in found.items() if k not in truth} == {Quantity.UNUSED}


def test_two_like_imus_are_two_sensors_and_four_nodes_are_four() -> None:
    proposed = bench_of(proposal(True)).sensors
    sensors = {s.name: (s.database, s.bus_position, s.id_offset) for s in proposed}
    assert sensors == {
        "imu_a_1": ("imu_a.dbc", 0, 0), "imu_a_2": ("imu_a.dbc", 1, 0),
        "imu_b": ("imu_b.dbc", 0, 0), "hubs": ("hubs.dbc", 0, 0),
        "pot_1": ("pot.dbc", 1, 0), "pot_2": ("pot.dbc", 1, 1),
        "pot_3": ("pot.dbc", 1, 2), "pot_4": ("pot.dbc", 1, 3),
    }  # fmt: skip
    assert [q.partition(":")[0] for q in proposal(True).questions] == [
        "sensor pot_2", "sensor pot_3", "sensor pot_4",
    ]  # fmt: skip


def test_the_counters_of_one_maker_are_found() -> None:
    rules = {rule.name: rule.counter for rule in bench_of(proposal(True)).message_rules}
    assert rules == {
        "hubs.WheelAccelFront": "MsgCounter", "hubs.WheelAccelRear": "MsgCounter",
        "imu_b.Motion_Accel": "MsgCounter", "imu_b.Motion_Rate": "MsgCounter",
    }  # fmt: skip


def test_without_pushes_what_is_not_sure_is_asked() -> None:
    bench, questions = bench_of(proposal(False)), proposal(False).questions
    assert "sensor imu_a_1: does the sensor's +x axis point forward?" in questions
    assert "sensor imu_a_2: does the sensor's -z axis point forward?" in questions
    assert sum("at which corner?" in each for each in questions) == 4
    assert proposal(False).text.count("# ASK: ") >= 8
    vertical = [c for c in bench.channels if c.quantity is Quantity.BODY_ACCELERATION]
    assert [(c.signal.rpartition(".")[2], c.sign) for c in vertical] == [
        ("AccZ", 1), ("AccX", 1), ("Accel_Vertical", -1),
    ]  # fmt: skip


def test_the_check_asks_until_the_marks_are_deleted() -> None:
    rest, _ = rest_and_pushes()
    bench = bench_of(proposal(False))
    asked = _asked(bench, rest)
    assert len(asked) == proposal(False).text.count("# ASK: ") >= 8
    assert any("does the sensor's +x axis point forward?" in text for text in asked)
    number = next(
        i for i, line in enumerate(bench.text.splitlines(), start=1) if line.startswith("# ASK")
    )
    assert any(text.startswith(f"bench.toml:{number}: asks: ") for text in asked)
    answered = replace(bench, text=bench.text.replace("# ASK: ", "# "))
    assert _asked(answered, rest) == []


def _asked(bench: Bench, rest: FrameBatch) -> list[str]:
    report = check_bench(bench, bench_codec(bench), rest, date(2026, 6, 1))
    found = [line for line in report.lines if line.code == "ask"]
    assert all(line.severity is Severity.WARNING for line in found)
    return [f"{line.subject}: {line.text}" for line in found]


def test_no_four_pushes_are_asked_for_again() -> None:
    rest, pushes = rest_and_pushes()
    first = pushes.select(pushes.t_ns < pushes.t_ns[0] + 3_000_000_000)
    proposed = propose_sensors(DATABASES, (), rest, first)
    assert proposed.questions[0].startswith("1 push was found instead of one on each")
