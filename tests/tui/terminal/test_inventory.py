"""What the masses screen says of the weights, and what the check screen says of the bench."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.campaign import Method
from daq.bench.config import default_bench_text, load_bench
from daq.bench.edit import with_campaign, with_weights
from daq.check.push_test import PushResult
from daq.control.messages import BusState, BusStatus, CheckItem, DiskStatus
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, BodyWeight, Corner, Fact, HubWeight
from tui.jobs.gain import GAIN, Gain, Shift, measured_spread
from tui.terminal.screens.check import (
    item_rows,
    push_rows,
    recorder_rows,
    with_overrides,
    zero_offsets,
)
from tui.terminal.screens.weights import (
    Entry,
    baseline_spread,
    entries_of,
    entry_values,
    gain_line,
    known_car,
    sag_line,
    sag_m,
    shift_line,
    sketch,
    with_bolted,
)

from .fake_recorder import DOUBLE_BUMP, GOOD, FakeRecorder

BENCH = load_bench(None)
ENTRIES = (
    Entry(BodyWeight(20.0, 0.0, 0.6), "M-07"),
    Entry(BodyWeight(20.0, -2.76, -0.6, 0.1, 0.01), "M-08", True),
    Entry(HubWeight(4.0, Corner.FRONT_LEFT)),
)


def test_a_draft_of_the_weights_is_read_back() -> None:
    reported = json.loads(json.dumps({"entries": entry_values(ENTRIES)}))
    assert entries_of((), reported) == ENTRIES
    weights = tuple(e.weight for e in ENTRIES)
    assert entries_of(weights, {}) == tuple(Entry(w) for w in weights)
    assert entries_of(weights, {"entries": [{"mass_kg": "much"}, 3]}) == ()
    assert with_bolted(ENTRIES, 0, True)[0].bolted


def test_the_sketch_shows_each_weight_where_it_is() -> None:
    lines = sketch(ENTRIES, FORD_GRANADA)
    at = {c: (r, line.index(c)) for r, line in enumerate(lines) for c in "12" if c in line}
    assert at["1"][0] < at["2"][0]  # the front is at the top
    assert at["1"][1] < at["2"][1]  # left is left
    assert lines[1].startswith("   3+")  # on the front left hub
    assert "RR" in lines[-1]


def test_a_weak_shift_says_what_to_move() -> None:
    good = Shift("pitch", 1.4, 1.35)
    assert shift_line(good, 0.005, ENTRIES, FORD_GRANADA) == (
        "pitch  1.40 -> 1.35 Hz  -3.6%  7x spread: good", ""
    )  # fmt: skip
    _, weak = shift_line(good, 0.02, ENTRIES, FORD_GRANADA)
    assert weak == "WEAK 2x, want 3x: move 1 to an end"  # 1.25 m from the CG, 2 is 1.51 m
    inward = (Entry(BodyWeight(20.0, 0.0, 0.2)), *ENTRIES[1:])
    assert shift_line(replace(good, mode="roll"), 0.02, inward, FORD_GRANADA)[1].endswith(
        "move 1 outwards"
    )
    assert "usual spread" in shift_line(good, None, ENTRIES, FORD_GRANADA)[0]
    assert shift_line(good, 1.0, ENTRIES[2:], FORD_GRANADA)[1].endswith("more kg on body")


def test_the_spread_is_that_of_the_accepted_baseline_runs() -> None:
    text = with_campaign(default_bench_text(), (Excitation.BOUNCE,), 3, Method.DROP, 0.04, 3.0)
    recorder = FakeRecorder(text)
    for hertz in (1.40, 1.41, 1.42):
        assert baseline_spread(recorder.status, "bounce") is None
        recorder.bump()
        recorder.judge(DOUBLE_BUMP, replace(GOOD, code="motion", unit="Hz", value=9.0))
        recorder.bump()
        recorder.judge(GOOD, replace(GOOD, code="motion", unit="Hz", value=hertz))
    assert baseline_spread(recorder.status, "bounce") == pytest.approx(0.01 / 1.41)
    assert baseline_spread(recorder.status, "pitch") is None
    assert baseline_spread(None, "bounce") is None
    assert measured_spread([1.40, 1.41, 1.42]) == pytest.approx(0.01 / 1.41)
    assert measured_spread([1.40, 1.41]) is None


def test_the_outlook_says_what_stays_unknown() -> None:
    assert gain_line(Gain(worst=0.02, mean=0.01, widest="m_ur")) == (
        "parameters ± 1.0% in the mean, m_ur ± 2.0% at worst", ""
    )  # fmt: skip
    lost = Gain(undetermined=("m_s", "k_sf"), remedies=("weigh each axle to 1 kg",))
    assert gain_line(lost)[1] == "WEAK, not determined: m_s, k_sf; add: weigh each axle to 1 kg"
    assert "no outlook: oh" in gain_line(Gain(error="oh"))[1]


def test_the_expected_gain_is_that_of_the_paper_in_a_process_without_the_terminal(
    tmp_path: Path,
) -> None:
    def ask(text: str) -> Gain:
        question = json.dumps({"bench": text, "folder": str(tmp_path)})
        command = [sys.executable, "-m", "tui.jobs.gain"]
        done = subprocess.run(command, input=question, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return GAIN.validate_json(done.stdout)

    gain = ask(default_bench_text())
    before = [s.before_hz for s in gain.shifts]
    assert [s.mode for s in gain.shifts] == ["bounce", "pitch", "roll"]
    np.testing.assert_allclose(before, [1.0511, 1.3078, 1.6516], atol=1e-4)  # docs/method.md
    assert all(-0.06 < s.share < -0.04 for s in gain.shifts)
    assert gain.worst is not None
    assert 0.001 < gain.worst < 0.05
    assert not gain.undetermined
    none = ask(with_weights(default_bench_text(), ()))
    assert "m_s" in none.undetermined  # no added mass, no scale
    assert none.remedies
    assert ask('[vehicle]\nname = "x"\ncolour = 1\n').error


def test_the_sag_tells_the_springs() -> None:
    before = {f"travel_{c.lower()}": 0.001 for c in Corner}
    weights = [BodyWeight(100.0, 0.0, 0.0)]  # all of it on the front axle
    after = before | {"travel_fl": 0.021, "travel_fr": 0.021, "travel_rl": 0.001}
    sag, car = sag_m(BENCH, before, after), known_car(BENCH, None)
    assert sag_line(BENCH, weights, sag, car) == (
        "spring front 24.5 kN/m (expected 17), rear ? kN/m (expected 22)"
    )
    assert "not measured" in sag_line(BENCH, weights, sag_m(BENCH, {}, after), car)
    assert "has not sunk" in sag_line(BENCH, weights, sag_m(BENCH, before, before), car)
    blind = replace(BENCH, channels=BENCH.channels[:6])
    assert sag_line(blind, weights, {}, car) == "no travel sensor"


def test_the_known_springs_are_those_of_facts_or_of_the_bounce() -> None:
    usual = known_car(BENCH, None)
    assert known_car(BENCH, 2 * 1.1964).k_sf == pytest.approx(4 * usual.k_sf, rel=1e-3)
    fact = Fact("k_sf", 30e3, 300.0)
    stated = replace(BENCH, vehicle=replace(BENCH.vehicle, facts=(fact,)))
    assert known_car(stated, None).k_sf == 30e3
    assert known_car(stated, None).k_sr == usual.k_sr


def test_recorder_lines_say_bus_disk_and_clock() -> None:
    status = FakeRecorder().status
    assert [row.state for row in recorder_rows(status)] == ["OK", "OK", "OK"]
    broken = replace(
        status,
        buses=(
            BusStatus("can0", BusState.BUS_OFF, 0.0, 0.0, 10, 3, 1, 255, 0),
            BusStatus("can1", BusState.OK, 0.9, 4000.0, 10, 0, 0),
        ),
        disk=DiskStatus(100_000_000, 0, 10, 0.1),
    )
    rows = recorder_rows(broken)
    assert [row.state for row in rows] == ["FAIL", "WARN", "FAIL", "OK"]
    assert "TEC 255" in rows[0].text
    assert all(row.advice for row in rows[:3])


def test_an_override_takes_the_block_from_a_warning_and_never_from_a_failure() -> None:
    items = (
        CheckItem("WARN", "channel a", "noise", "mount it", {}),
        CheckItem("FAIL", "channel b", "upside down", "turn it", {}),
    )
    rows = with_overrides(item_rows(items), {"channel a": "known (MK)", "channel b": "known (MK)"})
    assert (rows[0].asks, rows[0].advice) == (False, "overridden: known (MK)")
    assert rows[1].blocks
    assert with_overrides(item_rows(items), {})[0].asks


def test_lines_of_pushes() -> None:
    seen = {
        Corner.FRONT_LEFT: PushResult(Corner.FRONT_LEFT, True, True, "travel_fl moved +14 mm"),
        Corner.FRONT_RIGHT: PushResult(Corner.FRONT_RIGHT, True, False, "FL moved", "swap"),
    }
    rows = push_rows(seen, Corner.REAR_LEFT, {"push RR": "wall (MK)"}, True)
    assert [row.state for row in rows] == ["OK", "FAIL", "NOW", "WARN"]
    assert rows[1].blocks
    assert not rows[3].asks
    (row,) = push_rows({}, "", {}, False)
    assert row.state == "OK"


def test_travels_and_rates_are_tared_and_gravity_never() -> None:
    levels = {"travel_fl": 0.0035, "travel_fr": 0.0001, "roll_rate": -0.004, "body_acc_z": 9.81,
              "hub_acc_fl": 9.7}  # fmt: skip
    items = [CheckItem("OK", f"channel {n}", "", "", {"level": v}) for n, v in levels.items()]
    found = {o.channel: o.tare for o in zero_offsets(items, BENCH.channels)}
    assert found == {"travel_fl": 0.0035, "roll_rate": -0.004}
    tared = tuple(replace(c, tare=0.01) for c in BENCH.channels)
    assert zero_offsets(items, tared)[1].tare == pytest.approx(0.0135)
