"""Measured against fitted: one small figure a run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel, Quantity

from ..decays.decay import FreeDecay, Record, Recording
from ..decays.onset import onset_s
from ..fit.estimation import Estimation
from ..fit.likelihood import Residuals
from .blocks import Block, Gallery, Picture, Section
from .envelope import envelope
from .panels import DecayPanel, Trace

_BEFORE_S = 0.1
_BINS = 260
_HUBS = (Quantity.HUB_ACCELERATION, Quantity.HUB_DISPLACEMENT)


def decay_section(estimation: Estimation) -> Section:
    """Return every run with its fit."""
    runs = zip(estimation.records, estimation.decays, estimation.residuals, strict=True)
    noise = estimation.noise
    pictures = tuple(_picture(noise, *run) for run in runs)
    gallery = Gallery(
        "Each run: a channel of the body and one of a wheel, with what the fit leaves",
        "Grey: measured. Colour: fitted. The free decay that is fitted has a blue ground; it "
        "begins at the solid line, the motion at the dashed one. Below each, measured less fitted "
        "in units of the sensor's noise: noise alone stays within the grey band 95 % of the time, "
        "and has no shape. The channels shown are those that stand out most from their noise.",
        pictures,
    )
    blocks: tuple[Block, ...] = (gallery,) if pictures else ()
    lead = "The free decay of every run as measured and as the identified vehicle makes it."
    return Section("decays", "Measured and fitted decays", lead, blocks)


def _picture(
    noise: Mapping[str, float], record: Record, decay: FreeDecay, left: Residuals
) -> Picture:
    onset = onset_s(record)
    begin = record.start_s if onset is None else max(onset - _BEFORE_S, record.start_s)
    traces = tuple(
        _trace(noise, record, decay, left, channel, begin)
        for channel in _most_significant(noise, decay, left)
    )
    panel = DecayPanel(traces, np.nan if onset is None else onset, decay.start_s, record.end_s)
    return Picture(f"decay_{decay.label}", decay.label, "", panel)


def _most_significant(
    noise: Mapping[str, float], decay: FreeDecay, left: Residuals
) -> tuple[Channel, ...]:
    """Choose the channel of the body and that of the wheels whose fit stands out most."""
    strength: dict[str, tuple[float, Channel]] = {}
    for recording in decay.recordings:
        for c, channel in enumerate(recording.group.channels):
            fitted = recording.values[:, c] - left.values[channel.name]
            size = float(np.std(fitted)) / noise[channel.name]
            place = "body" if channel.corner is None else "travel"
            place = "hub" if channel.quantity in _HUBS else place
            if size > strength.get(place, (-1.0, channel))[0]:
                strength[place] = (size, channel)
    if "hub" in strength:
        strength.pop("travel", None)
    return tuple(channel for _, channel in strength.values())


def _trace(
    noise: Mapping[str, float],
    record: Record,
    decay: FreeDecay,
    left: Residuals,
    channel: Channel,
    begin_s: float,
) -> Trace:
    before, whole = _column(record.recordings, channel)
    after, measured = _column(decay.recordings, channel)
    residual = left.values[channel.name]
    shown = before >= begin_s
    after = after + decay.start_s
    return Trace(
        channel.name,
        channel.unit.replace("2", "²"),
        envelope(before[shown], whole[shown], _BINS),
        envelope(after, measured - residual, _BINS),
        envelope(after, residual / noise[channel.name], _BINS),
    )


def _column(
    recordings: tuple[Recording, ...], channel: Channel
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    columns = {
        c.name: (recording.time_s, column)
        for recording in recordings
        for c, column in zip(recording.group.channels, recording.values.T, strict=True)
    }
    return columns[channel.name]
