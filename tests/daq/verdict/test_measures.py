"""The measures of a run against closed forms: peaks, noise, the body's wave, the slow course."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Step
from daq.bench.config import Bench, load_bench
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure, RunWindow, judge, peak_left
from daq.verdict.motion import double_bump, not_decayed, rest_changed
from daq.verdict.repeats import not_repeatable, waves
from daq.verdict.traffic import stale
from daq.verdict.wave import body_wave
from daq.verdict.window import Trace, traces

Array = NDArray[np.float64]
BUMP_NS = 1_800_000_000_000_000_000
T_S: Array = np.arange(-1000.0, 2500.0) / 1000.0
HUB = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", "HUB.a", corner=Corner.FRONT_LEFT)
TRAVEL = Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", "S.z", corner=Corner.FRONT_LEFT)
OTHER = Channel("other", Quantity.SUSPENSION_TRAVEL, "m", "S.y", corner=Corner.FRONT_RIGHT)
BODY = Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "IMU.z")
PITCH = Channel("pitch", Quantity.PITCH_RATE, "rad/s", "IMU.p")
TURN = Channel("turn", Quantity.PITCH_ACCELERATION, "rad/s2", "IMU.t")
HEIGHT = Channel("height", Quantity.BODY_DISPLACEMENT, "m", "L.z")
FRONT = (Corner.FRONT_LEFT, Corner.FRONT_RIGHT)
BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)


def bench_of(*channels: Channel, **trigger: float) -> Bench:
    bench = load_bench(None)
    return replace(bench, channels=channels, trigger=bench.trigger.model_copy(update=trigger))


def window(records: Mapping[Channel, Array], time_s: Array = T_S) -> RunWindow:
    t_ns = BUMP_NS + np.rint(time_s * 1e9).astype(np.int64)
    return RunWindow(BUMP_NS, {c.name: (t_ns, value) for c, value in records.items()})


def seen(records: Mapping[Channel, Array], time_s: Array = T_S) -> tuple[Trace, ...]:
    return traces(tuple(records), window(records, time_s))


def ringing(frequency_hz: float, damping: float, size: float = 1.0, shift: float = 0.4) -> Array:
    """Return a damped wave from the bump on, by its undamped frequency."""
    omega = 2 * np.pi * frequency_hz
    phase = omega * np.sqrt(1 - damping**2) * T_S + shift
    wave = np.exp(-omega * damping * np.clip(T_S, 0.0, None)) * np.sin(phase)
    return np.where(T_S > 0.0, size * wave, 0.0)


@pytest.mark.parametrize(
    ("frequency_hz", "damping"),
    [(1.05, 0.25), (0.7, 0.1), (1.6, 0.4), (3.1, 0.05), (0.45, 0.2), (4.6, 0.03), (1.0, 0.012)],
)
@pytest.mark.parametrize("channel", [TRAVEL, PITCH, BODY, HEIGHT, TURN])
def test_the_wave_of_the_body(channel: Channel, frequency_hz: float, damping: float) -> None:
    wave = body_wave(seen({channel: ringing(frequency_hz, damping)}), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(frequency_hz, rel=0.0035)
    assert wave[1] == pytest.approx(damping, abs=0.0025)


def test_the_wave_has_a_level_of_its_own() -> None:
    """A car that comes to rest elsewhere, and the bump itself, do not change the wave."""
    board = np.where((T_S > 0.0) & (T_S < 0.39), 5.0, 0.0)
    value = ringing(1.3, 0.2) + np.where(T_S > 0.0, 0.7, 0.0) + board
    wave = body_wave(seen({TRAVEL: value}), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(1.3, rel=0.01)
    assert wave[1] == pytest.approx(0.2, abs=0.012)


def test_the_wave_is_of_what_shows_the_body_best() -> None:
    slow, quick = ringing(0.8, 0.2), ringing(2.4, 0.1)
    order = [(TRAVEL, PITCH), (PITCH, HEIGHT), (BODY, HEIGHT), (HEIGHT, TURN)]
    for first, second in order:
        for channels in ((first, second), (second, first)):
            records = {c: slow if c is first else quick for c in channels}
            wave = body_wave(seen(records), 0.2)
            assert wave is not None
            assert wave[0] == pytest.approx(0.8, rel=0.01)
    assert body_wave(seen({HUB: slow}), 0.2) is None


def noisy(value: Array, noise: float) -> Array:
    """Add samples that differ by `noise` sqrt(2) each before the bump, and none after it."""
    turn = np.resize([0.0, 1.0, 0.0, -1.0], len(T_S)) * np.sqrt(2.0)
    return value + np.where(T_S < -0.0301, noise * turn, 0.0)


@pytest.mark.parametrize(("ratio", "shows"), [(4.9, False), (5.1, True)])
def test_a_wave_is_searched_for_from_five_times_the_noise_on(ratio: float, shows: bool) -> None:
    size = float(np.max(np.abs(ringing(1.0, 0.1))))
    records = {TRAVEL: noisy(ringing(1.0, 0.1), size / ratio)}
    assert (body_wave(seen(records), 0.2) is not None) is shows


def test_the_wave_is_of_what_shows_the_body_most_clearly() -> None:
    """The acceleration is quieter, the rate is further above its noise."""
    records = {
        BODY: noisy(ringing(2.4, 0.2, 0.3), 0.001),
        PITCH: noisy(ringing(0.8, 0.2, 50.0), 0.01),
    }
    wave = body_wave(seen(records), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(0.8, rel=0.01)


@pytest.mark.parametrize(("stop_s", "shows"), [(1.39, False), (1.42, True)])
def test_a_wave_needs_a_second_after_the_bump(stop_s: float, shows: bool) -> None:
    """The wheels come to rest 0.2 s after the bump of 0.2 s."""
    short = stop_s > T_S
    found = seen({TRAVEL: ringing(1.5, 0.1)[short]}, T_S[short])
    assert (body_wave(found, 0.2) is not None) is shows


def test_of_several_sensors_the_one_with_the_least_noise_counts() -> None:
    roll = replace(PITCH, name="roll", quantity=Quantity.ROLL_RATE)
    records = {
        PITCH: noisy(ringing(0.8, 0.2, 2.0), 0.1),
        roll: noisy(ringing(2.4, 0.1, 1.0), 0.02),
    }
    wave = body_wave(seen(records), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(2.4, rel=0.01)


def test_travels_count_together_by_what_they_share() -> None:
    slow, quick = ringing(0.8, 0.2), ringing(2.4, 0.1)
    wave = body_wave(seen({TRAVEL: slow + 0.2 * quick, OTHER: slow - 0.2 * quick}), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(0.8, rel=0.02)
    assert wave[1] == pytest.approx(0.2, abs=0.03)


def test_a_trace_is_the_deviation_from_rest() -> None:
    rest = np.resize([1.0, 1.0, 3.0], len(T_S))  # median 1, mean 5/3
    value = np.where(T_S < -0.0301, rest, 1.0)
    value[T_S == 0.0] = 7.0
    value[T_S == 1.0] = -8.0
    (trace,) = seen({TRAVEL: value})
    assert trace.peak == 9.0
    assert trace.moved == pytest.approx(np.sqrt(8 / 9), rel=1e-3)
    assert trace.noise == pytest.approx(2 * np.sqrt(2 / 3) / np.sqrt(2), rel=2e-3)
    assert list(trace.part(-0.001, 0.002)) == [0.0, 6.0, 0.0]
    assert replace(trace, noise=0.0).rms(0.0, 0.004) == 3.0
    assert replace(trace, noise=3.0).rms(0.0, 0.002) == 3.0
    assert replace(trace, noise=5.0).rms(0.0, 0.002) == 0.0
    assert replace(trace, noise=0.0).rms(5.0, 6.0) == 0.0


def test_a_channel_with_eight_samples_and_rest_before_the_bump_counts() -> None:
    time_s = np.array([-0.5, -0.4, -0.031, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert len(seen({TRAVEL: time_s}, time_s)) == 1
    assert len(seen({TRAVEL: time_s[1:]}, time_s[1:])) == 0
    late = np.array([-0.029, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert len(seen({TRAVEL: late}, late)) == 0
    gap = np.where(time_s == 0.2, np.nan, time_s)
    assert len(seen({TRAVEL: gap}, time_s)) == 0
    unused = Channel("unused", Quantity.UNUSED, "m", "S.u")
    assert len(seen({unused: time_s}, time_s)) == 0


def test_samples_that_came_out_of_order_are_sorted() -> None:
    time_s = np.array([-0.5, -0.4, -0.3, 0.1, 0.3, 0.2, 0.4, 0.5])
    (trace,) = seen({TRAVEL: np.arange(8.0)}, time_s)
    assert list(trace.value) == [-1.0, 0.0, 1.0, 2.0, 4.0, 3.0, 5.0, 6.0]


def test_the_course_is_the_mean_of_60_ms_every_20_ms() -> None:
    time_s = T_S + 0.0005  # no sample on the edge of a mean
    square = np.where(T_S >= 0.0, time_s**2, 0.0)
    found = waves(seen({TRAVEL: square, HUB: square}, time_s))
    assert list(found) == ["travel"]
    centre_s = 0.1 + 0.02 * np.arange(70)
    assert len(found["travel"]) == 70
    # The mean of t^2 over a width w about c is c^2 + w^2 / 12.
    assert found["travel"] == pytest.approx(centre_s**2 + 0.06**2 / 12, abs=1e-6)


def test_a_course_of_few_samples_is_taken_between_them() -> None:
    coarse = np.array([-0.9, -0.5, -0.1, 0.0, 0.08, 0.3, 1.1, 1.9])
    (found,) = waves(seen({TRAVEL: np.clip(coarse, 0.0, None)}, coarse)).values()
    centre_s = 0.1 + 0.02 * np.arange(70)
    assert found == pytest.approx(centre_s)


def measure(peak: float, wave: Array | None = None) -> RunMeasure:
    return RunMeasure(
        peaks={"travel": peak}, waves={"travel": np.array([3.0, 4.0]) if wave is None else wave}
    )


def test_a_run_is_compared_with_the_median_of_those_before() -> None:
    records = {TRAVEL: np.where(np.isclose(T_S, 0.1), 1.0, 0.0)}
    before = [measure(0.5), measure(2.0), measure(8.0)]
    by_peak, *course = not_repeatable(seen(records), measure(1.0), before)
    assert (by_peak.value, by_peak.limit, by_peak.subject) == (0.5, 1 / 1.4, "travel")
    assert not by_peak.passed
    assert course == []  # all alike
    by_peak, _ = not_repeatable(seen(records), measure(2.5, np.array([4.0, -3.0])), before)
    assert (by_peak.value, by_peak.limit) == (1.25, 1.4)
    assert list(not_repeatable(seen(records), measure(1.0), [])) == []
    (by_peak,) = not_repeatable(seen(records), measure(2.0), before)
    assert (by_peak.passed, by_peak.value, by_peak.subject) == (True, 1.0, "")


@pytest.mark.parametrize(
    ("accepted", "unlike", "like"),
    [
        ([2.0], [], None),
        ([2.0], [1.0], (1, 1)),  # one of each: the accepted one may be the odd one
        ([2.0, 1.1], [1.0], (2, 1)),
        ([2.0, 2.1], [1.0], None),
        ([2.0, 2.1], [1.0, 1.1], (2, 2)),
        ([2.0], [0.1], None),
    ],
)
def test_a_first_run_that_is_odd_does_not_reject_all_others(
    accepted: list[float], unlike: list[float], like: tuple[int, int] | None
) -> None:
    """`like`: of all others those like this one, and of the accepted ones those unlike it."""
    records = {TRAVEL: np.where(np.isclose(T_S, 0.1), 1.0, 0.0)}
    before, doubted = ([measure(peak) for peak in peaks] for peaks in (accepted, unlike))
    found = list(not_repeatable(seen(records), measure(1.0), before, doubted))
    assert all(finding.passed for finding in found) is (like is not None)
    if like:
        assert (found[0].value, found[0].limit) == like


def test_a_course_at_right_angles_is_not_alike() -> None:
    records = {TRAVEL: np.where(np.isclose(T_S, 0.1), 1.0, 0.0)}
    _, course = not_repeatable(seen(records), measure(1.0, np.array([4.0, -3.0])), [measure(1.0)])
    assert course.value == pytest.approx(0.0)
    assert (course.limit, course.passed) == (0.85, False)
    still = measure(1.0, np.zeros(2))
    _, course = not_repeatable(seen(records), still, [measure(1.0)])
    assert (course.value, course.passed) == (0.0, False)
    unknown = RunMeasure(peaks={"travel": 1.0})
    for own, before in ((unknown, measure(1.0)), (measure(1.0, np.array([4.0, -3.0])), unknown)):
        assert len(list(not_repeatable(seen(records), own, [before]))) == 1


def test_judge_publishes_peaks_by_kind_wave_and_purity() -> None:
    def pulse(height: float) -> Array:
        return np.where(np.isclose(T_S, 0.1), height, 0.0)

    records = {
        HUB: pulse(40.0),
        BODY: pulse(-3.0),
        TURN: pulse(99.0),
        PITCH: pulse(77.0),
        TRAVEL: pulse(0.05) + ringing(1.3, 0.2, 0.03),
        HEIGHT: pulse(-0.08),
    }
    findings, found = judge(bench_of(*records), BOUNCE, window(records), [])
    assert found.peak_m_s2 == pytest.approx(40.0)
    assert found.peak_m == pytest.approx(0.08)
    assert found.frequency_hz == pytest.approx(1.3, rel=0.01)
    assert found.damping == pytest.approx(0.2, abs=0.012)
    assert (found.purity, dict(found.shares)) == (None, {})
    assert found.peaks["turn"] == 99.0
    assert set(found.waves) == {"body", "turn", "pitch", "travel", "height"}
    motion = findings[-1]
    assert (motion.code, motion.value, motion.unit) == ("motion", found.frequency_hz, "Hz")
    assert motion.text.startswith("peak 40.0 m/s2, 80 mm, f 1.30 Hz, zeta 0.2")


def test_judge_names_the_purity_of_the_kind_that_was_due() -> None:
    hop = np.where((T_S > 0.0) & (T_S < 0.5), 20.0 * np.sin(20 * np.pi * T_S), 0.0)
    hubs = {
        replace(HUB, name=corner.value, corner=corner): hop * (corner in FRONT) for corner in Corner
    }
    for kind, purity in (("pitch", 1.0), ("bounce", 0.5), ("roll", 0.25)):
        step = Step(BASELINE, Excitation(kind), 1)
        findings, found = judge(bench_of(*hubs), step, window(hubs), [])
        assert found.wheels == (frozenset(FRONT) if kind == "pitch" else None)
        assert found.purity == pytest.approx(purity, abs=1e-3)
        assert found.shares["pitch"] == pytest.approx(0.5, abs=1e-3)
        assert (found.peak_m, found.frequency_hz) == (None, None)
        assert findings[-1].text == f"peak 20.0 m/s2, {purity:.0%} pure"
        assert findings[-1].value == 0.0


def test_nothing_to_judge_is_one_finding() -> None:
    findings, found = judge(bench_of(TRAVEL), BOUNCE, window({TRAVEL: T_S[:5]}, T_S[:5]), [])
    assert [f.code for f in findings] == ["stale", "no_data"]
    assert (findings[-1].passed, findings[-1].value, findings[-1].limit) == (False, 0.0, 1.0)
    assert found == RunMeasure()


def level(post_s: float) -> float | None:
    """Return the motion left of a car that came to rest 0.05 m from where it stood."""
    value = np.where(np.isclose(T_S, 0.1), 1.0, 0.0) + np.where(T_S > 0.2, 0.05, 0.0)
    return peak_left((TRAVEL,), BUMP_NS, window({TRAVEL: value}).channels,
                     BUMP_NS + round(post_s * 1e9))  # fmt: skip


def test_a_new_rest_position_is_no_motion_two_seconds_after_the_bump() -> None:
    assert level(1.99) == pytest.approx(0.05 * np.sqrt(2.0), rel=0.01)
    assert level(2.01) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("post_s", [2.0, 2.4])
def test_the_motion_left_is_that_of_the_last_half_second(post_s: float) -> None:
    for before_s, left in ((0.49, 0.3), (0.51, 0.0)):
        late = post_s - before_s < T_S
        value = np.where(np.isclose(T_S, 0.1), 1.0, 0.0)
        swing = 0.3 * np.sin(2 * np.pi * 10.0 * (T_S - post_s)) * late
        records = {TRAVEL: value + (swing if left else 0.3 * np.sin(20 * np.pi * T_S) * ~late
                                    * (T_S > 0.5))}  # fmt: skip
        (finding,) = not_decayed(bench_of(TRAVEL, post_s=post_s), window(records), seen(records))
        assert finding.value == pytest.approx(left, abs=0.01)
        assert finding.passed is not bool(left)


def test_motion_below_ten_times_the_noise_is_not_judged() -> None:
    for size, known in ((9.9, False), (10.1, True)):
        value = noisy(np.where(np.isclose(T_S, 0.1), size, 0.0), 1.0)
        bench = bench_of(TRAVEL)
        assert (
            bool(list(not_decayed(bench, window({TRAVEL: value}), seen({TRAVEL: value})))) is known
        )


def test_the_rest_position_is_that_of_the_last_second() -> None:
    for from_s, moved_m in ((1.5, 0.02), (1.75, 0.015), (2.0, 0.01)):
        value = np.where(np.isclose(T_S, 0.1), 0.1, 0.0) + np.where(from_s <= T_S, 0.02, 0.0)
        records = {TRAVEL: value, OTHER: np.zeros_like(T_S)}
        (finding,) = rest_changed(bench_of(TRAVEL, OTHER), window(records), seen(records))
        assert finding.value == pytest.approx(moved_m, rel=0.01)
        assert finding.limit == pytest.approx(0.02)
        assert finding.subject in ("travel", "")
    assert list(rest_changed(bench_of(BODY), window({BODY: T_S}), seen({BODY: T_S}))) == []


@pytest.mark.parametrize(("stop_s", "judged"), [(0.64, False), (0.66, True)])
def test_a_second_strike_needs_time_after_the_first(stop_s: float, judged: bool) -> None:
    """The bump takes 0.2 s, the wheel lands 0.25 s after it, and two periods of 0.1 s follow."""
    burst = np.where((T_S > 0.0) & (T_S < 0.05), np.sin(2 * np.pi * 40 * T_S), 0.0)
    again = np.where((T_S > 0.52) & (T_S < 0.57), np.sin(2 * np.pi * 40 * T_S), 0.0)
    short = stop_s > T_S
    records = {HUB: (30.0 * (burst + again))[short]}
    found = traces((HUB,), window(records, T_S[short]))
    (finding,) = double_bump(bench_of(HUB), window(records, T_S[short]), found)
    assert finding.passed is not judged
    assert (finding.value > 0.25) is judged


def test_a_wheel_that_hardly_moved_is_not_searched_for_a_second_strike() -> None:
    def strikes(size: float, second: float) -> Array:
        first = np.where((T_S > 0.0) & (T_S < 0.1), np.sin(80 * np.pi * T_S), 0.0)
        again = np.where((T_S > 1.2) & (T_S < 1.3), np.sin(80 * np.pi * T_S), 0.0)
        return size * (first + second * again)

    other = replace(HUB, name="other", corner=Corner.REAR_LEFT)
    for size, passed in ((0.19, True), (0.21, False)):
        records = {HUB: strikes(30.0, 0.0), other: strikes(30.0 * size, 0.9)}
        (finding,) = double_bump(bench_of(*records), window(records), seen(records))
        assert finding.passed is passed


def test_the_silence_of_each_message_is_counted_to_the_ends_of_the_run() -> None:
    for keep, silent_s in ((T_S < 2.3, 0.2), (T_S > -0.7, 0.3), (T_S < 1.9, 0.6)):
        run = window({TRAVEL: T_S[keep]}, T_S[keep])
        (finding,) = stale(bench_of(TRAVEL), run, ())
        assert finding.value == pytest.approx(silent_s, abs=0.002)
        assert finding.limit == 0.25
        assert finding.passed is (silent_s < 0.25)


def test_a_message_is_as_silent_as_its_best_channel_but_a_mute_channel_is_named() -> None:
    twin = replace(TRAVEL, name="twin", signal="S.x")
    for share, passed in ((0.91, True), (0.89, False)):
        end_s = 2.5 - 3.5 * (1 - share)
        gap = np.where(end_s > T_S, T_S, np.nan)
        run = window({TRAVEL: T_S, twin: gap})
        (finding,) = stale(bench_of(TRAVEL, twin), run, ())
        assert finding.passed is passed
        if not passed:
            assert finding.subject == "twin"


def test_a_channel_without_a_signal_is_a_message_of_its_own() -> None:
    run = window({replace(TRAVEL, signal=""): T_S, OTHER: T_S})
    (finding,) = stale(bench_of(replace(TRAVEL, signal=""), OTHER), run, ())
    assert finding.text.startswith("all 2 messages came; longest silence 1 ms (")
    assert finding.text.endswith(("(travel)", "(S)"))
    (alone,) = stale(bench_of(replace(TRAVEL, signal="")), run, ())
    assert alone.text.endswith("(travel)")
