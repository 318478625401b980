"""The limits of the trigger from both sides, on samples of one hub 10 ms apart."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.bench_tables import TriggerConfig
from daq.runs import Event
from daq.samples.trigger import (
    TriggerPhase,
    TriggerState,
    advance,
    not_at_rest,
    pre_trigger_full,
)

S, STEP_NS = 1_000_000_000, 10_000_000
BEGIN_NS = 1_800_000_000 * S
CONFIG = TriggerConfig(level=3.0, pre_s=0.1, post_s=0.5, rest_s=0.1)
Array = NDArray[np.float64]


def times(n: int, start: int = 0) -> NDArray[np.int64]:
    return np.asarray(BEGIN_NS + (start + np.arange(n)) * STEP_NS, np.int64)


def hub(values: dict[int, float], n: int = 200, rest: float = 9.81) -> Array:
    """Return a level at rest, and other values at some places."""
    found = np.full(n, rest)
    for place, value in values.items():
        found[place] = rest + value
    return found


def events(value: Array, state: TriggerState | None = None) -> tuple[TriggerState, list[Event]]:
    state, found = advance(CONFIG, state or TriggerState(), {"hub": (times(len(value)), value)})
    return state, list(found)


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


@pytest.mark.parametrize(("gap", "bumps"), [(59, 1), (60, 2)])
def test_the_next_run_waits_for_its_rest(gap: int, bumps: int) -> None:
    """Half a second of run, then a whole tenth of rest."""
    value = hub({100: 5.0, 101: 5.0, 100 + gap: 5.0, 101 + gap: 5.0}, 300)
    _, found = events(value)
    assert [event.code for event in found].count("bump") == bumps


@pytest.mark.parametrize(("back_ms", "step"), [(1000, False), (1010, True)])
def test_stamps_that_fall_back_by_more_than_a_second_are_a_clock_that_was_set(
    back_ms: int, step: bool
) -> None:
    state, _ = events(hub({}, 200))
    latest = BEGIN_NS + 199 * STEP_NS - back_ms * 1_000_000
    block = {"hub": (np.array([latest - STEP_NS, latest]), np.array([9.81, 9.81]))}
    after, found = advance(CONFIG, state, block)
    assert [(event.code, event.t_ns) for event in found] == [("clock_step", latest)] * step
    if step:
        assert found[0].value == pytest.approx(-back_ms / 1000)
        assert (after.phase, after.now_ns) == (TriggerPhase.WAITING, latest)
    else:
        assert after.phase is TriggerPhase.ARMED


@pytest.mark.parametrize(("n", "given_up"), [(1000, False), (1020, True)])
def test_a_channel_that_does_not_rest_for_ten_seconds_is_left_out(n: int, given_up: bool) -> None:
    restless = hub({}, n) + np.where(np.arange(n) % 4 < 2, 5.0, -5.0)
    block = {"hub": (times(n), hub({}, n)), "other": (times(n), restless)}
    state, found = advance(CONFIG, TriggerState(), block)
    assert [(event.code, event.text) for event in found] == [
        ("trigger_restless", "other")
    ] * given_up
    assert state.phase is (TriggerPhase.ARMED if given_up else TriggerPhase.WAITING)
    assert not_at_rest(CONFIG, state) == (() if given_up else ("other",))


def test_a_bench_where_nothing_rests_is_never_armed() -> None:
    n = 1500
    restless = hub({}, n) + np.where(np.arange(n) % 4 < 2, 5.0, -5.0)
    state, found = events(restless)
    assert found == []
    assert state.phase is TriggerPhase.WAITING
    assert not_at_rest(CONFIG, state) == ("hub",)


@pytest.mark.parametrize(("n", "armed"), [(10, False), (11, True)])
def test_a_bench_is_armed_after_a_tenth_of_a_second_of_rest(n: int, armed: bool) -> None:
    state, _ = events(hub({}, n))
    assert state.phase is (TriggerPhase.ARMED if armed else TriggerPhase.WAITING)


def test_the_pre_trigger_is_full_after_a_tenth_of_a_second() -> None:
    state, _ = events(hub({}, 11))
    assert pre_trigger_full(CONFIG, state, BEGIN_NS)
    assert not pre_trigger_full(CONFIG, state, BEGIN_NS + 1)


def test_blocks_without_a_number_change_nothing() -> None:
    state, _ = events(hub({}, 50))
    nothing = {"hub": (times(3, 50), np.full(3, np.nan)), "x": (times(0), np.zeros(0))}
    assert advance(CONFIG, state, nothing) == (state, ())
    assert advance(CONFIG, state, {}) == (state, ())


def test_the_earliest_of_two_hubs_is_the_bump() -> None:
    block = {
        "a": (times(200), hub({103: 9.0, 104: 9.0})),
        "b": (times(200), hub({101: 4.0, 102: 4.0})),
    }
    _, found = advance(CONFIG, TriggerState(), block)
    assert (found[0].code, found[0].text) == ("bump", "b")
    assert found[0].t_ns == BEGIN_NS + 101 * STEP_NS


@pytest.mark.parametrize(("n", "named"), [(29, True), (30, False)])
def test_a_channel_keeps_a_bench_from_being_armed_for_a_tenth_of_a_second(
    n: int, named: bool
) -> None:
    """It swings from the fifth sample to the twentieth, two to a side; another one rests."""
    value = hub({k: 5.0 if k % 4 < 2 else -5.0 for k in range(4, 20)}, n)
    block = {"moved": (times(n), value), "still": (times(n), hub({}, n))}
    state, _ = advance(CONFIG, TriggerState(), block)
    assert not_at_rest(CONFIG, state) == (("moved",) if named else ())


@pytest.mark.parametrize(("size", "bumps"), [(3.0, 0), (-3.0, 0), (3.0000001, 1)])
def test_the_level_itself_is_not_beyond_it(size: float, bumps: int) -> None:
    _, found = events(hub({100: size, 101: size}, rest=0.0))
    assert [event.code for event in found].count("bump") == bumps
