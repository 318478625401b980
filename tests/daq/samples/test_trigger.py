"""The trigger, and its limits."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import TriggerConfig
from daq.channels import Channel, Quantity, paper_channels
from daq.runs import Event
from daq.samples.mapping import trigger_channels
from daq.samples.trigger import TriggerPhase, TriggerState, advance, not_at_rest, pre_trigger_full

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


@pytest.mark.parametrize("block_s", [0.03, 60.0])
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


def test_hubs_trigger_and_without_them_the_body() -> None:
    hubs = [channel.name for channel in trigger_channels(paper_channels())]
    assert hubs == ["z_uA", "z_uB", "z_uC", "z_uD"]
    body = Channel("b", Quantity.BODY_ACCELERATION, "m/s2")
    assert trigger_channels((body, Channel("p", Quantity.PITCH_RATE, "rad/s"))) == (body,)
    assert trigger_channels(()) == ()


# The limits of the trigger from both sides, on samples of one hub 10 ms apart ---------------------

S, STEP_NS = 1_000_000_000, 10_000_000
BEGIN_NS = 1_800_000_000 * S
LIMITS = TriggerConfig(level=3.0, pre_s=0.1, post_s=0.5, rest_s=0.1)
Array = NDArray[np.float64]


def times(n: int) -> NDArray[np.int64]:
    return np.asarray(BEGIN_NS + np.arange(n) * STEP_NS, np.int64)


def hub(values: dict[int, float], n: int = 200) -> Array:
    """Return a level at rest, and other values at some places."""
    samples = np.full(n, GRAVITY)
    samples[list(values)] += list(values.values())
    return samples


def events(value: Array) -> tuple[TriggerState, tuple[Event, ...]]:
    return advance(LIMITS, TriggerState(), {"hub": (times(len(value)), value)})


@pytest.mark.parametrize(
    ("values", "size"),
    [
        ({100: 3.1, 101: 4.5}, 4.5),
        ({100: -3.1, 101: -4.5}, -4.5),
        ({100: 2.99, 101: 2.99}, None),
        ({100: 3.1}, None),  # one sample is a spike
        ({100: 3.1, 101: -3.1}, None),
        ({100: 3.1, 102: 3.1}, None),
        ({100: 5.0, 101: 3.1, 102: 9.0}, 3.1),
    ],
)
def test_a_bump_is_two_samples_beyond_the_level_on_one_side(
    values: dict[int, float], size: float | None
) -> None:
    _, found = events(hub(values))
    bumps = [event for event in found if event.code == "bump"]
    assert len(bumps) == (size is not None)
    if size is not None:
        assert bumps[0].t_ns == BEGIN_NS + 100 * STEP_NS  # the first of the two
        assert bumps[0].value == pytest.approx(size)
        assert bumps[0].text == "hub"


@pytest.mark.parametrize(("n", "ended"), [(150, False), (151, True)])
def test_a_run_ends_half_a_second_after_its_bump(n: int, ended: bool) -> None:
    state, found = events(hub({100: 5.0, 101: 5.0}, n))
    assert [event.code for event in found] == ["bump"] + ["run_end"] * ended
    assert state.phase is (TriggerPhase.WAITING if ended else TriggerPhase.RUNNING)
    if ended:
        assert found[1].t_ns == BEGIN_NS + 150 * STEP_NS


@pytest.mark.parametrize(("back_ms", "step"), [(1000, False), (1010, True)])
def test_stamps_that_fall_back_by_more_than_a_second_are_a_clock_that_was_set(
    back_ms: int, step: bool
) -> None:
    state, _ = events(hub({}, 200))
    latest = BEGIN_NS + 199 * STEP_NS - back_ms * 1_000_000
    block = {"hub": (np.array([latest - STEP_NS, latest]), np.array([9.81, 9.81]))}
    after, found = advance(LIMITS, state, block)
    assert [(event.code, event.t_ns) for event in found] == [("clock_step", latest)] * step
    if step:
        assert found[0].value == pytest.approx(-back_ms / 1000)
        assert (after.phase, after.now_ns) == (TriggerPhase.WAITING, latest)
    else:
        assert after.phase is TriggerPhase.ARMED


@pytest.mark.parametrize(("n", "armed"), [(10, False), (11, True)])
def test_a_bench_is_armed_and_its_pre_trigger_full_after_a_tenth_of_a_second_of_rest(
    n: int, armed: bool
) -> None:
    state, _ = events(hub({}, n))
    assert state.phase is (TriggerPhase.ARMED if armed else TriggerPhase.WAITING)
    assert pre_trigger_full(LIMITS, state, BEGIN_NS) is armed
    assert not pre_trigger_full(LIMITS, state, BEGIN_NS + 1)


@pytest.mark.parametrize(("n", "named"), [(29, True), (30, False)])
def test_a_channel_keeps_a_bench_from_being_armed_for_a_tenth_of_a_second(
    n: int, named: bool
) -> None:
    """It swings from the fifth sample to the twentieth, two to a side; another one rests."""
    value = hub({k: 5.0 if k % 4 < 2 else -5.0 for k in range(4, 20)}, n)
    block = {"moved": (times(n), value), "still": (times(n), hub({}, n))}
    state, _ = advance(LIMITS, TriggerState(), block)
    assert not_at_rest(LIMITS, state) == (("moved",) if named else ())
