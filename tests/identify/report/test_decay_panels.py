"""Decays as drawn, by recordings made by hand: which channels, which stretch, which numbers."""

from __future__ import annotations

from dataclasses import replace
from math import isnan
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.estimation import Estimation
from identify.fit.likelihood import Residuals
from identify.report.blocks import Gallery
from identify.report.decays import decay_section
from identify.report.envelope import envelope
from identify.report.overlay import overlay_gallery
from identify.report.panels import DecayPanel, OverlayPanel

BODY, PITCH = Quantity.BODY_ACCELERATION, Quantity.PITCH_RATE
HUB, TRAVEL = Quantity.HUB_ACCELERATION, Quantity.SUSPENSION_TRAVEL
CHANNELS = (
    Channel("z_s", BODY, "m/s2"),
    Channel("theta", PITCH, "rad/s"),
    Channel("hub_fl", HUB, "m/s2", corner=Corner.FRONT_LEFT),
    Channel("hub_rr", HUB, "m/s2", corner=Corner.REAR_RIGHT),
    Channel("travel_fl", TRAVEL, "m", corner=Corner.FRONT_LEFT),
)
NOISE = {"z_s": 0.1, "theta": 0.01, "hub_fl": 0.5, "hub_rr": 0.1, "travel_fl": 1e-4}
SIZE = {"z_s": 1.0, "theta": 0.05, "hub_fl": 2.0, "hub_rr": 1.0, "travel_fl": 0.02}
START_S = 0.6


def signal(time_s: np.ndarray, begin_s: float) -> np.ndarray:
    """Return a decay of 2 Hz that begins with a step."""
    off = time_s - begin_s
    return np.where(off > -1e-9, np.cos(4.0 * np.pi * off) * np.exp(-off), 0.0)


def record(label: str, channels: tuple[Channel, ...], begin_s: float = 0.5, n: int = 300) -> Record:
    time_s = np.arange(n) / 100.0
    values = np.column_stack([SIZE[c.name] * signal(time_s, begin_s) for c in channels])
    group = ChannelGroup("imu", channels)
    return Record(label, "baseline", 0.1, (Recording(group, time_s, values),))


def estimation(
    *records: Record, start_s: float = START_S, noise: dict[str, float] = NOISE
) -> Estimation:
    """Return a fit that leaves an alternating half of the noise in each channel."""
    decays = tuple(one.decay(start_s) for one in records)
    left = []
    for decay in decays:
        (recording,) = decay.recordings
        half = np.where(np.arange(len(recording.time_s)) % 2, -0.5, 0.5)
        left.append(
            Residuals(
                decay.label, {c.name: half * noise[c.name] for c in recording.group.channels}, {}
            )
        )  # fmt: skip
    nothing: Any = None
    return Estimation(nothing, records, nothing, decays, noise, {}, tuple(left), 1.0)


def panel(made: Estimation) -> DecayPanel:
    (one,) = decay_section(made).pictures
    assert isinstance(one.panel, DecayPanel)
    return one.panel


def test_a_trace_has_what_was_measured_fitted_and_left_at_their_times() -> None:
    made = estimation(record("roll_1", CHANNELS[:1]))
    (picture,) = decay_section(made).pictures
    assert (picture.key, picture.title) == ("decay_roll_1", "roll_1")
    found = panel(made)
    assert found.onset_s == pytest.approx(0.5)
    assert found.start_s == 0.6
    assert found.end_s == pytest.approx(2.99)
    (trace,) = found.traces
    assert (trace.channel, trace.unit) == ("z_s", "m/s²")
    time_s = np.arange(40, 300) / 100.0  # a tenth of a second of rest before the motion
    np.testing.assert_allclose(trace.measured, [time_s, signal(time_s, 0.5)], atol=1e-12)
    time_s = np.arange(60, 300) / 100.0
    half = np.where(np.arange(240) % 2, -0.5, 0.5)
    np.testing.assert_allclose(trace.fitted, [time_s, signal(time_s, 0.5) - 0.1 * half])
    np.testing.assert_allclose(trace.residual, [time_s, half])


def test_a_record_that_begins_in_motion_is_shown_from_its_beginning() -> None:
    found = panel(estimation(record("roll_1", CHANNELS[:1], begin_s=0.0)))
    assert isnan(found.onset_s)
    assert found.traces[0].measured[0, 0] == 0.0


@pytest.mark.parametrize(
    ("chosen", "shown"),
    [
        # Sizes over noise: 10, 5, 4, 10 and 200.
        ((0, 1, 2, 3, 4), ["z_s", "hub_rr"]),
        ((1, 0, 3, 2), ["z_s", "hub_rr"]),
        ((1, 2, 4), ["theta", "hub_fl"]),
        ((0, 4), ["z_s", "travel_fl"]),
        ((4, 1), ["travel_fl", "theta"]),
    ],
)
def test_shown_are_a_channel_of_the_body_and_one_of_a_wheel_that_stand_out_most(
    chosen: tuple[int, ...], shown: list[str]
) -> None:
    found = panel(estimation(record("roll_1", tuple(CHANNELS[i] for i in chosen))))
    assert [trace.channel for trace in found.traces] == shown


def test_what_the_fit_does_not_explain_makes_no_channel_stand_out() -> None:
    made = estimation(record("roll_1", CHANNELS[:2]))
    (left,) = made.residuals
    measured = made.decays[0].recordings[0].values[:, 0]
    made = replace(made, residuals=(replace(left, values={**left.values, "z_s": measured}),))
    assert [trace.channel for trace in panel(made).traces] == ["theta"]


def test_of_two_that_stand_out_alike_the_first_is_shown() -> None:
    made = estimation(record("roll_1", CHANNELS[:2]), noise={**NOISE, "theta": 0.005})
    values = made.decays[0].recordings[0].values.copy()
    values[:, 1] = values[:, 0]
    recording = replace(made.decays[0].recordings[0], values=values)
    same = Residuals("roll_1", dict.fromkeys(("z_s", "theta"), np.zeros(len(values))), {})
    decay = replace(made.decays[0], recordings=(recording,))
    noise = dict.fromkeys(("z_s", "theta"), 0.1)
    made = replace(made, decays=(decay,), residuals=(same,), sigma=noise)
    assert [trace.channel for trace in panel(made).traces] == ["z_s"]


def test_each_run_has_a_picture_in_its_order_and_without_runs_there_is_none() -> None:
    made = estimation(record("roll_1", CHANNELS), record("bounce_1", CHANNELS))
    section = decay_section(made)
    assert [one.title for one in section.pictures] == ["roll_1", "bounce_1"]
    assert decay_section(estimation()).blocks == ()


def test_a_long_decay_is_drawn_by_520_points_at_most() -> None:
    """A ramp of more samples keeps the first and the last one of each of 260 stretches."""
    (channel,) = CHANNELS[:1]
    time_s = np.arange(2000) / 1000.0
    ramp = Recording(ChannelGroup("imu", (channel,)), time_s, time_s[:, None] + 1.0)
    made = estimation(Record("roll_1", "baseline", 0.1, (ramp,)), start_s=0.5)
    made = replace(made, residuals=(Residuals("roll_1", {"z_s": time_s[500:]}, {}),))
    (trace,) = panel(made).traces
    assert trace.residual.shape == (2, 520)
    assert trace.measured.shape == (2, 520)


def test_the_ends_of_each_stretch_of_a_ramp_are_kept() -> None:
    ramp = np.arange(8.0)
    assert envelope(ramp / 10.0, ramp, 2).tolist() == [[0.0, 0.3, 0.4, 0.7], [0, 3, 4, 7]]
    assert envelope(ramp[:5], ramp[:5], 2)[0].tolist() == [0, 1, 2, 4]
    assert envelope(ramp[:4], ramp[:4], 2)[0].tolist() == [0, 1, 2, 3]
    assert envelope(ramp[:4], np.ones(4), 2)[0].tolist() == [0, 1, 2, 3]
    assert envelope(ramp[:5], np.ones(5), 2)[0].tolist() == [0, 2]
    assert envelope(ramp, np.array([5.0, 1, 9, 9, 2, 2, 2, 2]), 2).tolist() == [
        [1, 2, 4], [1, 9, 2],
    ]  # fmt: skip


def overlays(*fits: Estimation) -> dict[str, OverlayPanel]:
    gallery = overlay_gallery([f"s{i + 1}" for i in range(len(fits))], fits)
    assert isinstance(gallery, Gallery)
    found = {}
    for one in gallery.pictures:
        assert isinstance(one.panel, OverlayPanel)
        assert one.key == f"overlay_{one.title}"
        found[one.title] = one.panel
    return found


def test_the_channel_that_stands_out_most_and_that_all_have_lies_over_itself() -> None:
    first = estimation(record("roll_1", CHANNELS))
    assert overlays(first, first)["roll_1"].channel == "travel_fl"
    found = overlays(first, estimation(record("roll_1", CHANNELS[1:4])))["roll_1"]
    assert (found.channel, found.unit, found.labels) == ("hub_rr", "m/s²", ("s1", "s2"))
    time_s = np.arange(150) / 100.0  # the first 1.5 s
    for curve in found.curves:
        np.testing.assert_allclose(curve, [time_s, signal(time_s + 0.6, 0.5)], atol=1e-12)


def test_only_runs_that_all_sessions_have_lie_over_each_other() -> None:
    first = estimation(record("roll_1", CHANNELS), record("pitch_1", CHANNELS))
    second = estimation(record("pitch_1", CHANNELS), record("bounce_1", CHANNELS))
    assert list(overlays(first, second)) == ["pitch_1"]
    third = estimation(record("bounce_1", CHANNELS))
    assert overlay_gallery(["a", "b"], [first, third]) is None
    body, hub = (estimation(record("roll_1", CHANNELS[i : i + 1])) for i in (0, 2))
    assert overlay_gallery(["a", "b"], [body, hub]) is None


def test_four_sessions_are_drawn_at_most() -> None:
    one = estimation(record("roll_1", CHANNELS[:1]))
    found = overlays(*[one] * 5)["roll_1"]
    assert found.labels == ("s1", "s2", "s3", "s4")
    assert len(found.curves) == 4


def test_a_dense_decay_is_overlaid_by_440_points() -> None:
    (channel,) = CHANNELS[:1]
    time_s = np.arange(2000) / 1000.0
    ramp = Recording(ChannelGroup("imu", (channel,)), time_s, time_s[:, None] + 1.0)
    made = estimation(Record("roll_1", "baseline", 0.1, (ramp,)), start_s=0.0)
    assert overlays(made, made)["roll_1"].curves[0].shape == (2, 440)


def test_the_strongest_channel_is_that_of_the_first_sessions_noise() -> None:
    loud = {**NOISE, "hub_rr": 10.0, "travel_fl": 10.0, "theta": 10.0, "hub_fl": 10.0}
    channels = CHANNELS[:4]
    first, other = estimation(record("roll_1", channels)), estimation(
        record("roll_1", channels), noise=loud
    )  # fmt: skip
    assert overlays(other, first)["roll_1"].channel == "z_s"
    quiet = estimation(record("roll_1", channels), noise={**NOISE, "theta": 1e-4})
    assert overlays(quiet, other)["roll_1"].channel == "theta"
