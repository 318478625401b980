from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.bench_tables import TriggerConfig
from daq.channels import Channel, Quantity, paper_channels
from daq.runs import Event
from daq.samples.trigger import (
    TriggerPhase,
    TriggerState,
    advance,
    not_at_rest,
    pre_trigger_full,
    trigger_channels,
)

CONFIG = TriggerConfig(level=3.0, pre_s=0.5, post_s=1.0, rest_s=0.2)
START_NS = 1_700_000_000_123_456_789
GRAVITY = 9.81
Record = Mapping[str, tuple[NDArray[np.int64], NDArray[np.float64]]]


def _channel(
    end_s: float, bumps_s: tuple[float, ...] = (), rate_hz: float = 1000.0, seed: int = 0
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Gravity and noise; from each bump on, a wheel that hops and comes to rest in 0.6 s."""
    t_s = np.arange(round(end_s * rate_hz)) / rate_hz
    value = GRAVITY + 0.3 * np.random.default_rng(seed).standard_normal(len(t_s))
    for bump_s in bumps_s:
        since = t_s - bump_s
        swing = 40 * np.exp(-since / 0.12) * np.cos(2 * np.pi * 10 * since)
        value += np.where(since >= 0, swing, 0.0)
    return START_NS + np.rint(t_s * 1e9).astype(np.int64), value


def _run(record: Record, block_s: float = 0.1) -> tuple[Event, ...]:
    state = TriggerState()
    events: list[Event] = []
    first = min(int(t[0]) for t, _ in record.values())
    last = max(int(t[-1]) for t, _ in record.values())
    edges = np.arange(first, last + round(block_s * 1e9) + 1, round(block_s * 1e9))
    for low, high in pairwise(edges.tolist()):
        parts = {n: (t, v, (t >= low) & (t < high)) for n, (t, v) in record.items()}
        block = {name: (t[m], v[m]) for name, (t, v, m) in parts.items()}
        state, found = advance(CONFIG, state, block)
        events += found
    return tuple(events)


def _seconds(events: tuple[Event, ...]) -> list[tuple[str, float]]:
    return [(event.code, round((event.t_ns - START_NS) * 1e-9, 4)) for event in events]


@pytest.mark.parametrize("block_s", [0.003, 0.1, 60.0])
def test_bumps_are_found_at_their_onset_whatever_the_blocks(block_s: float) -> None:
    record = {
        "fl": _channel(8.0, (1.5, 5.0), seed=1),
        "fr": _channel(8.0, (1.5113, 5.0), rate_hz=730.0, seed=2),
    }
    events = _run(record, block_s)
    assert _seconds(events) == [
        ("bump", 1.5),
        ("run_end", 2.5),
        ("bump", 5.0),
        ("run_end", 6.0),
    ]
    assert events[0].text == "fl"


def test_the_fold_leaves_its_state_as_it_was() -> None:
    t_ns, value = _channel(2.0, (1.5,))
    early = {"a": (t_ns[:1000], value[:1000])}
    late = {"a": (t_ns[1000:], value[1000:])}
    state, _ = advance(CONFIG, TriggerState(), early)
    assert advance(CONFIG, state, late) == advance(CONFIG, state, late)


def test_what_moves_during_a_run_starts_no_other() -> None:
    # The second bump comes within the run, the third while the wheel still moves after it.
    events = _run({"a": _channel(6.0, (1.5, 2.2, 2.55))})
    assert _seconds(events) == [("bump", 1.5), ("run_end", 2.5)]


def test_no_bump_before_the_level_of_rest_is_known() -> None:
    assert _run({"a": _channel(3.0, (0.1,))}) == ()


def test_noise_and_spikes_are_no_bump() -> None:
    t_ns, value = _channel(20.0)
    value[5000::97] += 30.0
    value[5048::97] -= 30.0
    assert _run({"a": (t_ns, value)}) == ()


def test_slow_drift_is_followed() -> None:
    t_ns, value = _channel(30.0, (25.0,))
    drift = 3.0 * (t_ns - START_NS) * 1e-9  # 75 m/s2 until the bump, 25 times the level
    events = _run({"a": (t_ns, value + drift)})
    assert _seconds(events) == [("bump", 25.0), ("run_end", 26.0)]


def test_a_channel_that_rests_elsewhere_after_a_run_is_armed_again() -> None:
    t_ns, value = _channel(8.0, (1.5, 6.0))
    value += np.where(t_ns > START_NS + 2_000_000_000, 5.0, 0.0)
    assert [at for _, at in _seconds(_run({"a": (t_ns, value)}))] == [1.5, 2.5, 6.0, 7.0]


@pytest.mark.parametrize("fault", ["stuck", "silent", "nan"])
def test_a_dead_channel_does_not_keep_the_bench_from_being_armed(fault: str) -> None:
    record = {"good": _channel(8.0, (1.5, 5.0)), "bad": _channel(8.0, (1.5,))}
    t_ns, value = record["bad"]
    dead = t_ns > START_NS + 1_600_000_000
    if fault == "silent":
        record["bad"] = (t_ns[~dead], value[~dead])
    else:
        record["bad"] = (t_ns, np.where(dead, np.nan if fault == "nan" else 300.0, value))
    assert [at for _, at in _seconds(_run(record))] == [1.5, 2.5, 5.0, 6.0]


def test_a_restless_channel_is_named_and_left_out_until_it_rests() -> None:
    t_ns, value = _channel(40.0, (1.5, 20.0, 36.0))
    loose = np.where(t_ns < START_NS + 30_000_000_000, 50.0, 0.0)
    loose = loose * np.sin(2 * np.pi * 5.0 * (t_ns - START_NS) * 1e-9)
    events = _run({"good": (t_ns, value), "loose": (t_ns, GRAVITY + loose)})
    restless = [event for event in events if event.code == "trigger_restless"]
    assert [event.text for event in restless] == ["loose"]
    # Until the bench gives the channel up after 10 s, it waits for rest, as it must.
    bumps = [(code, at) for code, at in _seconds(events) if code != "trigger_restless"]
    assert bumps == [("bump", 20.0), ("run_end", 21.0), ("bump", 36.0), ("run_end", 37.0)]


def test_a_clock_that_is_set_back_starts_over_and_is_reported() -> None:
    t_ns, value = _channel(8.0, (6.0,))
    jumped = np.where(t_ns < START_NS + 3_000_000_000, t_ns, t_ns - 3_600_000_000_000)
    state = TriggerState()
    events: list[Event] = []
    for i in range(0, len(t_ns), 100):
        block = {"a": (jumped[i : i + 100], value[i : i + 100])}
        state, found = advance(CONFIG, state, block)
        events += found
    assert [event.code for event in events] == ["clock_step", "bump", "run_end"]
    assert events[1].t_ns == START_NS + 6_000_000_000 - 3_600_000_000_000


def test_hubs_trigger_and_without_them_the_body() -> None:
    hubs = [channel.name for channel in trigger_channels(paper_channels())]
    assert hubs == ["z_uA", "z_uB", "z_uC", "z_uD"]
    body = Channel("b", Quantity.BODY_ACCELERATION, "m/s2")
    assert trigger_channels((body, Channel("p", Quantity.PITCH_RATE, "rad/s"))) == (body,)
    assert trigger_channels(()) == ()


def test_the_channels_that_are_not_at_rest_are_named() -> None:
    # One hub swings up to 1.9 s, the other rests.
    moving = _channel(1.6, tuple(np.arange(0.1, 1.5, 0.1)))
    resting = _channel(1.6, seed=1)
    state, _ = advance(CONFIG, TriggerState(), {"moving": moving, "resting": resting})
    assert not_at_rest(CONFIG, state) == ("moving",)
    assert pre_trigger_full(CONFIG, state, START_NS)
    assert not pre_trigger_full(CONFIG, state, START_NS + 1_200_000_000)
    state, _ = advance(CONFIG, TriggerState(), {"resting": _channel(1.6)})
    assert state.phase is TriggerPhase.ARMED
    assert not_at_rest(CONFIG, state) == ()


@pytest.mark.parametrize(
    ("samples", "bumps"),
    [
        ([5.0], 0),
        ([5.0, 0.0, 5.0], 0),
        ([5.0, -5.0, 5.0, -5.0], 0),
        ([5.0, 5.0], 1),
        ([-5.0, -5.0], 1),
        ([2.9, 2.9], 0),
        ([3.1, 3.1], 1),
    ],
)
def test_a_bump_is_two_samples_in_a_row_on_the_same_side(samples: list[float], bumps: int) -> None:
    """The level is 3 m/s2: one sample away from rest is a spike, and so is each of a ripple."""
    t_s = np.arange(4000) / 1000.0
    value = np.full(len(t_s), GRAVITY)
    value[2000 : 2000 + len(samples)] += samples
    record = {"fl": (START_NS + np.rint(t_s * 1e9).astype(np.int64), value)}
    assert sum(event.code == "bump" for event in _run(record)) == bumps
