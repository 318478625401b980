"""Where motion and free decay of a record start, on samples made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.runs import Excitation, Losses, Run, RunStatus, SampleGroup
from dbc import FrameBatch
from identify.decays.decay import (
    ChannelGroup,
    FreeDecay,
    Record,
    Recording,
    decay_start_s,
    is_still,
    onset_s,
    quiet_counts,
    quiet_noise,
    record_of,
    with_channels,
)

Array = NDArray[np.float64]
A, B = (Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "ab")


def recording(values: Array, rate_hz: float = 1000.0, first_s: float = 0.0) -> Recording:
    """Return the samples of one channel, or of two."""
    table = values[:, None] if values.ndim == 1 else values
    channels = (A, B)[: table.shape[1]]
    return Recording(ChannelGroup("g", channels), first_s + np.arange(len(table)) / rate_hz, table)


def record(*recordings: Recording, bump_s: float = 0.2) -> Record:
    return Record("run", "baseline", bump_s, recordings)


def noise(n: int, sigma: float = 1.0) -> Array:
    """Return two values above the mean by sigma, then two below, and so on.

    Both their standard deviation and the noise by successive differences are sigma.
    """
    return np.asarray(sigma * np.resize([1.0, 1.0, -1.0, -1.0], n))


def moving(at: int, size: float, n: int = 1000, samples: int = 400, level: float = 5.0) -> Array:
    """Return noise of 1 about a level, with a step of some samples."""
    values = level + noise(n)
    values[at : at + samples] = level + size
    return values


@pytest.mark.parametrize(("size", "found"), [(5.9, None), (6.1, 0.3), (-6.1, 0.3), (40.0, 0.3)])
def test_motion_is_six_times_the_noise(size: float, found: float | None) -> None:
    assert onset_s(record(recording(moving(300, size)))) == found


@pytest.mark.parametrize(("samples", "found"), [(1, None), (2, 0.3)])
def test_one_sample_alone_is_a_glitch(samples: int, found: float | None) -> None:
    assert onset_s(record(recording(moving(300, 50.0, samples=samples)))) == found


@pytest.mark.parametrize(("first", "found"), [(0.019, 0.4), (0.021, 0.3)])
def test_without_noise_motion_is_two_hundredths_of_the_peak(first: float, found: float) -> None:
    values = np.zeros(1000)
    values[300:400], values[400:500] = first, 1.0
    assert onset_s(record(recording(values))) == found


def test_the_noise_is_that_of_the_rest_or_of_the_last_fifth_if_that_is_louder() -> None:
    """A step of 20 at 0.3 s is six times a noise of 3.3 at most."""
    for sigma, found in ((3.2, 0.3), (3.4, None)):
        values = moving(300, 20.0)
        values[800:] = 5.0 + noise(200, sigma)
        assert onset_s(record(recording(values))) == found
        values[800:] = 5.0 + noise(200)
        values[790:800] = 5.0 + noise(10, 100.0)  # none of the last fifth
        assert onset_s(record(recording(values))) == 0.3


@pytest.mark.parametrize(("at", "found"), [(81, 0.081), (60, None)])
def test_a_record_must_begin_with_80_ms_at_rest(at: int, found: float | None) -> None:
    """From its start: a later clock begins its own there."""
    assert onset_s(record(recording(moving(at, 500.0)))) == found
    late = record(recording(moving(at, 500.0), first_s=7.0))
    assert onset_s(late) == (None if found is None else pytest.approx(7.0 + found))


@pytest.mark.parametrize(("rate_hz", "rests"), [(25.0, False), (30.0, True)])
def test_three_samples_show_rest(rate_hz: float, rests: bool) -> None:
    """80 ms hold two of 25 Hz and three of 30 Hz."""
    values = np.zeros(100)
    values[50:] = 1.0
    assert (onset_s(record(recording(values, rate_hz))) is not None) is rests


@pytest.mark.parametrize(("size", "still"), [(0.0, True), (9.0, False)])
def test_noise_alone_is_no_motion(size: float, still: bool) -> None:
    """A swing of 9 has a standard deviation of 6.4, that is 6.4 times the noise."""
    swing = size * np.sin(2.0 * np.pi * np.arange(1000) / 250.0)
    assert is_still(record(recording(swing + noise(1000)))) is still
    assert is_still(record(recording(np.full(1000, 9.81)))) is True
    assert is_still(record(recording(moving(300, 50.0)))) is False


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("spread", "rests"), [(3.9, True), (4.1, False)])
def test_what_scatters_at_the_start_by_four_times_the_noise_moves(
    spread: float, rests: bool, unit: float
) -> None:
    values = noise(1000)
    values[:80] = noise(80, spread)
    values[300:500] = 100.0
    assert (onset_s(record(recording(unit * values))) is not None) is rests


def test_the_first_channel_to_move_counts_in_whatever_group() -> None:
    late, early = moving(300, 50.0), moving(250, 50.0)
    assert onset_s(record(recording(late), recording(early))) == 0.25
    assert onset_s(record(recording(np.column_stack([late, early])))) == 0.25
    assert onset_s(record(recording(np.column_stack([late, noise(1000)])))) == 0.3
    assert onset_s(record(recording(noise(1000)))) is None


@pytest.mark.parametrize(
    ("bump_s", "start_s"),
    [
        (0.1, 0.3 + 0.1 + 0.01),
        (0.15, 0.3 + 0.15 + 0.01),
        (0.3, 0.3 + 0.3 + 0.01),
        (0.9, 0.3 + 0.9 + 0.01),  # after the end of the record: it has no free decay
        (float("nan"), 0.3 + 0.699 / 2 + 5e-10),  # 0.35 s more would be 0.66: half comes first
    ],
)
def test_a_decay_starts_after_the_bump_and_a_guard_of_10_ms(bump_s: float, start_s: float) -> None:
    given = record(recording(moving(300, 50.0)), bump_s=bump_s)
    assert decay_start_s(given) == pytest.approx(start_s, abs=1e-12)


def test_a_bump_of_unknown_length_takes_35_hundredths() -> None:
    given = record(recording(moving(300, 50.0, n=2000)), bump_s=float("nan"))
    assert decay_start_s(given) == pytest.approx(0.3 + 0.35 + 0.01)


def test_a_record_that_starts_in_motion_is_a_decay_from_its_first_common_sample() -> None:
    both = recording(moving(10, 500.0), first_s=1.0), recording(moving(10, 500.0), first_s=1.5)
    given = record(*both)
    assert [given.start_s, given.end_s] == pytest.approx([1.5, 2.499], abs=1e-8)
    assert decay_start_s(given) == 1.5


def test_noise_at_rest_is_pooled_over_runs_about_the_level_of_each() -> None:
    """295 and 245 samples before 5 ms ahead of the motion; one degree of freedom for each level."""
    one = record(recording(moving(300, 50.0, level=5.0)))
    two = record(recording(9.0 + 3.0 * (moving(250, 50.0) - 5.0)))
    assert quiet_counts([one, two]) == {"a": 294 + 244}
    # An odd number of +-1 has the squares n - 1 / n about its mean.
    squares = 295 - 1 / 295 + 9.0 * (245 - 1 / 245)
    assert quiet_noise([one, two]) == {"a": pytest.approx(np.sqrt(squares / 538))}


@pytest.mark.parametrize(("at", "known"), [(104, False), (108, True)])
def test_a_hundred_degrees_of_freedom_make_a_noise_level(at: int, known: bool) -> None:
    """Of 104 samples at rest 99 are used, of 108 there are 103; one goes for the level."""
    assert bool(quiet_noise([record(recording(moving(at, 50.0)))])) is known


# Samples of a run: what is usable, thinned, cut, and described otherwise -------------------------

ONE, TWO, C = (Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "abc")


def counted(n: int, rate_hz: float, *channels: Channel) -> Recording:
    values = np.arange(n * len(channels), dtype=float).reshape(n, -1)
    return Recording(ChannelGroup("g", channels), np.arange(n) / rate_hz, values)


def run_of(*groups: SampleGroup) -> Run:
    return Run(
        "baseline", Excitation.BOUNCE, 1, 0, 0.2, groups, RunStatus.ACCEPTED, (), Losses(), (),
        FrameBatch.empty(),
    )  # fmt: skip


def test_a_stretch_has_its_first_instant_and_not_its_last() -> None:
    part = counted(10, 8.0, ONE).between(0.25, 0.75)
    assert part.time_s.tolist() == [0.0, 0.125, 0.25, 0.375]
    assert part.values[:, 0].tolist() == [2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("rate_hz", "step"), [(100.0, 1), (67.0, 1), (66.0, 2), (50.0, 2), (33.0, 3), (1000.0, 1)]
)
def test_thinning_takes_every_so_many_th_sample(rate_hz: float, step: int) -> None:
    thin = counted(31, 100.0, ONE).thinned(rate_hz)
    assert thin.values[:, 0].tolist() == list(range(0, 31, step))
    assert thin.time_s == pytest.approx(np.arange(0, 31, step) / 100.0)
    decay = FreeDecay("run", "baseline", 0.5, (counted(31, 100.0, ONE, TWO),))
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
        *(ONE, TWO, C, Channel("spare", Quantity.UNUSED)),
        replace(ONE, name="late", delay_s=0.05),
        replace(ONE, name="slow", low_pass_hz=20.0),
    )
    record = record_of(run_of(group, empty), channels)
    stated = record.label, record.mass_state, record.bump_s
    assert stated == ("baseline_bounce_1", "baseline", 0.2)
    names = [[c.name for c in r.group.channels] for r in record.recordings]
    assert names == [["a", "b"], ["late"], ["slow"]]
    both, late, slow = record.recordings
    assert both.time_s.tolist() == [0.0, 0.2, pytest.approx(0.3)]
    assert both.values.tolist() == [[1.0, 8.0], [3.0, 10.0], [4.0, 11.0]]
    assert late.time_s == pytest.approx([-0.05, 0.05, 0.15])
    assert late.values[:, 0].tolist() == [5.0, 6.0, 7.0]
    assert len(slow.time_s) == 4


def test_samples_that_are_described_otherwise_stay_as_they_are() -> None:
    decay = FreeDecay("run", "baseline", 0.0, (counted(5, 10.0, ONE, TWO, C),))

    def change(channel: Channel) -> Channel | None:
        if channel.name == "a":
            return None
        return replace(channel, low_pass_hz=20.0) if channel.name == "b" else channel

    one, two = with_channels(decay, change).recordings
    assert [c.name for c in one.group.channels] == ["b"]
    assert [c.name for c in two.group.channels] == ["c"]
    assert one.values[:, 0].tolist() == [1.0, 4.0, 7.0, 10.0, 13.0]
    assert two.values[:, 0].tolist() == [2.0, 5.0, 8.0, 11.0, 14.0]
    exchanged = {"a": replace(ONE, name="c"), "b": TWO, "c": replace(C, name="a")}
    (whole,) = with_channels(decay, lambda c: exchanged[c.name]).recordings
    assert [c.name for c in whole.group.channels] == ["c", "b", "a"]
    assert whole.values.tolist() == decay.recordings[0].values.tolist()


def test_a_decay_has_only_groups_of_two_samples_or_more() -> None:
    record = Record("run", "baseline", 0.2, (counted(10, 10.0, ONE), counted(4, 10.0, TWO, C)))
    assert record.start_s == 0.0
    assert record.end_s == pytest.approx(0.9)
    for start_s, names in ((0.15, ["a", "bc"]), (0.25, ["a"])):
        parts = record.decay(start_s).recordings
        assert ["".join(c.name for c in part.group.channels) for part in parts] == names
        assert [record.whole(part) for part in parts] == list(record.recordings[: len(parts)])
