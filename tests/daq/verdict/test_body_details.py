"""Which wheels were struck, by body, travels and hubs, and what a judged run says of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Method, Step
from daq.bumps import Wheels
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure, RunWindow, judge
from daq.verdict.bump_kind import Body, Pattern, mirrored, of_body, patterns, struck
from daq.verdict.motion import not_decayed
from daq.verdict.window import traces

from . import closed_forms as forms
from . import test_kinds_of_bumps as kinds
from .test_kinds_of_bumps import BUMP_NS, PITCH, RATES, ROLL, T_S, TURNS, Z, bench_of, found
from .test_kinds_of_bumps import P as PITCH_OF_1
from .test_kinds_of_bumps import R as ROLL_OF_1

FL, FR, RL, RR = Corner
FRONT, REAR, LEFT, RIGHT = (Wheels(pair) for pair in ((FL, FR), (RL, RR), (FL, RL), (FR, RR)))
BOUNCE = Excitation.BOUNCE


def test_a_push_is_compared_axle_with_axle_and_side_with_side() -> None:
    """Corners at 4, 0, 3, -1: heave 3, pitch 1, roll 4; axles at 4 and 2, sides at 7 and 1."""
    swing = np.where(T_S > 0.0, np.sin(3 * np.pi * T_S) * np.exp(-T_S), 0.0)
    shapes = {c: 0.01 * n * swing for c, n in zip(Corner, (4, 0, 3, -1), strict=True)}
    records = kinds.corners(Quantity.SUSPENSION_TRAVEL, "m", shapes)
    (pattern,) = found(records, Method.PUSH)
    assert list(pattern.shares.values()) == pytest.approx([9 / 26, 1 / 26, 16 / 26, 0.0], abs=1e-6)
    pitch, roll = (1 / 3 / 0.4) / 17, 16 / 17
    like = {FRONT: pitch, REAR: pitch / 2, LEFT: roll, RIGHT: roll / 7, Wheels(Corner): 0.5}
    assert {w: pattern.strikes[w] for w in like} == pytest.approx(like, abs=1e-6)


@pytest.mark.parametrize(
    ("body", "like"),
    [
        # Turning by a tenth and a fifth of heave; the rear 2 to 3, the left 1 to 2.
        (Body(2.0, 0.4, 0.2, 3.0, 2.0, 1.5, 3.0), (8 / 9, 0.4, 0.8 / 3, 0.025, 0.05)),
        (Body(2.0, 0.2, 0.4, 2.0, 3.0, 3.0, 1.5), (8 / 9, 0.1 / 3, 0.05, 0.4, 0.2)),
        (Body(0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0), (0.5, 1.0, 1.0, 0.0, 0.0)),
        (Body(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_the_likeness_of_a_body_to_each_strike(body: Body, like: tuple[float, ...]) -> None:
    pattern = of_body((BOUNCE, PITCH, ROLL), body, {}, "body's motion")
    wheels = (Wheels(Corner), FRONT, REAR, LEFT, RIGHT)
    assert [pattern.strikes[w] for w in wheels] == pytest.approx(like, abs=1e-9)
    assert pattern.strikes[Wheels({FL, RR})] == pattern.strikes[Wheels({FR, RL})] == like[0]


def test_a_body_whose_ends_move_alike_goes_by_the_nose() -> None:
    pattern = of_body((BOUNCE, PITCH), Body(1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0), {}, "")
    assert pattern.words == "pitch: nose and tail against each other, the nose more"


@pytest.mark.parametrize(
    ("heave", "pitch", "roll", "wheels", "share"),
    [
        (2.0, 1.0, 0.0, (REAR, FRONT), 1 / 3),  # ends at 2 - 1 and 2 + 1
        (2.0, -1.0, 0.0, (FRONT, REAR), 1 / 3),
        (1.0, 0.0, 0.5, (LEFT, RIGHT), 1 / 3),  # sides at 1 + 0.5 and 1 - 0.5
        (1.0, 0.0, -0.5, (RIGHT, LEFT), 1 / 3),
    ],
)
@pytest.mark.parametrize("place", [replace(Z, at_cg=True), replace(Z, x_m=-1.35)])
def test_ends_and_sides_of_a_body_move_about_its_middle(
    place: Channel,
    heave: float,
    pitch: float,
    roll: float,
    wheels: tuple[Wheels, Wheels],
    share: float,
) -> None:
    """The CG is taken for the middle between the axles, 1.35 m behind the front one."""
    turns = (kinds.jolt(PITCH_OF_1 * pitch), kinds.jolt(ROLL_OF_1 * roll))
    (pattern,) = found({place: kinds.jolt(heave), TURNS[0]: turns[0], TURNS[1]: turns[1]})
    assert pattern.strikes[wheels[0]] == pytest.approx(1.0, abs=0.01)
    assert pattern.strikes[wheels[1]] == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(("aside_m", "known"), [(0.05, False), (0.2, True)])
def test_accelerometers_nearly_in_line_do_not_show_roll(aside_m: float, known: bool) -> None:
    points = {
        replace(Z, name=n, signal=f"B.{n}", x_m=float(x), y_m=aside_m * (x % 2)): kinds.jolt(1.0)
        for x, n in enumerate("abcd")
    }
    assert bool(found(points)) is known


def test_what_a_record_no_longer_shows_moves_no_body() -> None:
    """It rises at 10 m/s2 for 0.1 s, where the record ends, and pitches as fast as it rises."""
    kept = T_S < 0.1
    t_ns = BUMP_NS + np.rint(T_S * 1e9).astype(np.int64)
    rise = np.where(T_S > 0.0, 10.0, 0.0)
    block = {
        Z.name: (t_ns[kept], rise[kept]),
        RATES[0].name: (t_ns, kinds.rate(PITCH_OF_1, 0.1)),
        RATES[1].name: (t_ns, kinds.rate(0.0)),
    }
    bench = bench_of((Z, *RATES))
    (pattern,) = patterns(bench, traces(bench.channels, RunWindow(BUMP_NS, block)))
    assert pattern.shares["pitch"] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "counts"), [(-0.0495, -0.034, True), (-0.066, -0.0505, False)]
)
def test_hubs_are_struck_from_50_ms_before_the_bump_on(
    start_s: float, stop_s: float, counts: bool
) -> None:
    early = np.where((start_s < T_S) & (stop_s > T_S), 20.0, 0.0)
    records = {c: v + early * (c.corner in REAR) for c, v in kinds.hubs((1, 1, 0, 0)).items()}
    (pattern,) = found(records)
    assert (pattern.likeness[BOUNCE] > 0.6) is counts
    assert counts or pattern.likeness[BOUNCE] == pytest.approx(0.5, abs=1e-6)


def test_wheels_that_drop_go_down_first() -> None:
    front = {channel: -value for channel, value in kinds.travels((1, 1, 0, 0)).items()}
    (dropped,) = found(front, Method.DROP)
    assert dropped.words == "pitch: front wheels only"
    (rolled,) = found({channel: -value for channel, value in front.items()})
    assert rolled.words == "pitch: front wheels only"


def test_still_wheels_are_like_no_bump() -> None:
    (pattern,) = found(kinds.hubs((0, 0, 0, 0)))
    assert set(pattern.likeness.values()) == {0.0}
    assert set(pattern.shares.values()) == {0.0}


@pytest.mark.parametrize(
    ("like", "strikes", "wheels"),
    [
        (0.79, {FRONT: 0.79}, None),
        (0.8, {FRONT: 0.8}, FRONT),
        (0.8, {}, FRONT),
        (1.0, {FRONT: 0.8, REAR: 1.0}, FRONT),  # 1.25 times as like is not more than that
        (1.0, {FRONT: 0.79, REAR: 1.0}, REAR),
        (0.9, {REAR: 0.9}, REAR),
    ],
)
def test_the_wheels_that_were_struck(
    like: float, strikes: dict[Wheels, float], wheels: Wheels | None
) -> None:
    pattern = Pattern({}, {PITCH: like}, "", "hubs", 0.8, strikes)
    assert struck(PITCH, pattern) == wheels
    named = [(f.code, f.passed, f.value, f.limit) for f in mirrored(PITCH, pattern)]
    assert named == ([("mirrored", True, like, 0.8)] if wheels == REAR else [])


def judged(sizes: tuple[float, ...], accepted: list[RunMeasure], unlike: list[RunMeasure]) -> str:
    """Return the codes of what failed in a pitch of these hubs."""
    records = kinds.hubs(sizes)
    step = Step(BASELINE, PITCH, 1)
    findings, _ = judge(bench_of(tuple(records)), step, kinds.run_of(records), accepted, unlike)
    return " ".join(finding.code for finding in findings if not finding.passed)


S = 1e-6
"""Size of the motion of a wheel that is not struck: it trembles."""


def test_a_run_is_compared_with_runs_of_the_same_wheels_only() -> None:
    def measure(sizes: tuple[float, ...]) -> RunMeasure:
        records = kinds.hubs(sizes)
        step = Step(BASELINE, PITCH, 1)
        return judge(bench_of(tuple(records)), step, kinds.run_of(records), ())[1]

    front, rear, higher = measure((1, 1, S, S)), measure((S, S, 1, 1)), measure((2, 2, S, S))
    assert (front.wheels, rear.wheels) == (FRONT, REAR)
    assert judged((2, 2, S, S), [rear], []) == ""
    assert judged((2, 2, S, S), [front], []) == "not_repeatable"
    assert judged((2, 2, S, S), [front, rear], [rear]) == "not_repeatable"
    assert judged((2, 2, S, S), [front], [higher]) == ""


def test_a_run_is_judged_in_the_order_of_cause_and_effect() -> None:
    records = kinds.travels((1, 1, 1, 1)) | {Z: kinds.jolt(1.0), TURNS[0]: kinds.jolt(PITCH_OF_1)}
    records |= {TURNS[1]: kinds.jolt(0.0)}
    step = Step(BASELINE, BOUNCE, 1)
    findings, measure = judge(bench_of(tuple(records)), step, kinds.run_of(records), ())
    assert [finding.code for finding in findings] == [
        *("stale", "lost_frames", "overload", "frozen", "not_at_rest", "too_weak"),
        *("double_bump", "too_strong", "wrong_mode", "wrong_mode", "not_decayed", "rest_changed"),
        "motion",
    ]
    assert measure.purity == pytest.approx(1.0)  # by the travels, not by the body that pitches
    assert list(measure.shares) == ["bounce", "pitch", "roll", "warp"]
    assert set(measure.levels) == {c.name for c in records if c.corner}
    assert set(measure.roughness) == {c.name for c in records}


def test_a_run_that_shows_nothing_says_so() -> None:
    still = {RATES[0]: np.zeros(len(T_S))}
    step = Step(BASELINE, BOUNCE, 1)
    findings, measure = judge(bench_of(tuple(still)), step, kinds.run_of(still), ())
    last = findings[-1]
    assert (last.code, last.passed, last.text) == ("motion", True, "nothing measured")
    assert (last.value, last.limit, last.unit) == (0.0, 0.0, "Hz")
    assert (measure.peak_m, measure.peak_m_s2, measure.wheels) == (None, None, None)


def test_hubs_decay_only_where_nothing_slower_shows_the_car() -> None:
    hop = np.where(forms.T_S > 0.0, 20.0 * np.sin(20 * np.pi * forms.T_S), 0.0)
    alone = forms.one(not_decayed, {forms.HUB: hop})
    assert (alone.passed, alone.subject) == (False, "hub")
    both = forms.one(not_decayed, {forms.HUB: hop, forms.TRAVEL: forms.pulse(0.05)})
    assert (both.passed, both.subject) == (True, "travel")
