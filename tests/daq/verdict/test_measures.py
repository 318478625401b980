"""The measures of a run against closed forms: peaks, noise, the wave of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Step
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.vehicle import Corner
from daq.verdict import RunMeasure, RunWindow, judge
from daq.verdict.motion import body_wave
from daq.verdict.window import traces

from .closed_forms import (
    BODY,
    BUMP_NS,
    HEIGHT,
    HUB,
    OTHER,
    PITCH,
    T_S,
    TILT,
    TRAVEL,
    TURN,
    Array,
    bench_of,
    noisy,
    ringing,
    run_of,
    seen,
    window,
)

FRONT = (Corner.FRONT_LEFT, Corner.FRONT_RIGHT)
BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)


@pytest.mark.parametrize(
    ("frequency_hz", "damping"),
    [(1.05, 0.25), (1.6, 0.4), (0.45, 0.2), (4.6, 0.03)],
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


@pytest.mark.parametrize(("ratio", "shows"), [(4.9, False), (5.1, True)])
def test_a_wave_is_searched_for_from_five_times_the_noise_on(ratio: float, shows: bool) -> None:
    size = float(np.max(np.abs(ringing(1.0, 0.1))))
    records = {TRAVEL: noisy(ringing(1.0, 0.1), size / ratio)}
    assert (body_wave(seen(records), 0.2) is not None) is shows


@pytest.mark.parametrize(("stop_s", "shows"), [(1.39, False), (1.42, True)])
def test_a_wave_needs_a_second_after_the_bump(stop_s: float, shows: bool) -> None:
    """The wheels come to rest 0.2 s after the bump of 0.2 s."""
    short = stop_s > T_S
    found = seen({TRAVEL: ringing(1.5, 0.1)[short]}, T_S[short])
    assert (body_wave(found, 0.2) is not None) is shows


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


def test_judge_publishes_peaks_by_kind_wave_and_purity() -> None:
    def pulse(height: float) -> Array:
        return np.where(np.isclose(T_S, 0.1), height, 0.0)

    records = {
        HUB: pulse(40.0),
        BODY: pulse(-3.0),
        TILT: pulse(99.0),
        PITCH: pulse(77.0),
        TRAVEL: pulse(0.05) + ringing(1.3, 0.2, 0.03),
        HEIGHT: pulse(-0.08),
    }
    findings, found = judge(bench_of(*records), BOUNCE, run_of(records), [])
    assert found.peaks["tilt"] == 99.0
    assert set(found.waves) == {"body", "tilt", "pitch", "travel", "height"}
    motion = findings[-1]
    assert (motion.code, motion.unit) == ("motion", "Hz")
    assert motion.value == pytest.approx(1.3, rel=0.01)
    assert motion.text.startswith("peak 40.0 m/s2, 80 mm, f 1.30 Hz, zeta 0.2")


def test_judge_names_the_purity_of_the_kind_that_was_due() -> None:
    hop = np.where((T_S > 0.0) & (T_S < 0.5), 20.0 * np.sin(20 * np.pi * T_S), 0.0)
    hubs = {
        replace(HUB, name=corner.value, corner=corner): hop * (corner in FRONT) for corner in Corner
    }
    for kind, purity in (("pitch", 1.0), ("bounce", 0.5), ("roll", 0.25)):
        step = Step(BASELINE, Excitation(kind), 1)
        findings, found = judge(bench_of(*hubs), step, run_of(hubs), [])
        assert found.wheels == (frozenset(FRONT) if kind == "pitch" else None)
        assert findings[-1].text == f"peak 20.0 m/s2, {purity:.0%} pure"
        assert findings[-1].value == 0.0


def test_nothing_to_judge_is_one_finding() -> None:
    findings, found = judge(bench_of(TRAVEL), BOUNCE, run_of({TRAVEL: T_S[:5]}, T_S[:5]), [])
    assert [f.code for f in findings] == ["stale", "no_data"]
    assert (findings[-1].passed, findings[-1].value, findings[-1].limit) == (False, 0.0, 1.0)
    assert found == RunMeasure()


"""Rest, strikes, gaps and likeness where two rules meet, by records of closed form."""


def test_a_wave_ends_with_the_shortest_of_the_travels() -> None:
    whole, short = ringing(1.3, 0.2), ringing(1.3, 0.2)[T_S < 1.6]
    t_ns = BUMP_NS + np.rint(T_S * 1e9).astype(np.int64)
    block = {"travel": (t_ns, whole), "other": (t_ns[T_S < 1.6], short)}
    wave = body_wave(traces((TRAVEL, OTHER), RunWindow(BUMP_NS, block)), 0.2)
    assert wave is not None
    assert wave[0] == pytest.approx(1.3, rel=0.01)
    assert wave[1] == pytest.approx(0.2, abs=0.012)


def test_a_channel_that_ends_before_the_bump_has_no_peak_and_one_that_is_absent_no_trace() -> None:
    early: Array = T_S[T_S < -0.1]
    (trace,) = traces((TRAVEL, OTHER), window({TRAVEL: early}, early)[1])
    assert (trace.channel.name, trace.peak) == ("travel", 0.0)


def test_samples_of_one_time_keep_their_order() -> None:
    time_s = np.repeat(np.append(np.arange(100.0), -1.0), 20)
    (trace,) = seen({TRAVEL: np.arange(2020.0)}, time_s)
    assert list(np.diff(trace.value[20:])) == [1.0] * 1999
