"""What the masses screen says of the weights, and what the check screen says of the bench."""

import json
from dataclasses import replace

import pytest

from daq.bench.campaign import Method
from daq.bench.config import default_bench_text, load_bench
from daq.bench.edit import with_campaign
from daq.control.messages import CheckItem
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, BodyWeight, Corner, HubWeight
from tui.jobs.gain import Gain, Shift, measured_spread
from tui.terminal.screens.check import (
    item_rows,
    with_overrides,
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


def test_an_override_takes_the_block_from_a_warning_and_never_from_a_failure() -> None:
    items = (
        CheckItem("WARN", "channel a", "noise", "mount it", {}),
        CheckItem("FAIL", "channel b", "upside down", "turn it", {}),
    )
    rows = with_overrides(item_rows(items), {"channel a": "known (MK)", "channel b": "known (MK)"})
    assert (rows[0].asks, rows[0].advice) == (False, "overridden: known (MK)")
    assert rows[1].blocks
    assert with_overrides(item_rows(items), {})[0].asks
