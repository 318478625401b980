"""The kind of a bump in numbers worked out by hand: wheels that go together, body that turns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Method, Step
from daq.bumps import Wheels
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict.bump_kind import Pattern, patterns, wrong_mode
from daq.verdict.judge import judge

from .closed_forms import T_S, Array, bench_of, run_of, seen

FL, FR, RL, RR = Corner
FRONT, REAR = Wheels({FL, FR}), Wheels({RL, RR})
P, R = 1 / 1.35, 1 / 0.75
"""Rates that move a corner by 1 m/s: the levers of a usual car are 1.35 m and 0.75 m."""
BOUNCE, PITCH, ROLL, WARP = Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.WARP


def found_by(
    records: Mapping[Channel, Array], method: Method = Method.ROLL_OVER
) -> tuple[Pattern, ...]:
    bench = bench_of(*records)
    bench = replace(bench, campaign=replace(bench.campaign, method=method))
    return patterns(bench, seen(records))


def corners(quantity: Quantity, unit: str, shapes: Mapping[Corner, Array]) -> dict[Channel, Array]:
    return {
        Channel(f"{quantity}_{c}", quantity, unit, f"W_{c}.v", corner=c): shape
        for c, shape in shapes.items()
    }


def hubs(sizes: tuple[float, ...]) -> dict[Channel, Array]:
    hop = np.where((T_S > 0.0) & (T_S < 0.5), np.sin(2 * np.pi * 10.0 * T_S), 0.0)
    shapes = {c: 20.0 * size * hop for c, size in zip(Corner, sizes, strict=True)}
    return corners(Quantity.HUB_ACCELERATION, "m/s2", shapes)


def travels(
    sizes: tuple[float, ...], quantity: Quantity = Quantity.SUSPENSION_TRAVEL
) -> dict[Channel, Array]:
    """Return travels that rise to a size while the wheels are on the board, and fall below."""
    rise = np.where((T_S > 0.0) & (T_S < 0.19), np.sin(np.pi * T_S / 0.19), 0.0)
    after = np.where((T_S > 0.2) & (T_S < 0.6), np.sin(2 * np.pi * T_S / 0.4), 0.0)
    shapes = {c: 0.03 * size * rise + 0.06 * after for c, size in zip(Corner, sizes, strict=True)}
    return corners(quantity, "m", shapes)


# Likeness to bounce, pitch, roll and warp: of each, the best of its patterns.
STRUCK = [
    ((1, 1, 1, 1), "bounce: all four wheels", (1, 1 / 2, 1 / 2, 1 / 2)),
    ((1, 1, 0, 0), "pitch: front wheels only", (1 / 2, 1, 1 / 4, 1 / 4)),
    ((0, 0, 1, 1), "pitch: rear wheels only", (1 / 2, 1, 1 / 4, 1 / 4)),
    ((1, 0, 1, 0), "roll: left wheels only", (1 / 2, 1 / 4, 1, 1 / 4)),
    ((0, 1, 0, 1), "roll: right wheels only", (1 / 2, 1 / 4, 1, 1 / 4)),
    ((1, 0, 0, 1), "warp: front left and rear right", (1 / 2, 1 / 4, 1 / 4, 1)),
    ((0, 1, 1, 0), "warp: front right and rear left", (1 / 2, 1 / 4, 1 / 4, 1)),
    ((1, 0, 0, 0), "no kind of bump: one wheel only", (1 / 4, 1 / 2, 1 / 2, 1 / 2)),
    ((0, 0, 0, 1), "no kind of bump: one wheel only", (1 / 4, 1 / 2, 1 / 2, 1 / 2)),
    ((1, 1, 1, 0), "no kind of bump: three wheels", (3 / 4, 2 / 3, 2 / 3, 2 / 3)),
    ((0, 1, 1, 1), "no kind of bump: three wheels", (3 / 4, 2 / 3, 2 / 3, 2 / 3)),
]


@pytest.mark.parametrize(("struck", "words", "likeness"), STRUCK)
def test_wheels_that_go_together(
    struck: tuple[int, ...], words: str, likeness: tuple[float, ...]
) -> None:
    heights = travels(struck, Quantity.HUB_DISPLACEMENT)
    for records, by in (
        (hubs(struck), "hubs"), (travels(struck), "travels"), (heights, "hub displacements"),
    ):  # fmt: skip
        (pattern,) = found_by(records)
        assert (pattern.words, pattern.by, pattern.limit) == (words, by, 0.8)
        assert [pattern.likeness[kind] for kind in (BOUNCE, PITCH, ROLL, WARP)] == pytest.approx(
            likeness, abs=1e-3
        )


def test_a_push_is_judged_by_travels_alone() -> None:
    swing = np.where(T_S > 0.0, np.sin(2 * np.pi * 1.5 * T_S) * np.exp(-T_S), 0.0)
    for signs, words, kind in (
        ((1, 1, 1, 1), "bounce: the body stays level", BOUNCE),
        ((1, 1, -1, -1), "pitch: nose and tail against each other", PITCH),
        ((1, -1, 1, -1), "roll: left and right against each other", ROLL),
    ):
        shapes = {c: 0.02 * s * swing for c, s in zip(Corner, signs, strict=True)}
        records = corners(Quantity.SUSPENSION_TRAVEL, "m", shapes) | hubs((1, 0, 0, 0))
        (pattern,) = found_by(records, Method.PUSH)
        assert pattern.words.startswith(words)
        assert (pattern.by, pattern.limit) == ("travels", 0.65)
        assert pattern.likeness[kind] == pytest.approx(1.0)
    assert found_by(hubs((1, 1, 1, 1)), Method.PUSH) == ()


Z = Channel("z", Quantity.BODY_ACCELERATION, "m/s2", "IMU.z")
RATES = (
    Channel("p", Quantity.PITCH_RATE, "rad/s", "IMU.p"),
    Channel("r", Quantity.ROLL_RATE, "rad/s", "IMU.r"),
)
TURNS = (
    Channel("pa", Quantity.PITCH_ACCELERATION, "rad/s2", "IMU.pa"),
    Channel("ra", Quantity.ROLL_ACCELERATION, "rad/s2", "IMU.ra"),
)


def jolt(speed: float, at_s: float = 0.1) -> Array:
    """Return an acceleration that reaches a speed: a whole sine of 0.04 s and 0.02 s^-1 f.

    Its integral rises to speed = a T / pi at half the period and returns to zero.
    """
    within = (at_s - 0.02 <= T_S) & (at_s + 0.02 > T_S)
    return np.where(within, -speed * np.pi / 0.04 * np.sin(2 * np.pi * (T_S - at_s) / 0.04), 0.0)


def rate(size: float, at_s: float = 0.1) -> Array:
    """Return a rate for 3 ms."""
    return np.where(np.abs(T_S - at_s) < 0.0015, size, 0.0)


# A positive pitch lowers the nose: while the body rises, the tail moves more.
PITCHES = "pitch: nose and tail against each other, the tail more"


@pytest.mark.parametrize(
    ("heave", "pitch", "roll", "likeness", "words"),
    [
        # Not turning at all, turning as much as heaving, twice as much, and half as much.
        (1.0, 0.0, 0.0, (1.0, 0.0, 0.0), "bounce: the body stays level"),
        (1.0, 1.0, 0.0, (0.5, 1.0, 0.0), PITCHES),
        (1.0, 0.0, 2.0, (0.5, 0.0, 1.0), "roll: left and right against each other"),
        (1.0, 0.45, 0.0, (0.75, 1.0, 0.0), PITCHES),
        (1.0, 0.0, 0.36, (0.8, 0.0, 0.9), "roll: left and right against each other"),
        (1.0, 0.2, 0.0, (1 - 0.1 / 0.9, 0.5, 0.0), "bounce: the body stays level"),
        # Turning about both axes: the share of one in both.
        (1.0, 0.8, 0.4, (1 - 0.4 / 0.9, 0.8, 0.2), PITCHES),
        (1.0, 0.3, 0.9, (0.5, 0.75 * 0.1, 0.9), "roll: left and right against each other"),
    ],
)
def test_a_body_that_heaves_and_turns(
    heave: float, pitch: float, roll: float, likeness: tuple[float, float, float], words: str
) -> None:
    by_rates = {Z: jolt(heave), RATES[0]: rate(P * pitch), RATES[1]: rate(R * roll)}
    by_turns = {Z: jolt(heave), TURNS[0]: jolt(P * pitch), TURNS[1]: jolt(R * roll)}
    for records in (by_rates, by_turns):
        (pattern,) = found_by(records)
        assert (pattern.words, pattern.by, pattern.limit) == (words, "body's motion", 0.65)
        got = [pattern.likeness[kind] for kind in (BOUNCE, PITCH, ROLL)]
        assert got == pytest.approx(likeness, abs=0.01)
        assert pattern.likeness[WARP] == pattern.likeness[BOUNCE]


@pytest.mark.parametrize(
    ("at_s", "counts"), [(-0.045, True), (-0.055, False), (0.295, True), (0.305, False)]
)
def test_the_strike_is_from_50_ms_before_the_bump_to_100_ms_after_it(
    at_s: float, counts: bool
) -> None:
    """The bump of the shipped bench is over after 0.2 s."""
    (pattern,) = found_by({Z: jolt(1.0), RATES[0]: rate(P, at_s), RATES[1]: rate(0.0)})
    assert (pattern.likeness[PITCH] > 0.4) is counts


def test_travels_are_judged_with_the_body_and_hubs_without() -> None:
    body = {Z: jolt(1.0), RATES[0]: rate(P), RATES[1]: rate(0.0)}
    assert [p.by for p in found_by(travels((1, 1, 1, 1)) | body)] == ["travels", "body's motion"]
    assert [p.by for p in found_by(hubs((1, 1, 1, 1)) | travels((1, 1, 1, 1)) | body)] == ["hubs"]
    three = dict(list(hubs((1, 1, 1, 1)).items())[:3])
    assert found_by(three) == ()


@pytest.mark.parametrize(("like", "passed"), [(0.65, True), (0.64, False)])
def test_a_kind_is_told_from_another_by_its_limit(like: float, passed: bool) -> None:
    pattern = Pattern({PITCH: like}, "bounce: level", "hubs", 0.65)
    (finding,) = wrong_mode(PITCH, pattern)
    assert (finding.passed, finding.value, finding.limit) == (passed, like, 0.65)
    assert ("looks like bounce: level, not pitch" in finding.text) is not passed


@pytest.mark.parametrize(
    ("start_s", "stop_s", "counts"), [(-0.0495, -0.034, True), (-0.066, -0.0505, False)]
)
def test_hubs_are_struck_from_50_ms_before_the_bump_on(
    start_s: float, stop_s: float, counts: bool
) -> None:
    early = np.where((start_s < T_S) & (stop_s > T_S), 20.0, 0.0)
    records = {c: v + early * (c.corner in REAR) for c, v in hubs((1, 1, 0, 0)).items()}
    (pattern,) = found_by(records)
    assert (pattern.likeness[BOUNCE] > 0.6) is counts
    assert counts or pattern.likeness[BOUNCE] == pytest.approx(0.5, abs=1e-6)


def test_a_run_is_judged_in_the_order_of_cause_and_effect() -> None:
    records = travels((1, 1, 1, 1)) | {Z: jolt(1.0), TURNS[0]: jolt(P)}
    records |= {TURNS[1]: jolt(0.0)}
    step = Step(BASELINE, BOUNCE, 1)
    findings, _ = judge(bench_of(*records), step, run_of(records), ())
    assert [finding.code for finding in findings] == [
        *("stale", "lost_frames", "overload", "frozen", "not_at_rest", "too_weak"),
        *("double_bump", "too_strong", "wrong_mode", "wrong_mode", "not_decayed", "rest_changed"),
        "motion",
    ]
    assert findings[-1].text.endswith("100% pure")  # by the travels, not by the body that pitches
