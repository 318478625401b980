"""Rest, strikes, gaps and likeness where two rules meet, by records of closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import Losses
from daq.vehicle import Corner
from daq.verdict import RunMeasure, RunWindow, peak_left
from daq.verdict.motion import double_bump, not_at_rest, not_decayed, rest_changed, too_weak
from daq.verdict.repeats import not_repeatable, roughness
from daq.verdict.traffic import lost_frames, overload, stale
from daq.verdict.wave import body_wave
from daq.verdict.window import traces
from dbc.finding import Finding

from .closed_forms import BODY, BUMP_NS, HUB, T_S, TRAVEL, Array, found, one, pulse, window
from .test_limits import strikes, swing
from .test_measures import ringing, seen
from .test_motion_details import BEFORE, PITCH, TURNS
from .test_traffic_limits import without

OTHER = replace(TRAVEL, name="other", signal="SUSP.y", corner=Corner.FRONT_RIGHT)


def test_three_percent_of_the_peak_is_still_rest() -> None:
    time_s = T_S + 0.0005  # 970 samples of rest
    halves = np.where(T_S < -0.5155, -3.0, 3.0) * (time_s < -0.03)
    finding = one(not_at_rest, {TRAVEL: halves + pulse(100.0)}, time_s)
    assert (finding.passed, finding.value, finding.limit) == (True, 3.0, 3.0)


def test_the_channel_furthest_above_its_own_limit_is_named() -> None:
    """The body moves by 0.2 of 100, the nose by 0.01 of 0.1: over its limit of 0.003."""
    slow = np.sqrt(2.0) * np.sin(2 * np.pi * T_S / 0.97) * BEFORE
    finding = one(not_at_rest, {BODY: 0.2 * slow + pulse(100.0), PITCH: 0.01 * slow + pulse(0.1)})
    assert (finding.passed, finding.subject) == (False, "pitch")
    still = one(not_at_rest, {TRAVEL: np.zeros(len(T_S))})
    assert still.limit == pytest.approx(1e-9)


def test_the_hub_that_moved_most_is_compared_with_the_trigger() -> None:
    other = replace(HUB, name="other", corner=Corner.REAR_LEFT)
    for records in ({HUB: pulse(5.0), other: pulse(7.0)}, {other: pulse(7.0), HUB: pulse(5.0)}):
        (finding,) = found(too_weak, records)
        assert (finding.passed, finding.subject, finding.limit) == (True, "other", 6.0)
        assert finding.value == pytest.approx(7.0)


@pytest.mark.parametrize(("noise", "passed"), [(0.90, False), (0.98, True)])
def test_a_second_strike_rises_above_nine_times_the_noise(noise: float, passed: bool) -> None:
    """Three times the floor of three times the noise: the RMS is 12 / sqrt(2) = 8.49 m/s2."""
    value = strikes(0.4, 1.2) + noise * np.sqrt(2.0) * TURNS * BEFORE
    assert one(double_bump, {HUB: value}).passed is passed


@pytest.mark.parametrize(("second", "value"), [(0.055, 0.0), (0.065, 0.065)])
def test_less_than_six_percent_of_a_strike_is_none(second: float, value: float) -> None:
    finding = one(double_bump, {HUB: strikes(second, 1.2)})
    assert finding.passed
    assert finding.value == pytest.approx(value, rel=0.03)


def test_where_a_sensor_tilts_its_new_level_is_no_strike() -> None:
    """It reads 5 m/s2 more from the bump on, over 0.3 s."""
    tilt = 2.5 * (1.0 - np.cos(np.pi * np.clip(T_S / 0.3, 0.0, 1.0)))
    finding = one(double_bump, {HUB: strikes(0.5, 1.2) + tilt})
    assert finding.value == pytest.approx(0.5, rel=0.03)
    assert one(double_bump, {HUB: strikes(0.0, 1.2) + tilt}).passed


def test_without_hubs_the_body_is_searched_and_without_it_all_channels() -> None:
    once, twice = strikes(0.0, 1.2), strikes(0.5, 1.2)
    for records, subject in (
        ({HUB: once, BODY: twice, PITCH: twice}, ""),
        ({BODY: twice, PITCH: once}, "body"),
        ({BODY: once, PITCH: twice}, ""),
        ({PITCH: twice, TRAVEL: once}, "pitch"),
    ):
        finding = one(double_bump, records)
        assert (finding.passed, finding.subject) == (not subject, subject)


@pytest.mark.parametrize(("period_s", "passed"), [(0.05, True), (0.0625, False)])
def test_a_swing_is_told_from_a_strike_from_twenty_samples_a_second_on(
    period_s: float, passed: bool
) -> None:
    """The mean over 0.15 s that is taken away needs three samples."""
    time_s = np.arange(-1.0, 2.5, period_s)
    once = np.where(
        (time_s > 0.0) & (time_s < 0.15), np.where(np.arange(len(time_s)) % 2, 9, -9), 0
    )
    later = np.clip((time_s - 1.0) / 1.4, 0.0, 1.0)
    value = once + 4.0 * np.sin(np.pi * later) ** 2
    assert one(double_bump, {HUB: value}, time_s).passed is passed


def test_a_channel_that_ended_early_has_nothing_left_and_rests() -> None:
    """No sample in the last half second, nor in the last second."""
    early = T_S < 1.0
    (left,) = found(not_decayed, {TRAVEL: np.where(T_S > 0.0, 1.0, 0.0)[early]}, T_S[early])
    assert (left.passed, left.value) == (True, 0.0)
    rest = one(rest_changed, {TRAVEL: np.where(T_S > 0.5, 1.0, 0.0)[early]}, T_S[early])
    assert (rest.passed, rest.value) == (True, 0.0)


def test_motion_without_noise_counts_in_thousandths_of_the_peak_of_its_kind() -> None:
    """A tenth is left of a travel of 50 mm, a fifth of a body that moved by 20 m/s2."""
    finding = one(not_decayed, {TRAVEL: 0.05 * swing(0.1), BODY: 20.0 * swing(0.2)})
    assert finding.value == pytest.approx(np.sqrt((0.1**2 + 0.2**2) / 2.0), rel=0.02)
    # A second travel that moved by a tenth counts by the larger one.
    finding = one(not_decayed, {TRAVEL: 0.05 * swing(0.1), OTHER: 0.005 * swing(0.9)})
    assert finding.value == pytest.approx(np.hypot(0.1, 0.09) / np.hypot(1.0, 0.1), rel=0.02)


def test_at_two_seconds_the_car_still_counts_from_where_it_stood() -> None:
    stands = pulse(1.0) + np.where(T_S > 0.5, 0.2, 0.0)
    past = T_S < 2.0
    t_ns = BUMP_NS + np.rint(T_S * 1e9).astype(np.int64)
    block = {"travel": (t_ns[past], stands[past])}
    left = peak_left((TRAVEL,), BUMP_NS, block, BUMP_NS + 2_000_000_000)
    assert left == pytest.approx(0.2 * np.sqrt(2.0), rel=1e-3)


def test_a_bench_without_channels_has_no_silence() -> None:
    assert found(stale, {}) == []


def test_a_quarter_of_a_second_is_no_silence_yet() -> None:
    time_s = without(T_S, 1.0, 0.25)
    finding = one(stale, {TRAVEL: np.sin(time_s)}, time_s)
    assert (finding.passed, finding.value) == (True, 0.25)


def test_a_message_that_is_known_to_be_silent_is_so_for_as_long_as_its_samples_say() -> None:
    time_s = without(T_S, 1.0, 0.75)
    bench, run = window({TRAVEL: np.sin(time_s)}, time_s)
    (finding,) = stale(bench, replace(run, stale=("SUSP",)), ())
    assert finding.value == pytest.approx(0.75)
    assert finding.text.startswith("SUSP was silent for 0.75 s (limit 0.25 s)")


def test_silence_is_weighed_by_the_limit_of_its_message() -> None:
    """0.3 s of a message every 1 ms is more than 0.8 s of one every 0.1 s."""
    _, run = window({TRAVEL: T_S})
    slow = np.setdiff1d(np.arange(-10, 26), np.arange(11, 18)) / 10.0
    quick = without(T_S, 1.0, 0.3)
    bench, _ = window({HUB: slow, TRAVEL: quick})
    columns = {
        c.name: (BUMP_NS + np.rint(time_s * 1e9).astype(np.int64), np.sin(time_s))
        for c, time_s in ((HUB, slow), (TRAVEL, quick))
    }
    (finding,) = stale(bench, replace(run, channels=columns), ())
    assert (finding.passed, finding.subject) == (False, "SUSP")
    assert finding.value == pytest.approx(0.3)


@pytest.mark.parametrize(("times", "limit_s"), [((-1.0, 2.5), 0.25), ((-1.0, 0.75, 2.5), 17.5)])
def test_a_cycle_needs_three_samples(times: tuple[float, ...], limit_s: float) -> None:
    time_s = np.array(times)
    assert one(stale, {TRAVEL: time_s}, time_s).limit == pytest.approx(limit_s)


def test_nine_tenths_of_the_samples_of_its_message_are_enough() -> None:
    """Samples 1 to 10 of a message; the twin lacks one of them at the end, or two."""
    time_s = np.linspace(-1.0, 2.5, 10)
    for lacks, came in ((1, "the one message came"), (2, "all 2 messages came")):
        bench, run = window({TRAVEL: time_s, OTHER: np.append(time_s[:-lacks], [np.nan] * lacks)},
                            time_s)  # fmt: skip
        (finding,) = stale(bench, run, ())
        assert finding.text.startswith(came)


def test_unused_channels_are_silent_unasked() -> None:
    unused = Channel("unused", Quantity.UNUSED, "m", "OFF.u")
    bench, run = window({TRAVEL: T_S, unused: np.full(len(T_S), np.nan)})
    (finding,) = stale(bench, run, ())
    assert finding.text.startswith("the one message came")


@pytest.mark.parametrize(
    ("lost", "came", "share", "passed"),
    [(0, 0, 0.0, True), (1, 0, 1.0, False), (20, 980, 0.02, True), (21, 980, 21 / 1001, False)],
)
def test_lost_frames_are_a_share_of_all(lost: int, came: int, share: float, passed: bool) -> None:
    bench, run = window({TRAVEL: T_S[:came]}, T_S[:came])
    run = replace(run, losses=Losses(counter_gaps=lost))
    (finding,) = lost_frames(bench, run, ())
    assert finding.passed is passed
    assert finding.value == pytest.approx(share)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "passed"),
    [(-0.0505, -0.0005, True), (-0.0495, 0.0005, False), (0.1505, 0.2005, False),
     (0.1995, 0.2495, False), (0.2005, 0.2505, True)],
)  # fmt: skip
def test_a_gap_counts_if_a_part_of_it_is_while_the_wheels_move(
    start_s: float, stop_s: float, passed: bool
) -> None:
    time_s = without(T_S + 0.0005, start_s, stop_s - start_s)
    assert one(lost_frames, {TRAVEL: np.sin(time_s)}, time_s).passed is passed


def test_what_ends_before_the_bump_has_no_gap_in_it() -> None:
    time_s = T_S[T_S < -0.1]
    assert one(lost_frames, {TRAVEL: np.sin(time_s)}, time_s).passed


def test_at_two_percent_lost_a_gap_is_named() -> None:
    time_s = np.sort(np.append(without(np.arange(-490.0, 510.0) / 1000.0, 0.05, 0.021), 0.6))
    assert len(time_s) == 981
    for lost, unit in ((20, "s"), (21, "")):
        bench, run = window({TRAVEL: np.sin(time_s)}, time_s)
        run = replace(run, losses=Losses(counter_gaps=lost))
        (finding,) = lost_frames(bench, run, traces(bench.channels, run))
        assert (finding.passed, finding.unit) == (False, unit)


@pytest.mark.parametrize(("lost", "passed"), [(0, True), (4, False)])
def test_frames_that_a_reader_delivers_late_fill_the_gap_before_them(
    lost: int, passed: bool
) -> None:
    """Frames every 10 ms; those of 0.05 s to 0.10 s come together at 0.10 s."""
    sent_s = np.arange(-100.0, 250.0) / 100.0
    late = (sent_s > 0.045) & (sent_s < 0.105)
    came_s = np.where(late, 0.10, sent_s)
    kept = ~late | (np.cumsum(late) > lost)
    bench, run = window({TRAVEL: np.sin(sent_s[kept])}, came_s[kept])
    signals = traces(bench.channels, run)
    (finding,) = lost_frames(bench, replace(run, timed=frozenset({"SUSP"})), signals)
    assert finding.passed is passed
    (untimed,) = lost_frames(bench, run, signals)
    assert not untimed.passed


def test_tops_are_counted_in_samples_and_those_on_the_bump_are_reported() -> None:
    noise = np.random.default_rng(3).standard_normal(len(T_S))
    late = np.where((T_S > 0.2495) & (T_S < 0.2695), 50.0, noise)
    finding = one(overload, {HUB: late})
    assert (finding.value, finding.limit, finding.subject) == (20.0, 0.0, "hub")
    assert "at +0.27 s" in finding.text
    early = one(overload, {HUB: np.where((T_S > 0.0995) & (T_S < 0.1195), 50.0, noise)})
    assert (early.passed, early.value, early.limit) == (True, 0.0, 0.0)
    assert early.text.startswith("hub: at the end of the range on the bump only")
    before = one(overload, {HUB: np.where((T_S > -0.5005) & (T_S < -0.4805), 50.0, noise)})
    none = one(overload, {HUB: noise})
    assert before.text == none.text == "no sensor at the end of its range"


def compared(peaks: dict[str, float], before: dict[str, float]) -> Finding:
    records = {TRAVEL: pulse(peaks["travel"]), OTHER: pulse(peaks["other"])}
    finding, *_ = not_repeatable(seen(records), RunMeasure(peaks=peaks), [RunMeasure(peaks=before)])
    return finding


@pytest.mark.parametrize(
    ("travel", "other", "subject", "limit", "passed"),
    [(0.5, 1.9, "travel", 1 / 1.4, False), (0.6, 1.5, "travel", 1 / 1.4, False),
     (0.7, 1.5, "other", 1.4, False), (0.8, 1.2, "travel", 1 / 1.4, True),
     (0.9, 1.2, "other", 1.4, True), (1.0, 1.4, "other", 1.4, True)],
)  # fmt: skip
def test_half_and_twice_the_size_are_equally_far_from_equal(
    travel: float, other: float, subject: str, limit: float, passed: bool
) -> None:
    finding = compared({"travel": travel, "other": other}, {"travel": 1.0, "other": 1.0})
    assert (finding.passed, finding.subject) == (passed, subject)
    assert finding.limit == pytest.approx(limit)


def test_the_limits_of_the_ratio_of_peaks_are_within() -> None:
    for own, usual in ((1.4, 1.0), (1.0, 1.4)):
        finding = compared({"travel": own, "other": usual}, {"travel": usual, "other": usual})
        assert (finding.passed, finding.subject) == (True, "travel")


def test_a_channel_that_stands_still_in_one_run_alone_differs_without_bounds() -> None:
    dead = compared({"travel": 0.0, "other": 1.0}, {"travel": 1.0, "other": 1.0})
    alive = compared({"travel": 1.0, "other": 1.0}, {"travel": 0.0, "other": 1.0})
    assert (dead.passed, alive.passed) == (False, False)
    assert (dead.value, alive.value) == pytest.approx((1e-12, 1e12))


def test_a_course_is_like_another_from_85_percent_on() -> None:
    """17^2 + 10^2 + 3^2 + 1 + 1 = 20^2."""
    seen_ = seen({TRAVEL: pulse(1.0)})
    usual = RunMeasure(peaks={"travel": 1.0}, waves={"travel": np.array([1.0, 0, 0, 0, 0])})
    own = replace(usual, waves={"travel": np.array([17.0, 10.0, 3.0, 1.0, 1.0])})
    _, course = not_repeatable(seen_, own, [usual])
    assert (course.passed, course.value, course.subject) == (True, 0.85, "travel")


def test_the_least_alike_channel_is_named() -> None:
    signals = seen({TRAVEL: pulse(1.0), OTHER: pulse(1.0)})
    peaks = {"travel": 1.0, "other": 1.0}
    one_way, oblique = np.array([1.0, 0.0]), np.array([3.0, 4.0])
    usual = RunMeasure(peaks=peaks, waves={"travel": one_way, "other": one_way})
    own = replace(usual, waves={"travel": oblique[::-1], "other": oblique})
    _, course = not_repeatable(signals, own, [usual])
    assert course.subject == "other"
    assert course.value == pytest.approx(0.6)


def test_a_run_is_one_of_those_that_it_repeats() -> None:
    """Of three accepted ones it repeats one, and one that was doubted: two against two."""
    before, doubted = ([RunMeasure(peaks={"travel": p}) for p in of] for of in ((2, 2.1, 1.1), [1]))
    signals = seen({TRAVEL: pulse(1.0)})
    (finding,) = not_repeatable(signals, RunMeasure(peaks={"travel": 1.0}), before, doubted)
    assert (finding.passed, finding.value, finding.limit) == (True, 2.0, 2.0)
    assert finding.text.startswith("like 2 of 4 runs")


def test_a_run_that_repeats_the_accepted_ones_is_not_compared_with_doubted_ones() -> None:
    usual, doubted = RunMeasure(peaks={"travel": 1.0}), RunMeasure(peaks={"travel": 2.0})
    (finding,) = not_repeatable(seen({TRAVEL: pulse(1.2)}), replace(usual, peaks={"travel": 1.2}),
                                [usual], [doubted])  # fmt: skip
    assert (finding.passed, finding.value, finding.subject) == (True, 1.2, "travel")


def test_a_record_too_short_for_roughness_has_none() -> None:
    time_s = np.array([-0.5, -0.4, -0.3, 0.02, 0.1, 0.2, 0.3, 0.5, 0.7])
    assert dict(roughness(seen({BODY: time_s}, time_s))) == {}  # four samples within
    time_s = np.sort(np.append(time_s, 0.4))
    value = np.where(time_s == 0.3, 1.0, 0.0)
    # The fourth difference of one sample in the middle is 6.
    assert roughness(seen({BODY: value}, time_s))["body"] == pytest.approx(6 / np.sqrt(70.0))


def test_a_wave_goes_straight_on_where_samples_are_missing() -> None:
    """A car that came to rest 5 away from where it stood; twice 50 ms are missing."""
    value = ringing(1.3, 0.2) + np.where(T_S > 0.0, 5.0, 0.0)
    gaps = ((T_S > 0.5) & (T_S < 0.55)) | ((T_S > 0.9) & (T_S < 0.95))
    wave = body_wave(seen({TRAVEL: value[~gaps]}, T_S[~gaps]), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(1.3, rel=0.01)
    assert wave[1] == pytest.approx(0.2, abs=0.012)


def test_a_wave_ends_with_the_shortest_of_the_travels() -> None:
    whole, short = ringing(1.3, 0.2), ringing(1.3, 0.2)[T_S < 1.6]
    t_ns = BUMP_NS + np.rint(T_S * 1e9).astype(np.int64)
    block = {"travel": (t_ns, whole), "other": (t_ns[T_S < 1.6], short)}
    wave = body_wave(traces((TRAVEL, OTHER), RunWindow(BUMP_NS, block)), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(1.3, rel=0.01)
    assert wave[1] == pytest.approx(0.2, abs=0.012)


@pytest.mark.parametrize(
    ("rest", "noise"), [((0.0,), 0.0), ((0.0, 6.0), 0.0), ((0.0, 6.0, 0.0), 6.0 / np.sqrt(2.0))]
)
def test_noise_is_known_from_three_samples_of_rest_on(
    rest: tuple[float, ...], noise: float
) -> None:
    time_s = np.append(np.linspace(-0.5, -0.4, len(rest)), np.linspace(0.1, 1.0, 9))
    (trace,) = seen({TRAVEL: np.append(rest, np.zeros(9))}, time_s)
    assert trace.noise == pytest.approx(noise)


def test_a_channel_that_ends_before_the_bump_has_no_peak_and_one_that_is_absent_no_trace() -> None:
    early: Array = T_S[T_S < -0.1]
    (trace,) = traces((TRAVEL, OTHER), window({TRAVEL: early}, early)[1])
    assert (trace.channel.name, trace.peak) == ("travel", 0.0)


def test_samples_of_one_time_keep_their_order() -> None:
    time_s = np.repeat(np.append(np.arange(100.0), -1.0), 20)
    (trace,) = seen({TRAVEL: np.arange(2020.0)}, time_s)
    assert list(np.diff(trace.value[20:])) == [1.0] * 1999
