"""The runs of a kind that belong together, where there are more than planned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure
from daq.verdict.consistent import left_out
from daq.verdict.repeats import after

from .. import spoiled_campaigns
from ..spoiled_campaigns import BUMP_S, bench, campaign

CHANNELS = (
    Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "B.a"),
    Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", "S.t", corner=Corner.FRONT_LEFT),
)
T_S = np.arange(0.1, 1.5, 0.02)


def _run(size: float = 1.0, bend: float = 0.0, **changed: object) -> RunMeasure:
    wave = size * (np.exp(-2.0 * T_S) * (np.cos(8.8 * T_S) + bend * np.sin(20.0 * T_S)))
    found = RunMeasure(
        peaks={"body": 3.0 * size, "travel": 0.05 * size},
        waves={"body": wave, "travel": 0.01 * wave},
        levels={"travel": 0.2},
        roughness={"body": 0.03, "travel": 0.0002},
        frequency_hz=1.4,
        damping=0.2,
    )
    return replace(found, **changed)  # type: ignore[arg-type]


def _left_out(odd: RunMeasure, others: int = 4, planned: int = 3) -> dict[str, str]:
    measures = {f"run_{k}": _run() for k in range(others)}
    return left_out(CHANNELS, BUMP_S, {**measures, "odd": odd}, planned)


@pytest.mark.parametrize(
    ("planned", "others", "out"), [(3, 3, True), (4, 3, False), (2, 3, True), (1, 2, False)]
)
def test_never_fewer_stay_than_planned_nor_than_three(planned: int, others: int, out: bool) -> None:
    assert (set(_left_out(_run(bend=0.5), others, planned)) == {"odd"}) is out


@pytest.mark.parametrize(
    ("start_s", "first"), [(0.0, 0), (0.1, 0), (0.11, 1), (0.28, 9), (0.281, 10), (0.3, 10)]
)
def test_a_course_begins_at_the_first_mean_from_a_time_on(start_s: float, first: int) -> None:
    """Means are every 20 ms from 0.1 s on."""
    cut = after(_run(waves={"body": np.arange(70.0), "travel": np.arange(70.0)}), start_s)
    assert [wave[0] for wave in cut.waves.values()] == [first, first]
    assert [len(wave) for wave in cut.waves.values()] == [70 - first] * 2


def test_height_and_timing_of_a_bump_do_not_matter() -> None:
    late = np.exp(-2.0 * (T_S - 0.01)) * np.cos(8.8 * (T_S - 0.01))
    assert _left_out(_run(1.3)) == {}
    assert _left_out(_run(waves={"body": late, "travel": 0.01 * late})) == {}


@pytest.mark.parametrize(("hertz", "out"), [(3.0, True), (8.0, False)])
def test_only_what_is_as_slow_as_the_body_is_its_course(hertz: float, out: bool) -> None:
    wave = np.exp(-2.0 * T_S) * np.cos(8.8 * T_S) + 0.01 * np.cos(2.0 * np.pi * hertz * T_S)
    odd = _run(waves={"body": wave, "travel": 0.01 * wave})
    assert (set(_left_out(odd)) == {"odd"}) is out


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
