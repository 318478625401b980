"""Sections that support the numbers: runs left out, noise, correlation, the paper's chain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.words import counted

from ..fit.estimation import Estimation
from ..fit.uncertainty import Prediction, leave_one_out
from ..modes.state_variable_method import StabilisationDiagram
from ..modes.vehicle_modes import vehicle_diagram
from ..numbers import number
from ..result import Identification
from ..trust.plausibility import SNR_LIMIT_DB
from ..words import half_percent, parameter_words, unit_text
from .page import (
    FAINT,
    INK,
    PALETTE,
    WIDTH_IN,
    Block,
    Picture,
    Section,
    Table,
    height_in,
    line_axes,
    lines_height_in,
    shared_legend,
)
from .parameters import about_zero, interval_bars

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

Floats = NDArray[np.float64]
Texts = tuple[str, ...]

_HEAD_IN, _ROW_IN = 0.25, 0.215


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
        mine = [i for i, record in enumerate(records) if record.mass_state == state]
        decays = [estimation.decays[i].thinned(250.0) for i in mine]
        diagram = vehicle_diagram([records[i] for i in mine], decays)
        if diagram is not None:
            diagrams[state] = diagram
    return CrossChecks(leave_one_out(estimation), diagrams)


# What each run contributed ------------------------------------------------------------------------


def information_section(result: Identification) -> Section:
    """Return each run's contribution, and how far each mode stands out of its noise."""
    blocks: list[Block] = []
    by_run = result.quality.chi2_by_run
    if result.quality.snr_db:
        blocks.append(snr_picture(result))
    if result.drivers:
        sources = dict.fromkeys(s for shares in result.drivers.values() for s in shares)
        runs = [label for label in by_run if label in sources]
        order = (*runs, *(s for s in sources if s not in runs))
        drivers = {
            name: {} if name in result.undetermined else shares
            for name, shares in result.drivers.items()
        }
        blocks.append(
            _grid(
                "Share of each parameter's precision, %",
                "run or fact",
                tuple(drivers),
                {
                    source: {
                        name: f"{shares[source] * 100:.1f}"
                        for name, shares in drivers.items()
                        if source in shares
                    }
                    for source in order
                },
                "Columns add up to 100 %: if a run had 1 % more information, the variance would "
                "fall by its share of 1 %.",
            )
        )
    if by_run:
        channels = tuple(dict.fromkeys(c for row in by_run.values() for c in row))
        texts = {run: {c: f"{x:.3f}" for c, x in row.items()} for run, row in by_run.items()}
        note = "1 where the residuals are noise alone."
        blocks.append(_grid("chi2/n of each run and channel", "run", channels, texts, note))
    return Section(
        "information",
        "What each run contributed",
        "Which run shows which mode, and which run each parameter rests on.",
        tuple(blocks),
    )


def _grid(
    title: str, corner: str, columns: Texts, rows: Mapping[str, Mapping[str, str]], note: str
) -> Table:
    """Return a table with a number for each row and column that has one."""
    cells = tuple((name, *(row.get(c, "") for c in columns)) for name, row in rows.items())
    return Table(title, (corner, *(f"#{name}" for name in columns)), cells, note)


def snr_picture(result: Identification) -> Picture:
    """Return the energy of each mode in each run; a column is a mode, whatever its rank."""
    states = {r.label: r.mass_state for r in result.estimation.records} if result.estimation else {}
    first = next(iter(result.modal))
    modes = result.mode_names[first]
    runs = tuple(result.quality.snr_db)
    decibel = np.full((len(runs), len(modes)), np.nan)
    for row, label in enumerate(runs):
        pairs = result.pairings.get(states.get(label, first))
        places = dict(enumerate(range(len(modes))))
        if pairs is not None:
            places = dict(zip(pairs.added.tolist(), pairs.baseline.tolist(), strict=True))
        for j, value in enumerate(result.quality.snr_db[label]):
            if j in places:
                decibel[row, places[j]] = value
    return Picture(
        "snr",
        "Energy of each mode over the noise, dB",
        f"A column is one mode, whatever its rank in a mass state. A triangle marks less than "
        f"{SNR_LIMIT_DB:.0f} dB: that run gives no information on that mode, which is "
        "normal as long as another run does.",
        WIDTH_IN,
        2.0 * _HEAD_IN + _ROW_IN * len(runs),
        partial(_draw_snr, runs, modes, decibel),
    )


def _draw_snr(runs: Texts, modes: Texts, decibel: Floats, figure: FigureBase) -> None:
    axes = figure.add_axes((0.19, 0.0, 0.8, 1.0 - 2.0 * _HEAD_IN / height_in(figure)))
    top = max(float(np.nanmax(decibel, initial=SNR_LIMIT_DB)), 2.0 * SNR_LIMIT_DB)
    _heat(axes, decibel, top, lambda v: f"{v:z.0f}")
    _label(axes, runs, [name.replace(" wheels ", " wheels\n") for name in modes])
    for i, j in np.argwhere(decibel < SNR_LIMIT_DB):
        axes.plot([j - 0.42], [i], "v", ms=3.0, color=PALETTE[2])


# Correlation --------------------------------------------------------------------------------------


def correlation_section(result: Identification) -> Section:
    """Return the correlation matrix."""
    blocks = (correlation_picture(result),) if result.correlation.names else ()
    lead = "Correlation coefficients of the parameters' errors."
    return Section("correlation", "Correlation", lead, blocks)


def correlation_picture(result: Identification) -> Picture:
    """Return the correlation matrix without its diagonal, which is 1."""
    names = result.correlation.names
    return Picture(
        "correlation",
        "Correlation of the errors",
        "Near +1 two parameters are wrong together, so that their ratio is known far "
        "better than either; near -1 their sum or product is.",
        WIDTH_IN,
        2.0 * _HEAD_IN + _ROW_IN * len(names),
        partial(_draw_correlation, names, result.correlation.matrix),
    )


def _draw_correlation(names: Texts, matrix: Floats, figure: FigureBase) -> None:
    axes = figure.add_axes((0.07, 0.0, 0.92, 1.0 - _HEAD_IN / height_in(figure)))
    values = np.where(np.eye(len(names), dtype=bool), np.nan, matrix)
    _heat(axes, values, 1.0, lambda r: f"{r:+.2f}".replace("0.", "."))
    _label(axes, names, names)


def _heat(axes: Axes, values: Floats, largest: float, text: Callable[[float], str]) -> None:
    """Write the numbers of a matrix, each on a cell whose opacity is its share of `largest`.

    Values above zero are blue, below zero orange.
    """
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Rectangle

    n, m = values.shape
    for i, j in np.argwhere(np.isfinite(values)):
        value = float(values[i, j])
        hue = PALETTE[1] if value > 0.0 else PALETTE[2]
        # At most half opaque: the number can be read on a light and on a dark page.
        opacity = round(0.5 * min(abs(value) / largest, 1.0), 2)
        corner = (j - 0.485, i - 0.485)
        axes.add_patch(Rectangle(corner, 0.97, 0.97, fc=to_rgba(hue, opacity), ec="none"))
        axes.text(j, i, text(value), ha="center", va="center", fontsize=7.0, color=INK)
    axes.set_xlim(-0.5, m - 0.5)
    axes.set_ylim(n - 0.5, -0.5)


def _label(axes: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    axes.set_yticks(range(len(rows)), rows, parse_math=False)
    axes.set_xticks(range(len(columns)), columns, fontsize=8.0)
    axes.xaxis.tick_top()
    axes.tick_params(length=0.0)
    for spine in axes.spines.values():
        spine.set_visible(False)


# The paper's chain --------------------------------------------------------------------------------


def closed_form_section(result: Identification) -> Section:
    """Return the closed form, compared with the likelihood."""
    title = "Closed form and likelihood"
    lead = (
        "The paper's chain (Eqs. 22-33) needs no start values and no iteration, but uses less of "
        "the data. It is compared with the likelihood as a check by another method."
    )
    chain = result.closed_form
    known = {name: e for name, e in result.parameters.items() if e.determined and name in chain}
    if not known:
        reason = result.closed_form_reason or "the decays determine none of its parameters"
        lead += f" It has no answer for this session: {reason}."
        return Section("closed_form", title, lead, ())
    names = tuple(name for name in chain if name in known)
    percent = np.array([(chain[name] / known[name].value - 1.0) * 100.0 for name in names])
    halves = np.array([half_percent(known[name]) for name in names])
    blocks: list[Block] = [
        Picture(
            "closed_form",
            "Closed form less likelihood",
            "A diamond outside the blue bar is an error of the closed form where the verdict is "
            "good: it is the less precise of the two.",
            WIDTH_IN,
            lines_height_in(len(names), 2),
            partial(_draw_closed_form, names, halves, percent),
        ),
        Table(
            "Both in numbers",
            ("", "parameter", "#closed form", "#likelihood", "#difference", "unit"),
            tuple(
                (
                    name,
                    parameter_words(name),
                    number(chain[name]),
                    number(known[name].value),
                    f"{apart:+.2f} %",
                    unit_text(known[name].unit),
                )
                for name, apart in zip(names, percent, strict=True)
            ),
        ),
    ]
    ways = tuple(
        (way, number(c["c_sf"]), number(c["c_sr"]))
        for way, c in result.closed_form_damping.items()
        if {"c_sf", "c_sr"} <= set(c)
    )
    if ways:
        heading = "Its damping by each way to the damping matrix, N s/m"
        blocks.append(Table(heading, ("way", "#c_sf", "#c_sr"), ways))
    return Section("closed_form", title, lead, tuple(blocks))


def _draw_closed_form(names: Texts, halves: Floats, percent: Floats, figure: FigureBase) -> None:
    n = len(names)
    (axes,) = line_axes(figure, n, (0.075,))
    interval_bars(axes, halves)
    axes.plot(percent, range(n), "D", ms=5.0, color=PALETTE[2], label="closed form (paper's chain)")
    axes.plot([], [], "s", ms=8.0, color=PALETTE[1], alpha=0.45, label="likelihood, 95 % interval")
    axes.set_yticks(range(n), names)
    axes.set_xlim(*about_zero(np.concatenate([percent, halves]), 1.1))
    axes.set_xlabel("difference from the likelihood's estimate, %")
    shared_legend(figure)


# A run left out -----------------------------------------------------------------------------------


def prediction_section(predictions: tuple[Prediction, ...]) -> Section:
    """Return each run predicted from all the others."""
    good = sum(p.at_noise for p in predictions)
    known = sum(bool(np.isfinite(p.predicted)) for p in predictions)
    lead = (
        "The vehicle is fitted on all other runs and must then predict the one that was left out; "
        "only the initial state and the sensors' offsets are the run's own. For a linear car what "
        "remains is noise; friction, a hot damper or a lifted wheel are not predicted. "
        f"Here {good} of {counted(known, 'run is', 'runs are')} predicted down to the noise."
    )
    if known < len(predictions):
        lead += f" For {len(predictions) - known} the others do not determine the vehicle."
    title = "A run left out and predicted"
    if not predictions:
        return Section("prediction", title, lead, ())
    picture = Picture(
        "prediction",
        "Fitted with all runs, and predicted from the others",
        "Grey: noise level, with five standard deviations of chance. A diamond far to the right of "
        "its circle is a run that the others do not predict.",
        WIDTH_IN,
        lines_height_in(len(predictions), 3),
        partial(_draw_predictions, predictions),
    )
    rows = []
    for p in predictions:
        tail: Texts = ("", "", "the others do not determine all parameters", "", "")
        if np.isfinite(p.predicted):
            state = "✓ at noise level" if p.at_noise else "✕ not predicted"
            tail = (number(p.predicted), number(p.limit), state, p.parameter, f"{p.moved:+.2f}")
        rows.append((p.label, number(p.fitted), *tail))
    table = Table(
        "chi2/n of each run",
        ("run", "#fitted", "#predicted", "#limit", "", "moves most", "#by sigma"),
        tuple(rows),
        "Moves most: the parameter that changes most when the run is left out, in standard "
        "deviations of such a change; beyond 4 the run shows another car than the others.",
    )
    return Section("prediction", title, lead, (picture, table))


def _draw_predictions(predictions: tuple[Prediction, ...], figure: FigureBase) -> None:
    n = len(predictions)
    fitted, predicted, limit = np.array([(p.fitted, p.predicted, p.limit) for p in predictions]).T
    (axes,) = line_axes(figure, n, (0.19,))
    place = np.arange(n)
    limit = np.where(np.isfinite(limit), limit, 1.0)
    axes.barh(place, limit - 1.0, 0.8, left=1.0, color=FAINT, alpha=0.7, label="noise level")
    axes.hlines(place, fitted, predicted, PALETTE[2], lw=1.4, alpha=0.6)
    axes.plot(fitted, place, "o", ms=5.0, mfc="white", color=PALETTE[1], label="fitted")
    axes.plot(predicted, place, "D", ms=4.5, color=PALETTE[2], label="predicted, left out")
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(place, [p.label for p in predictions])
    everything = np.concatenate([fitted, predicted, limit])
    high = float(np.nanmax(everything))
    if high > 3.0:
        axes.set_xscale("log")
        axes.set_xlim(0.8, high * 1.3)
    else:
        axes.set_xlim(min(0.9, float(np.nanmin(everything)) - 0.02), max(1.1, high + 0.02))
    axes.set_xlabel("chi2/n of the run's residuals; 1 = noise alone")
    shared_legend(figure)
