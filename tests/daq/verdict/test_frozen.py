"""Channels that held one value while the car moved: the bench rejects what the desk leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Step
from daq.bench.config import load_bench
from daq.channels import Channel, Quantity
from daq.runs import BASELINE, Excitation
from daq.sessions import Session
from daq.verdict import RunWindow, judge
from daq.verdict.traffic import frozen
from daq.verdict.window import traces
from dbc.finding import Finding
from identify.decays.usable import usable

from ...flow.coverage import simulated_session
from .test_measures import BODY, HUB, OTHER, PITCH, T_S, TRAVEL, bench_of, ringing, window

Array = NDArray[np.float64]
NOISE: Array = 1e-3 * np.random.default_rng(0).standard_normal(len(T_S))
SWING: Array = ringing(1.2, 0.1) + NOISE
"""A channel that swings, with noise that changes each sample; 1 kHz."""
LATER: Array = np.roll(SWING, 1)


def one(records: Mapping[Channel, Array]) -> Finding:
    """Return the finding on some channels; the bump lasts 0.2 s."""
    bench = bench_of(*records)
    assert bench.campaign.bump_s == pytest.approx(0.2)
    run = window(records)
    (finding,) = frozen(bench, run, traces(tuple(records), run))
    return finding


def held(since_s: float, until_s: float, value: Array = SWING) -> Array:
    first, last = np.searchsorted(T_S, [since_s, until_s])
    result = value.copy()
    result[first : last + 1] = value[first]
    return result


@pytest.mark.parametrize(
    ("since_s", "until_s", "passed"),
    [
        (0.3, 0.49, True),
        (0.3, 0.51, False),  # a fifth of a second
        (0.68, 1.0, False),  # it begins within half a second after the bump
        (0.72, 2.4, True),
        (-0.4, 0.18, True),  # it is over before the decay
        (-0.4, 0.22, False),
    ],
)
def test_a_value_held_for_a_fifth_of_a_second_early_in_the_decay_rejects_a_run(
    since_s: float, until_s: float, passed: bool
) -> None:
    finding = one({TRAVEL: held(since_s, until_s), HUB: SWING})
    assert (finding.code, finding.passed) == ("frozen", passed)
    if not passed:
        assert finding.subject == "travel"
        length = until_s - since_s
        assert finding.text == f"travel held one value for {length:.2f} s (limit 0.20 s)"
        assert finding.advice.startswith("switch the sensor off and on")


def test_a_coarse_sensor_that_rests_on_one_step_is_not_frozen() -> None:
    """It changes in one sample of a hundred before the bump: 20 changes take two seconds."""
    steps = np.arange(len(T_S))
    for each, passed in ((100, True), (10, False)):
        rest = steps // each % 2
        assert one({TRAVEL: np.where(T_S < 0.0, rest, held(0.3, 0.9)), HUB: SWING}).passed is passed


@pytest.mark.parametrize("channel", [TRAVEL, HUB, BODY])
def test_a_sensor_that_shows_one_value_in_the_whole_run_is_frozen(channel: Channel) -> None:
    """Alone or with all others of its kind: each bump moves suspensions and body."""
    still = np.full(len(T_S), 0.3)
    records = {BODY: SWING, HUB: SWING, TRAVEL: SWING, PITCH: SWING}
    finding = one({**records, channel: still})
    assert (finding.passed, finding.subject) == (False, channel.name)
    assert finding.value == pytest.approx(3.5, abs=0.01)


def test_all_that_are_frozen_are_named_and_the_longest_is_the_subject() -> None:
    finding = one({TRAVEL: held(0.3, 0.7), OTHER: held(0.3, 0.9), HUB: SWING})
    assert finding.text.startswith("travel, other held one value for 0.60 s")
    assert finding.subject == "other"


def test_a_rate_of_turn_may_be_silent_by_symmetry() -> None:
    assert one({PITCH: np.zeros(len(T_S)), HUB: SWING}).passed
    assert not one({PITCH: held(0.3, 0.7), HUB: SWING}).passed


def test_what_others_of_its_kind_show_decides_whether_a_constant_sensor_is_frozen() -> None:
    """The other travel changes 4 times in the decay: 20 changes are not expected."""
    slow = np.where(T_S > 0.2, np.floor((T_S - 0.2) * 2.0), 0.0)
    still = np.zeros(len(T_S))
    assert one({TRAVEL: still, OTHER: slow, HUB: SWING}).passed
    assert not one({TRAVEL: still, OTHER: SWING, HUB: SWING}).passed


def test_where_nothing_moves_no_sensor_is_frozen() -> None:
    still = np.zeros(len(T_S))
    assert one({TRAVEL: still, HUB: still, BODY: still}).passed


def test_bench_and_desk_agree_on_a_frozen_travel() -> None:
    """One travel of one run of the shipped bench is frozen from 0.1 s after the bump on."""
    bench = load_bench(None)
    session = simulated_session(bench, 3)
    spoilt: list[Session] = [frozen_in(session, since_s) for since_s in (0.1, 5.0)]
    for one_of_them, rejected in zip(spoilt, (True, False), strict=True):
        run = one_of_them.runs[0]
        samples = {
            name: (run.t0_ns + (group.time_s * 1e9).astype("i8"), value)
            for group in run.groups
            for name, value in group.values.items()
        }
        at = RunWindow(run.t0_ns + round(bench.trigger.pre_s * 1e9), samples)
        findings, _ = judge(bench, Step(BASELINE, Excitation.BOUNCE, 1), at, ())
        failed = [finding.code for finding in findings if not finding.passed]
        assert failed[:1] == ["frozen"] * rejected
        left_out = [not other.is_accepted for other in usable(one_of_them).session.runs]
        assert left_out == [rejected] + [False] * 11


def frozen_in(session: Session, since_s: float) -> Session:
    """Return a session with a travel that is frozen in its first run from some time on."""
    run = session.runs[0]
    name = next(c.name for c in session.channels if c.quantity is Quantity.SUSPENSION_TRAVEL)
    groups = []
    for group in run.groups:
        values = dict(group.values)
        if name in values:
            bump_s = load_bench(None).trigger.pre_s
            at = int(np.searchsorted(group.time_s, bump_s + since_s))
            column = values[name].copy()
            column[at:] = column[min(at, len(column) - 1)]
            values[name] = column
        groups.append(replace(group, values=values))
    return replace(session, runs=(replace(run, groups=tuple(groups)), *session.runs[1:]))
