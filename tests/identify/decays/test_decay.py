"""Samples of a run: what is usable, thinned, cut, and described otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import Excitation, Losses, Run, RunStatus, SampleGroup
from dbc import FrameBatch
from identify.decays.decay import (
    ChannelGroup,
    FreeDecay,
    Record,
    Recording,
    record_of,
    with_channels,
)

A, B, C = (Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "abc")


def recording(n: int, rate_hz: float, *channels: Channel) -> Recording:
    values = np.arange(n * len(channels), dtype=float).reshape(n, -1)
    return Recording(ChannelGroup("g", channels), np.arange(n) / rate_hz, values)


def run_of(*groups: SampleGroup) -> Run:
    return Run(
        "baseline", Excitation.BOUNCE, 1, 0, 0.2, groups, RunStatus.ACCEPTED, (), Losses(), (),
        FrameBatch.empty(),
    )  # fmt: skip


def test_a_stretch_has_its_first_instant_and_not_its_last() -> None:
    part = recording(10, 8.0, A).between(0.25, 0.75)
    assert part.time_s.tolist() == [0.0, 0.125, 0.25, 0.375]
    assert part.values[:, 0].tolist() == [2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("rate_hz", "step"), [(100.0, 1), (67.0, 1), (66.0, 2), (50.0, 2), (33.0, 3), (1000.0, 1)]
)
def test_thinning_takes_every_so_many_th_sample(rate_hz: float, step: int) -> None:
    thin = recording(31, 100.0, A).thinned(rate_hz)
    assert thin.values[:, 0].tolist() == list(range(0, 31, step))
    assert thin.time_s == pytest.approx(np.arange(0, 31, step) / 100.0)
    decay = FreeDecay("run", "baseline", 0.5, (recording(31, 100.0, A, B),))
    assert decay.n_values == 62
    assert decay.thinned(rate_hz).n_values == 2 * len(range(0, 31, step))
    assert decay.thinned(rate_hz).start_s == 0.5


def test_a_run_gives_its_usable_samples_at_the_times_of_the_motion() -> None:
    """A row with a NaN is none; what is late, or filtered, otherwise is a group of its own."""
    time = np.arange(4) / 10.0
    values = {
        "a": np.array([1.0, np.nan, 3.0, 4.0]),
        "late": np.array([5.0, 6.0, 7.0, np.inf]),
        "spare": np.full(4, np.nan),
        "b": np.array([8.0, 9.0, 10.0, 11.0]),
        "slow": np.zeros(4),
    }
    group = SampleGroup("m", time, np.arange(4), values, np.zeros(4, np.uint8))
    empty = SampleGroup("e", time, np.arange(4), {"c": np.full(4, np.nan)}, np.zeros(4, np.uint8))
    channels = (
        A, B, C, replace(A, name="late", delay_s=0.05), replace(A, name="slow", low_pass_hz=20.0),
        Channel("spare", Quantity.UNUSED),
    )  # fmt: skip
    record = record_of(run_of(group, empty), channels)
    assert (record.label, record.mass_state, record.bump_s) == (
        "baseline_bounce_1",
        "baseline",
        0.2,
    )
    names = [[c.name for c in r.group.channels] for r in record.recordings]
    assert names == [["a", "b"], ["late"], ["slow"]]
    both, late, slow = record.recordings
    assert both.time_s.tolist() == [0.0, 0.2, pytest.approx(0.3)]
    assert both.values.tolist() == [[1.0, 8.0], [3.0, 10.0], [4.0, 11.0]]
    assert late.time_s == pytest.approx([-0.05, 0.05, 0.15])
    assert late.values[:, 0].tolist() == [5.0, 6.0, 7.0]
    assert len(slow.time_s) == 4


def test_samples_that_are_described_otherwise_stay_as_they_are() -> None:
    decay = FreeDecay("run", "baseline", 0.0, (recording(5, 10.0, A, B, C),))

    def change(channel: Channel) -> Channel | None:
        if channel.name == "a":
            return None
        return replace(channel, low_pass_hz=20.0) if channel.name == "b" else channel

    one, two = with_channels(decay, change).recordings
    assert [c.name for c in one.group.channels] == ["b"]
    assert [c.name for c in two.group.channels] == ["c"]
    assert one.values[:, 0].tolist() == [1.0, 4.0, 7.0, 10.0, 13.0]
    assert two.values[:, 0].tolist() == [2.0, 5.0, 8.0, 11.0, 14.0]
    exchanged = {"a": replace(A, name="c"), "b": B, "c": replace(C, name="a")}
    (whole,) = with_channels(decay, lambda c: exchanged[c.name]).recordings
    assert [c.name for c in whole.group.channels] == ["c", "b", "a"]
    assert whole.values.tolist() == decay.recordings[0].values.tolist()


def test_a_decay_has_only_groups_of_two_samples_or_more() -> None:
    record = Record("run", "baseline", 0.2, (recording(10, 10.0, A), recording(4, 10.0, B, C)))
    assert record.start_s == 0.0
    assert record.end_s == pytest.approx(0.9)
    for start_s, names in ((0.15, ["a", "bc"]), (0.25, ["a"])):
        parts = record.decay(start_s).recordings
        assert ["".join(c.name for c in part.group.channels) for part in parts] == names
        assert [record.whole(part) for part in parts] == list(record.recordings[: len(parts)])
