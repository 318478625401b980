"""Sections that support the numbers: decays, runs left out, energy of the modes, closed form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq.channels import Quantity
from dbc.words import counted

from ..decays.decay import FreeDecay, Record, onset_s
from ..fit.estimation import Estimation
from ..fit.likelihood import Residuals
from ..fit.uncertainty import Prediction, leave_one_out
from ..modes.mode_selection import vehicle_diagram
from ..modes.state_variable_method import StabilisationDiagram
from ..numbers import number
from ..result import Identification
from ..trust.gates import SNR_LIMIT_DB
from ..words import half_text, parameter_words, unit_text
from .page import FAINT, HALF_IN, INK, PALETTE, Block, Gallery, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

Floats = NDArray[np.float64]


# Measured against fitted, one small figure a run --------------------------------------------------


@dataclass(frozen=True, slots=True)
class Trace:
    """A channel measured and fitted, each thinned so that no spike is lost."""

    title: str
    """Its name and the unit of its values."""
    measured: Floats
    fitted: Floats
    residual: Floats
    """Time within the run, s, over the value, shape (2, n); the residual in units of the noise."""


def decay_section(estimation: Estimation) -> Section:
    """Return the section of every run with its fit, a picture each."""
    gallery = Gallery(
        "Each run: a channel of the body and one of a wheel, with what the fit leaves",
        "Grey: measured. Colour: fitted. The free decay that is fitted has a blue ground; it "
        "begins at the solid line, the motion at the dashed one. Below each, measured less fitted "
        "in units of the sensor's noise: noise alone stays within the grey band 95 % of the time, "
        "and has no shape. The channels shown are those that stand out most from their noise.",
        tuple(decay_pictures(estimation)),
    )
    lead = "The free decay of every run as measured and as the identified vehicle makes it."
    return Section("decays", "Measured and fitted decays", lead, (gallery,))


def decay_pictures(estimation: Estimation) -> Iterator[Picture]:
    """Yield a picture of each run: some channels, and beneath each what the fit leaves."""
    runs = zip(estimation.records, estimation.decays, estimation.residuals, strict=True)
    for record, decay, residuals in runs:
        motion_s = onset_s(record)
        # From a tenth of a second before the motion.
        from_s = record.start_s if motion_s is None else max(motion_s - 0.1, record.start_s)
        traces = _traces(estimation.noise, record, decay, residuals, from_s)
        draw = partial(_draw_decay, traces, (from_s, record.end_s), decay.start_s, motion_s)
        yield Picture(f"decay_{decay.label}", decay.label, "", HALF_IN, 2.75, draw)


def _traces(
    noise: Mapping[str, float],
    record: Record,
    decay: FreeDecay,
    residuals: Residuals,
    from_s: float,
) -> tuple[Trace, ...]:
    """Return the channel of the body and that of the wheels that stand out most from their noise.

    Hubs come before travels.  `noise`: standard deviations, SI.  `from_s`: beginning of the traces.
    """
    strongest: dict[str, tuple[float, Trace]] = {}
    for recording in decay.recordings:
        whole = record.whole(recording)
        is_drawn = whole.time_s >= from_s
        time_s = recording.time_s + decay.start_s
        for c, channel in enumerate(recording.group.channels):
            residual = residuals.values[channel.name]
            fitted = recording.values[:, c] - residual
            strength = float(np.std(fitted)) / noise[channel.name]
            place = "body" if channel.corner is None else "travel"
            if channel.quantity in (Quantity.HUB_ACCELERATION, Quantity.HUB_DISPLACEMENT):
                place = "hub"
            if place not in strongest or strength > strongest[place][0]:
                trace = Trace(
                    f"{channel.name}, {unit_text(channel.unit)}",
                    envelope(whole.time_s[is_drawn], whole.values[is_drawn, c]),
                    envelope(time_s, fitted),
                    envelope(time_s, residual / noise[channel.name]),
                )
                strongest[place] = (strength, trace)
    if "hub" in strongest:
        strongest.pop("travel", None)
    return tuple(trace for _, trace in strongest.values())


def _draw_decay(
    traces: tuple[Trace, ...],
    span_s: tuple[float, float],
    decay_start_s: float,
    motion_s: float | None,
    figure: FigureBase,
) -> None:
    """Draw each trace over a span of the run, and beneath it its residual.

    `motion_s`: when motion begins, None if the record begins in motion.
    """
    from matplotlib.ticker import MaxNLocator

    heights = [height for _ in traces for height in (3.0, 1.15)]  # of a trace and its residual
    grid = figure.add_gridspec(
        len(heights), 1, height_ratios=heights, left=0.13, right=0.985, top=0.985, bottom=0.115,
        hspace=0.13,
    )  # fmt: skip
    shared = None
    for i, trace in enumerate(traces):
        hue = PALETTE[1 + i]
        top = figure.add_subplot(grid[2 * i], sharex=shared)
        shared = shared or top
        under = figure.add_subplot(grid[2 * i + 1], sharex=shared)
        for axes in (top, under):
            axes.axvspan(decay_start_s, span_s[1], color="#eef4f9", lw=0.0, zorder=0)
            axes.tick_params(labelsize=7.0, length=2.5, labelbottom=False)
        top.plot(*trace.measured, color="#9a9a9a", lw=1.5, solid_joinstyle="round")
        top.plot(*trace.fitted, color=hue, lw=0.85)
        top.axvline(decay_start_s, color=INK, lw=0.7)
        if motion_s is not None:
            top.axvline(motion_s, color=INK, lw=0.7, ls=(0, (2, 2)))
        top.text(
            0.99, 0.95, trace.title, transform=top.transAxes, ha="right", va="top", fontsize=7.5,
            color=hue, parse_math=False,
        )  # fmt: skip
        top.yaxis.set_major_locator(MaxNLocator(4))
        under.axhspan(-2.0, 2.0, color=FAINT, alpha=0.6, lw=0.0, zorder=0.5)
        under.plot(*trace.residual, color=hue, lw=0.5)
        # Six standard deviations of the noise, or more if the largest residual exceeds them.
        reach = max(6.0, float(np.max(np.abs(trace.residual[1]), initial=0.0)) * 1.05)
        under.set_ylim(-reach, reach)
        under.yaxis.set_major_locator(MaxNLocator(3))
        under.set_ylabel("sigma", fontsize=6.5)
        if trace is traces[-1]:
            under.tick_params(labelbottom=True)
            under.set_xlabel("time in the run, s", fontsize=7.5, labelpad=1.5)
            under.set_xlim(*span_s)


def envelope(time_s: Floats, values: Floats, stretches: int = 260) -> Floats:
    """Keep the lowest and highest point of each stretch, so that no spike is hidden.

    `time_s` and `values`, (n,): the curve; one of no more than two points in each stretch is kept
    as it is.  Returns times over values, (2, m), m <= max(2 stretches, n).
    """
    n = len(values)
    if n <= 2 * stretches:
        return np.stack([time_s, values])
    kept: list[int] = []
    for part in np.array_split(np.arange(n), stretches):
        extremes = {part[np.argmin(values[part])], part[np.argmax(values[part])]}
        kept += sorted(extremes)
    return np.stack([time_s[kept], values[kept]])


# Checks beside the fit ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CrossChecks:
    """Checks that only a report shows: they take seconds and need nothing but the fit."""

    predictions: tuple[Prediction, ...] = ()
    """Each run predicted from all the others."""
    diagrams: Mapping[str, StabilisationDiagram] = field(default_factory=dict)
    """Stabilisation diagrams by mass state, where the decays allow one."""


def cross_checks(estimation: Estimation) -> CrossChecks:
    """Predict each run from the others, and find the poles of each mass state over the rank."""
    records = estimation.records
    diagrams = {}
    for state in dict.fromkeys(record.mass_state for record in records):
        of_state = [i for i, record in enumerate(records) if record.mass_state == state]
        decays = [estimation.decays[i].thinned(250.0) for i in of_state]  # Hz, for the modes
        diagram = vehicle_diagram([records[i] for i in of_state], decays)
        if diagram is not None:
            diagrams[state] = diagram
    return CrossChecks(leave_one_out(estimation), diagrams)


# What each run contributed ------------------------------------------------------------------------


def information_section(result: Identification) -> Section:
    """Return the section of each run's contribution, and of the energy of each mode in it."""
    blocks: list[Block] = []
    by_run = result.quality.chi2_by_run
    if result.quality.snr_db:
        blocks.append(_energy_table(result))
    if result.drivers:
        sources = dict.fromkeys(s for shares in result.drivers.values() for s in shares)
        runs = [label for label in by_run if label in sources]
        shares = {
            source: {
                name: f"{of_parameter[source] * 100:.1f}"
                for name, of_parameter in result.drivers.items()
                if source in of_parameter and name not in result.undetermined
            }
            for source in (*runs, *(source for source in sources if source not in runs))
        }
        title = "Share of each parameter's precision, %"
        note = (
            "Columns add up to 100 %: if a run had 1 % more information, the variance would fall "
            "by its share of 1 %."
        )
        blocks.append(_grid(title, "run or fact", tuple(result.drivers), shares, note))
    if by_run:
        channels = tuple(dict.fromkeys(c for row in by_run.values() for c in row))
        texts = {run: {c: f"{x:.3f}" for c, x in row.items()} for run, row in by_run.items()}
        note = "1 where the residuals are noise alone."
        blocks.append(_grid("chi2/n of each run and channel", "run", channels, texts, note))
    lead = "Which run shows which mode, and which run each parameter rests on."
    return Section("information", "What each run contributed", lead, tuple(blocks))


def _grid(
    title: str,
    corner: str,
    columns: Sequence[str],
    rows: Mapping[str, Mapping[str, str]],
    note: str,
) -> Table:
    """Return a table with a text for each row and column that has one."""
    cells = tuple((name, *(row.get(c, "") for c in columns)) for name, row in rows.items())
    return Table(title, (corner, *(f"#{name}" for name in columns)), cells, note)


def _energy_table(result: Identification) -> Table:
    """Return the energy of each mode in each run.

    A column is a mode of the first mass state; a mode without a partner there is left out.
    """
    states = {r.label: r.mass_state for r in result.estimation.records} if result.estimation else {}
    first = next(iter(result.modal))
    modes = result.mode_names[first]
    rows: dict[str, dict[str, str]] = {}
    for label, of_run_db in result.quality.snr_db.items():
        pairs = result.pairings.get(states.get(label, first))
        rank_in_first = {rank: rank for rank in range(len(modes))}
        if pairs is not None:  # the run is of another state
            rank_in_first = dict(zip(pairs.added.tolist(), pairs.baseline.tolist(), strict=True))
        rows[label] = {
            modes[rank_in_first[rank]]: f"{'▼ ' if db < SNR_LIMIT_DB else ''}{db:z.0f}"
            for rank, db in enumerate(of_run_db)
            if rank in rank_in_first
        }
    note = (
        f"▼ marks less than {SNR_LIMIT_DB:.0f} dB: that run gives no information on that mode, "
        "which is normal as long as another run does."
    )
    return _grid("Energy of each mode over the noise, dB", "run", modes, rows, note)


def correlation_section(result: Identification) -> Section:
    """Return the section of the correlation matrix, without its diagonal, which is 1."""
    names = result.correlation.names
    rows = {
        name: {
            other: f"{r:+.2f}".replace("0.", ".")
            for other, r in zip(names, of_name, strict=True)
            if other != name
        }
        for name, of_name in zip(names, result.correlation.matrix.tolist(), strict=True)
    }
    note = (
        "Near +1 two parameters are wrong together, so that their ratio is known far better than "
        "either; near -1 their sum or product is."
    )
    blocks = (_grid("Correlation of the errors", "", names, rows, note),) if names else ()
    lead = "Correlation coefficients of the parameters' errors."
    return Section("correlation", "Correlation", lead, blocks)


# The paper's chain --------------------------------------------------------------------------------


def closed_form_section(result: Identification) -> Section:
    """Return the section of the closed form, compared with the likelihood."""
    title = "Closed form and likelihood"
    lead = (
        "The paper's chain (Eqs. 22-33) needs no start values and no iteration, but uses less of "
        "the data. It is compared with the likelihood as a check by another method: a difference "
        "beyond the likelihood's interval is an error of the closed form where the verdict is good."
    )
    rows = []
    for name, value in result.closed_form.items():
        e = result.parameters.get(name)
        if e is not None and e.determined:
            difference = f"{(value / e.value - 1.0) * 100.0:+.2f} %"
            numbers = (number(value), number(e.value), difference, half_text(e))
            rows.append((name, parameter_words(name), *numbers, unit_text(e.unit)))
    if not rows:
        reason = result.closed_form_reason or "the decays determine none of its parameters"
        lead += f" It has no answer for this session: {reason}."
        return Section("closed_form", title, lead, ())
    columns = ("", "parameter", "#closed form", "#likelihood", "#difference", "#±", "unit")
    blocks: list[Block] = [Table("Both in numbers", columns, tuple(rows))]
    if ways := result.closed_form_damping:
        heading = "Its damping by each way to the damping matrix, N s/m"
        texts = tuple((way, number(c["c_sf"]), number(c["c_sr"])) for way, c in ways.items())
        blocks.append(Table(heading, ("way", "#c_sf", "#c_sr"), texts))
    return Section("closed_form", title, lead, tuple(blocks))


# A run left out -----------------------------------------------------------------------------------


def prediction_section(predictions: tuple[Prediction, ...]) -> Section:
    """Return the section of each run predicted from all the others."""
    n_at_noise = sum(p.at_noise for p in predictions)
    n_predicted = sum(bool(np.isfinite(p.predicted)) for p in predictions)
    lead = (
        "The vehicle is fitted on all other runs and must then predict the one that was left out; "
        "only the initial state and the sensors' offsets are the run's own. For a linear car what "
        "remains is noise; friction, a hot damper or a lifted wheel are not predicted. "
        f"Here {n_at_noise} of {counted(n_predicted, 'run is', 'runs are')} predicted down to the "
        "noise."
    )
    if n_predicted < len(predictions):
        lead += f" For {len(predictions) - n_predicted} the others do not determine the vehicle."
    rows = []
    for p in predictions:
        cells = ("", "", "the others do not determine all parameters")
        if np.isfinite(p.predicted):
            answer = "✓ at noise level" if p.at_noise else "✕ not predicted"
            cells = (number(p.predicted), number(p.limit), answer)
        rows.append((p.label, number(p.fitted), *cells))
    columns = ("run", "#fitted", "#predicted", "#limit", "")
    blocks = (Table("chi2/n of each run", columns, tuple(rows)),) if rows else ()
    return Section("prediction", "A run left out and predicted", lead, blocks)
