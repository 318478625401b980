"""Measured against fitted, one small figure a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel, Quantity

from ..decays.decay import FreeDecay, Record, Recording, onset_s
from ..fit.estimation import Estimation
from ..fit.likelihood import Residuals
from ..words import unit_text
from .page import FAINT, HALF_IN, INK, PALETTE, Block, Gallery, Picture, Section

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

Floats = NDArray[np.float64]

_BINS = 260
_HUBS = (Quantity.HUB_ACCELERATION, Quantity.HUB_DISPLACEMENT)


@dataclass(frozen=True, slots=True)
class Trace:
    """A channel measured and fitted, each thinned so that no spike is lost."""

    channel: str
    unit: str
    """`channel`, `unit`: name of the channel, and unit of its values."""
    measured: Floats
    fitted: Floats
    residual: Floats
    """Time within the run, s, over the value in `unit`, shape (2, n); the residual in units of the
    noise."""


@dataclass(frozen=True, slots=True)
class DecayTraces:
    """One run: its channels that stand out most from their noise, and the window that is fitted."""

    label: str
    traces: tuple[Trace, ...]
    onset_s: float
    start_s: float
    end_s: float
    """`onset_s`, `start_s`, `end_s`: when motion begins (NaN if the record begins in motion), and
    the window that is fitted."""


def decay_traces(estimation: Estimation) -> tuple[DecayTraces, ...]:
    """Return what is drawn of every run that was fitted."""
    runs = zip(estimation.records, estimation.decays, estimation.residuals, strict=True)
    return tuple(_traces(estimation.noise, *run) for run in runs)


def decay_section(estimation: Estimation) -> Section:
    """Return every run with its fit."""
    pictures = tuple(decay_picture(run) for run in decay_traces(estimation))
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


def _traces(
    noise: Mapping[str, float], record: Record, decay: FreeDecay, residuals: Residuals
) -> DecayTraces:
    onset = onset_s(record)
    begin_s = record.start_s if onset is None else max(onset - 0.1, record.start_s)
    traces = []
    for channel in _most_significant(noise, decay, residuals):
        before, whole = _column(record.recordings, channel.name)
        after, measured = _column(decay.recordings, channel.name)
        residual = residuals.values[channel.name]
        shown = before >= begin_s
        after = after + decay.start_s
        traces.append(
            Trace(
                channel.name,
                unit_text(channel.unit),
                envelope(before[shown], whole[shown], _BINS),
                envelope(after, measured - residual, _BINS),
                envelope(after, residual / noise[channel.name], _BINS),
            )
        )
    motion_s = np.nan if onset is None else onset
    return DecayTraces(decay.label, tuple(traces), motion_s, decay.start_s, record.end_s)


def _most_significant(
    noise: Mapping[str, float], decay: FreeDecay, residuals: Residuals
) -> tuple[Channel, ...]:
    """Choose the channel of the body and that of the wheels whose fit stands out most."""
    strength: dict[str, tuple[float, Channel]] = {}
    for recording in decay.recordings:
        for c, channel in enumerate(recording.group.channels):
            fitted = recording.values[:, c] - residuals.values[channel.name]
            size = float(np.std(fitted)) / noise[channel.name]
            place = "body" if channel.corner is None else "travel"
            place = "hub" if channel.quantity in _HUBS else place
            if size > strength.get(place, (-1.0, channel))[0]:
                strength[place] = (size, channel)
    if "hub" in strength:
        strength.pop("travel", None)
    return tuple(channel for _, channel in strength.values())


def _column(recordings: Sequence[Recording], name: str) -> tuple[Floats, Floats]:
    """Return times and values of a channel."""
    return next(
        (recording.time_s, column)
        for recording in recordings
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True)
        if channel.name == name
    )


def decay_picture(run: DecayTraces) -> Picture:
    """Return each trace, and beneath it its residual in units of the noise."""
    return Picture(f"decay_{run.label}", run.label, "", HALF_IN, 2.75, partial(_draw_decay, run))


def _draw_decay(run: DecayTraces, figure: FigureBase) -> None:
    from matplotlib.ticker import MaxNLocator

    if not run.traces:
        return
    heights = [part for _ in run.traces for part in (3.0, 1.15)]
    grid = figure.add_gridspec(
        len(heights), 1, height_ratios=heights, left=0.13, right=0.985, top=0.985, bottom=0.115,
        hspace=0.13,
    )  # fmt: skip
    shared = None
    for number, trace in enumerate(run.traces):
        hue = PALETTE[1 + number]
        top = figure.add_subplot(grid[2 * number], sharex=shared)
        shared = shared or top
        under = figure.add_subplot(grid[2 * number + 1], sharex=shared)
        for axes in (top, under):
            axes.axvspan(run.start_s, run.end_s, color="#eef4f9", lw=0.0, zorder=0)
            axes.tick_params(labelsize=7.0, length=2.5, labelbottom=False)
        top.plot(*trace.measured, color="#9a9a9a", lw=1.5, solid_joinstyle="round")
        top.plot(*trace.fitted, color=hue, lw=0.85)
        top.axvline(run.start_s, color=INK, lw=0.7)
        if np.isfinite(run.onset_s):
            top.axvline(run.onset_s, color=INK, lw=0.7, ls=(0, (2, 2)))
        top.text(
            0.99, 0.95, f"{trace.channel}, {trace.unit}", transform=top.transAxes, ha="right",
            va="top", fontsize=7.5, color=hue, parse_math=False,
        )  # fmt: skip
        top.yaxis.set_major_locator(MaxNLocator(4))
        under.axhspan(-2.0, 2.0, color=FAINT, alpha=0.6, lw=0.0, zorder=0.5)
        under.plot(*trace.residual, color=hue, lw=0.5)
        # Six standard deviations of the noise, or more if the largest residual exceeds them.
        reach = max(6.0, float(np.max(np.abs(trace.residual[1]), initial=0.0)) * 1.05)
        under.set_ylim(-reach, reach)
        under.yaxis.set_major_locator(MaxNLocator(3))
        under.set_ylabel("sigma", fontsize=6.5)
    under.tick_params(labelbottom=True)
    under.set_xlabel("time in the run, s", fontsize=7.5, labelpad=1.5)
    under.set_xlim(float(run.traces[0].measured[0, 0]), run.end_s)


def envelope(time_s: Floats, values: Floats, bins: int) -> Floats:
    """Keep the lowest and highest point of each of `bins` stretches, so that no spike is hidden.

    `time_s` and `values`, (n,): the curve; one of no more than two points in each stretch is kept
    as it is.  Returns times over values, (2, m), m <= max(2 bins, n).
    """
    n = len(values)
    if n <= 2 * bins:
        return np.stack([time_s, values])
    edges = np.linspace(0, n, bins + 1).astype(int)
    stretch = np.repeat(np.arange(bins), np.diff(edges))
    lowest, highest = (f.reduceat(values, edges[:-1])[stretch] for f in (np.minimum, np.maximum))
    kept = (np.flatnonzero(values == extreme) for extreme in (lowest, highest))
    chosen = np.union1d(
        *(points[np.unique(stretch[points], return_index=True)[1]] for points in kept)
    )
    return np.stack([time_s[chosen], values[chosen]])
