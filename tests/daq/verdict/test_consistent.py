"""The runs of a kind that belong together, where there are more than planned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure
from daq.verdict.repeats import left_out

from .. import spoiled_campaigns
from ..spoiled_campaigns import BUMP_S, bench, campaign

CHANNELS = (
    Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "B.a"),
    Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", "S.t", corner=Corner.FRONT_LEFT),
)
T_S = np.arange(0.1, 1.5, 0.02)


def _run(size: float = 1.0, bend: float = 0.0, **changed: Any) -> RunMeasure:
    wave = size * (np.exp(-2.0 * T_S) * (np.cos(8.8 * T_S) + bend * np.sin(20.0 * T_S)))
    found = RunMeasure(
        peaks={"body": 3.0 * size, "travel": 0.05 * size},
        waves={"body": wave, "travel": 0.01 * wave},
        levels={"travel": 0.2},
        roughness={"body": 0.03, "travel": 0.0002},
        frequency_hz=1.4,
        damping=0.2,
    )
    return replace(found, **changed)


def _left_out(odd: RunMeasure, others: int = 4, planned: int = 3) -> dict[str, str]:
    measures = {f"run_{k}": _run() for k in range(others)}
    return left_out(CHANNELS, BUMP_S, {**measures, "odd": odd}, planned)


@pytest.mark.parametrize(
    ("planned", "others", "out"), [(3, 3, True), (4, 3, False), (2, 3, True), (1, 2, False)]
)
def test_never_fewer_stay_than_planned_nor_than_three(planned: int, others: int, out: bool) -> None:
    assert (set(_left_out(_run(bend=0.5), others, planned)) == {"odd"}) is out


def test_height_and_timing_of_a_bump_do_not_matter() -> None:
    late = np.exp(-2.0 * (T_S - 0.01)) * np.cos(8.8 * (T_S - 0.01))
    assert _left_out(_run(1.3)) == {}
    assert _left_out(_run(waves={"body": late, "travel": 0.01 * late})) == {}


@pytest.mark.parametrize(("hertz", "out"), [(3.0, True), (8.0, False)])
def test_only_what_is_as_slow_as_the_body_is_its_course(hertz: float, out: bool) -> None:
    wave = np.exp(-2.0 * T_S) * np.cos(8.8 * T_S) + 0.01 * np.cos(2.0 * np.pi * hertz * T_S)
    odd = _run(waves={"body": wave, "travel": 0.01 * wave})
    assert (set(_left_out(odd)) == {"odd"}) is out


@pytest.mark.parametrize(("halves", "out"), [(9, True), (10, False)])
def test_a_course_is_the_mean_and_nine_cosines(halves: int, out: bool) -> None:
    """Cosines of so many half periods over the 70 means are at right angles to each other."""
    cosine = np.cos(np.pi * halves * (np.arange(70) + 0.5) / 70)
    wave = np.exp(-2.0 * T_S) * np.cos(8.8 * T_S) + 0.01 * cosine
    runs = {str(k): _run() for k in range(4)}
    runs["odd"] = _run(waves={"body": wave, "travel": 0.01 * wave})
    assert (set(left_out(CHANNELS, 0.0, runs, 3)) == {"odd"}) is out


@pytest.mark.parametrize(
    ("odd", "text"),
    [
        (_run(levels={"travel": 0.2016}), "travel 1.6 mm higher before the bump"),
        (_run(levels={"travel": 0.2014}), ""),
        (_run(bend=0.10), "course of body 8% off"),
        (_run(bend=0.0125), "course of body 1% off"),
        (_run(bend=0.0105), ""),
        (_run(peaks={"body": 3.34, "travel": 0.05}), "peak of body 1.11 times the others'"),
        (_run(peaks={"body": 3.29, "travel": 0.05}), ""),
        (_run(roughness={"body": 0.0575, "travel": 0.0002}), "body 1.8 times as rough"),
        (_run(roughness={"body": 0.0565, "travel": 0.0002}), ""),
        (_run(levels={"travel": 0.21}, frequency_hz=1.47), ", frequency +5%"),
    ],
)
def test_what_a_run_differs_in_is_said(odd: RunMeasure, text: str) -> None:
    found = _left_out(odd)
    assert bool(found) is bool(text)
    assert text in found.get("odd", ""), found


@pytest.mark.parametrize(
    ("hertz", "said"), [(1.4273, False), (1.4287, True), (1.3727, False), (1.3713, True)]
)
def test_a_frequency_is_said_from_two_percent_on(hertz: float, said: bool) -> None:
    """The others swing at 1.4 Hz."""
    found = _left_out(_run(levels={"travel": 0.21}, frequency_hz=hertz))
    assert ("frequency" in found["odd"]) is said


def test_what_differs_among_all_is_not_odd() -> None:
    levels = dict(zip("abcde", (0.200, 0.204, 0.196, 0.203, 0.211), strict=True))
    runs = {label: _run(levels={"travel": level}) for label, level in levels.items()}
    assert left_out(CHANNELS, BUMP_S, runs, 3) == {}
    runs["e"] = _run(levels={"travel": 0.225})
    assert set(left_out(CHANNELS, BUMP_S, runs, 3)) == {"e"}


def test_runs_without_measures_are_left_alone() -> None:
    assert _left_out(RunMeasure()) == {}
    assert left_out(CHANNELS, BUMP_S, {"none": RunMeasure()}, 1) == {}
    assert left_out(CHANNELS, BUMP_S, {}, 1) == {}
    assert _left_out(RunMeasure(peaks={"body": 3.0})) == {}


def test_a_simulated_kind_loses_its_spoiled_run_and_no_other() -> None:
    kind = (BASELINE, Excitation.ROLL)
    described = bench()
    found = campaign(5, described, repeats=4, spoiled=1, kinds=[kind])
    labels = [run.label for run in found.session.runs]
    assert all(f.passed for findings in found.findings for f in findings)
    out = left_out(described.channels, BUMP_S, found.of(kind), 3)
    assert set(out) == {labels[i] for i in found.spoiled}


def test_a_first_run_with_a_hand_on_the_car_is_found_by_those_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spoiled_campaigns, "SPOILS", ("hand on the car",))
    kind = (BASELINE, Excitation.BOUNCE)
    found = campaign(1000, bench(), repeats=5, spoiled=1, kinds=[kind])
    assert list(found.spoiled) == [0]
    passed = [all(f.passed for f in findings) for findings in found.findings]
    assert passed == [True, False, True, True, True]
    first = found.session.runs[0].label
    assert set(left_out(bench().channels, BUMP_S, found.of(kind), 3)) == {first}


@pytest.mark.parametrize(("level_m", "out"), [(0.2115, False), (0.2125, True)])
def test_a_level_is_odd_from_three_times_the_usual_difference_on(level_m: float, out: bool) -> None:
    """Their median is 0.203, from which they differ by 3, 1, 7 and 0 mm: the limit is at 9 mm."""
    levels = dict(zip("abcde", (0.200, 0.204, 0.196, 0.203, level_m), strict=True))
    runs = {label: _run(levels={"travel": level}) for label, level in levels.items()}
    assert set(left_out(CHANNELS, BUMP_S, runs, 3)) == ({"e"} if out else set())


@pytest.mark.parametrize(
    ("odd", "text"),
    [
        (_run(levels={"travel": 0.1984}), "travel 1.6 mm lower before the bump"),
        (_run(peaks={"body": 0.0, "travel": 0.05}), "peak of body 0.00 times the others'"),
        (_run(peaks={"body": 2.7, "travel": 0.05}), "peak of body 0.90 times the others'"),
        (_run(roughness={"body": 0.012, "travel": 0.0002}), "body 0.5 times as rough"),
        (
            _run(
                levels={"travel": 0.21},
                peaks={"body": 3.6, "travel": 0.05},
                roughness={"body": 0.3, "travel": 0.0002},
                frequency_hz=1.4,
            ),
            "travel 10.0 mm higher before the bump, peak of body 1.20 times the others'",
        ),
        (_run(levels={"travel": 0.21}, frequency_hz=None), "travel 10.0 mm higher before the bump"),
    ],
)
def test_the_first_two_differences_are_said_with_their_sense(odd: RunMeasure, text: str) -> None:
    assert _left_out(odd) == {"odd": text}


def test_a_frequency_is_said_only_if_all_the_others_have_one() -> None:
    runs = {str(k): _run(frequency_hz=1.4 if k else None) for k in range(4)}
    runs["odd"] = _run(levels={"travel": 0.21}, frequency_hz=2.8)
    text = "travel 10.0 mm higher before the bump"
    assert left_out(CHANNELS, BUMP_S, runs, 3) == {"odd": text}


@pytest.mark.parametrize(
    ("peak", "out"), [(3.31, False), (3.32, True), (2.72, False), (2.71, True)]
)
def test_peaks_are_compared_as_they_are_where_no_run_has_a_course(peak: float, out: bool) -> None:
    """A logarithm of 0.1 either way: 3 times 1.105, or 3 / 1.105."""
    runs = {str(k): _run(waves={}) for k in range(4)}
    runs["odd"] = _run(waves={}, peaks={"body": peak, "travel": 0.05})
    assert (set(left_out(CHANNELS, BUMP_S, runs, 3)) == {"odd"}) is out


@pytest.mark.parametrize(("rough", "out"), [(0.0024, False), (0.0026, True)])
def test_a_thousandth_of_the_peak_is_no_roughness(rough: float, out: bool) -> None:
    """Above nothing, 3 thousandths of 1 m/s2 count as 1, and exp(0.6) = 1.822 is the limit."""
    runs = {str(k): _run(roughness={"body": 0.0, "travel": 0.0}) for k in range(4)}
    runs["odd"] = _run(roughness={"body": rough, "travel": 0.0})
    assert (set(left_out(CHANNELS, BUMP_S, runs, 3)) == {"odd"}) is out


OTHER = Channel("other", Quantity.SUSPENSION_TRAVEL, "m", "S.o", corner=Corner.FRONT_RIGHT)
PITCH = Channel("pitch", Quantity.PITCH_RATE, "rad/s", "B.p")
ROLL = Channel("roll", Quantity.ROLL_RATE, "rad/s", "B.r")


@pytest.mark.parametrize(
    ("large", "small", "size", "out"),
    [("travel", "other", 0.31, True), ("travel", "other", 0.3, False),
     ("pitch", "roll", 0.29, False), ("pitch", "body", 0.29, True)],
)  # fmt: skip
def test_peaks_count_from_three_tenths_of_the_largest_of_their_kind_on(
    large: str, small: str, size: float, out: bool
) -> None:
    """Half as high as usual; the rates of pitch and roll are of one kind."""
    runs = {str(k): RunMeasure(peaks={large: 1.0, small: size}) for k in range(4)}
    runs["odd"] = RunMeasure(peaks={large: 1.0, small: size / 2})
    found = left_out((*CHANNELS, OTHER, PITCH, ROLL), BUMP_S, runs, 3)
    assert (set(found) == {"odd"}) is out


def test_a_level_is_a_share_of_the_largest_travel() -> None:
    """0.03 of 0.1 m are 3 mm, for the travel of 0.05 m too."""
    for level_m, out in ((0.2029, False), (0.2031, True)):
        peaks = {"travel": 0.05, "other": 0.1}
        runs = {str(k): RunMeasure(peaks=peaks, levels={"travel": 0.2}) for k in range(4)}
        runs["odd"] = RunMeasure(peaks=peaks, levels={"travel": level_m})
        found = left_out((*CHANNELS, OTHER), BUMP_S, runs, 3)
        assert (set(found) == {"odd"}) is out
        assert not out or found["odd"] == "travel 3.1 mm higher before the bump"


@pytest.mark.parametrize(("first", "out"), [(0, False), (5, False), (11, True), (40, True)])
def test_a_course_counts_from_80_ms_after_the_bump_on(first: int, out: bool) -> None:
    """Means are every 20 ms from 0.1 s on, and the bump takes 0.2 s: the tenth is at 0.28 s."""
    usual = _run()
    jump = np.where((np.arange(70) >= first) & (np.arange(70) < first + 4), 0.2, 0.0)
    odd = _run(waves={name: wave + jump * (name == "body") for name, wave in usual.waves.items()})
    runs = {**{str(k): usual for k in range(4)}, "odd": odd}
    assert (set(left_out(CHANNELS, 0.2, runs, 3)) == {"odd"}) is out


def test_runs_are_left_out_one_by_one_from_the_oddest_on() -> None:
    levels = {"a": 0.2, "b": 0.2, "c": 0.2, "d": 0.2, "far": 0.23, "near": 0.21}
    runs = {label: _run(levels={"travel": level}) for label, level in levels.items()}
    assert list(left_out(CHANNELS, BUMP_S, runs, 3)) == ["far", "near"]
    assert list(left_out(CHANNELS, BUMP_S, runs, 5)) == ["far"]
