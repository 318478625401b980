"""Sections that support the numbers: runs left out, noise, correlation, the paper's chain."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.words import counted

from ..estimate_text import Document, half_percent
from ..fit.cross_validation import Prediction
from ..result import Identification
from ..trust.motion import SNR_LIMIT_DB
from ..words import parameter_words, unit_text
from .blocks import Block, Cell, Picture, Section, Table, cited
from .figure import (
    FAINT,
    INK,
    PALETTE,
    WIDTH_IN,
    Drawing,
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

_HEAD_IN, _ROW_IN = 0.25, 0.215
_DARK = 0.62
"""Share of the range of colours beyond which the number is written in white."""
_BOTH_WAYS = (PALETTE[1], "#ffffff", PALETTE[2])
_ONE_WAY = ("#ffffff", "#7fb8d8", "#00507d")


def information_section(result: Identification, document: Document) -> Section:
    """Return each run's contribution, and how far each mode stands out of its noise."""
    blocks: list[Block] = []
    if document["snr_db"]:
        blocks.append(_snr(result))
    if document["drivers"]:
        blocks.append(_drivers(document))
    if document["chi2_by_run"]:
        blocks.append(_misfit(document))
    return Section(
        "information",
        "What each run contributed",
        "Which run shows which mode, and which run each parameter rests on.",
        tuple(blocks),
    )


def _snr(result: Identification) -> Picture:
    states = {r.label: r.mass_state for r in result.estimation.records} if result.estimation else {}
    first = next(iter(result.modal))
    columns = len(result.mode_names[first])
    rows = np.full((len(result.quality.snr_db), columns), np.nan)
    for row, (label, decibel) in enumerate(result.quality.snr_db.items()):
        places = {j: j for j in range(columns)}
        state = states.get(label, first)
        if state in result.pairings:
            pairing = result.pairings[state]
            pairs = zip(pairing.baseline.tolist(), pairing.added.tolist(), strict=True)
            places = {added: baseline for baseline, added in pairs}
        for j, value in enumerate(decibel):
            if j in places:
                rows[row, places[j]] = value
    return Picture(
        "snr",
        "Energy of each mode over the noise, dB",
        f"A column is one mode, whatever its rank in a mass state. A triangle marks less than "
        f"{SNR_LIMIT_DB:.0f} dB: that run gives no information on that mode, which is "
        "normal as long as another run does.",
        snr_drawing(tuple(result.quality.snr_db), tuple(result.mode_names[first]), rows),
    )


def _drivers(document: Document) -> Table:
    drivers = document["drivers"]
    sources = dict.fromkeys(s for row in drivers.values() for s in row)
    labels = [label for label in document["chi2_by_run"] if label in sources]
    names = list(drivers)
    rows = []
    for source in (*labels, *(s for s in sources if s not in labels)):
        cells = [
            cited(document, "drivers", n, source, form=_percent)
            if source in drivers[n]
            else Cell("")
            for n in names
        ]
        rows.append((Cell(source), *cells))
    return Table(
        "Share of each parameter's precision, %",
        ("run or fact", *(f"#{name}" for name in names)),
        tuple(rows),
        "Columns add up to 100 %: if a run had 1 % more information, the variance would fall by "
        "its share of 1 %.",
    )


def _percent(share: float) -> str:
    return f"{share * 100:.1f}"


def _misfit(document: Document) -> Table:
    by_run = document["chi2_by_run"]
    channels = list(dict.fromkeys(c for row in by_run.values() for c in row))
    rows = []
    for run, row in by_run.items():
        cells = [
            cited(document, "chi2_by_run", run, c, form="{:.3f}".format) if c in row else Cell("")
            for c in channels
        ]
        rows.append((Cell(run), *cells))
    return Table(
        "chi2/n of each run and channel",
        ("run", *(f"#{channel}" for channel in channels)),
        tuple(rows),
        "1 where the residuals are noise alone.",
    )


def correlation_section(document: Document) -> Section:
    """Return the correlation matrix."""
    blocks: tuple[Block, ...] = ()
    names, matrix = document["correlation"]["names"], document["correlation"]["matrix"]
    if names:
        blocks = (
            Picture(
                "correlation",
                "Correlation of the errors",
                "Near +1 two parameters are wrong together, so that their ratio is known far "
                "better than either; near -1 their sum or product is.",
                correlation_drawing(tuple(names), np.array(matrix)),
            ),
        )
    return Section(
        "correlation", "Correlation", "Correlation coefficients of the parameters' errors.", blocks
    )


def closed_form_section(document: Document) -> Section:
    """Return the closed form, compared with the likelihood."""
    known = {n for n, e in document["parameters"].items() if not e["reason"]}
    names = [n for n in document["closed_form"] if n in known]
    lead = (
        "The paper's chain (Eqs. 22-33) needs no start values and no iteration, but uses less of "
        "the data. It is compared with the likelihood as a check by another method."
    )
    if not names:
        reason = document["closed_form_reason"] or "the decays determine none of its parameters"
        lead += f" It has no answer for this session: {reason}."
        return Section("closed_form", "Closed form and likelihood", lead, ())
    estimates = [document["parameters"][n] for n in names]
    apart = [
        (document["closed_form"][n] / e["value"] - 1.0) * 100.0
        for n, e in zip(names, estimates, strict=True)
    ]
    rows = [
        (
            Cell(name),
            Cell(parameter_words(name)),
            cited(document, "closed_form", name),
            cited(document, "parameters", name, "value"),
            Cell(f"{percent:+.2f} %"),
            Cell(unit_text(e["unit"])),
        )
        for name, e, percent in zip(names, estimates, apart, strict=True)
    ]
    columns = ("", "parameter", "#closed form", "#likelihood", "#difference", "unit")
    ways = [
        (Cell(way), *(cited(document, "closed_form_damping", way, n) for n in ("c_sf", "c_sr")))
        for way, c in document["closed_form_damping"].items()
        if {"c_sf", "c_sr"} <= set(c)
    ]
    blocks: list[Block] = [
        Picture(
            "closed_form",
            "Closed form less likelihood",
            "A diamond outside the blue bar is an error of the closed form where the verdict is "
            "good: it is the less precise of the two.",
            closed_form_drawing(
                tuple(names), np.array([half_percent(e) for e in estimates]), np.array(apart)
            ),
        ),
        Table("Both in numbers", columns, tuple(rows)),
    ]
    if ways:
        title = "Its damping by each way to the damping matrix, N s/m"
        blocks.append(Table(title, ("way", "#c_sf", "#c_sr"), tuple(ways)))
    return Section("closed_form", "Closed form and likelihood", lead, tuple(blocks))


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
    blocks: list[Block] = []
    if predictions:
        blocks = [_prediction_picture(predictions), _prediction_table(predictions)]
    return Section("prediction", "A run left out and predicted", lead, tuple(blocks))


def prediction_data(predictions: tuple[Prediction, ...]) -> dict[str, object]:
    """Return the predictions as data."""
    return {
        "left_out": {
            p.label: {
                "fitted": p.fitted,
                "predicted": p.predicted,
                "limit": p.limit,
                "at_noise": p.at_noise,
                "parameter": p.parameter,
                "moved": p.moved,
            }
            for p in predictions
        }
    }


def _prediction_picture(predictions: tuple[Prediction, ...]) -> Picture:
    return Picture(
        "prediction",
        "Fitted with all runs, and predicted from the others",
        "Grey: noise level, with five standard deviations of chance. A diamond far to the right of "
        "its circle is a run that the others do not predict.",
        predictions_drawing(
            tuple(p.label for p in predictions),
            np.array([p.fitted for p in predictions]),
            np.array([p.predicted for p in predictions]),
            np.array([p.limit for p in predictions]),
        ),
    )


def _prediction_table(predictions: tuple[Prediction, ...]) -> Table:
    data = prediction_data(predictions)
    rows = []
    for p in predictions:
        if np.isfinite(p.predicted):
            state = "✓ at noise level" if p.at_noise else "✕ not predicted"
            tail = (
                cited(data, "left_out", p.label, "predicted"),
                cited(data, "left_out", p.label, "limit"),
                Cell(state),
                cited(data, "left_out", p.label, "parameter", form=str),
                cited(data, "left_out", p.label, "moved", form="{:+.2f}".format),
            )
        else:
            note = Cell("the others do not determine all parameters")
            tail = (Cell(""), Cell(""), note, Cell(""), Cell(""))
        rows.append((Cell(p.label), cited(data, "left_out", p.label, "fitted"), *tail))
    return Table(
        "chi2/n of each run",
        ("run", "#fitted", "#predicted", "#limit", "", "moves most", "#by sigma"),
        tuple(rows),
        "Moves most: the parameter that changes most when the run is left out, in standard "
        "deviations of such a change; beyond 4 the run shows another car than the others.",
    )


# Figures ------------------------------------------------------------------------------------------


def closed_form_drawing(
    names: tuple[str, ...], half_percent: Floats, apart_percent: Floats
) -> Drawing:
    """Return a drawing of the paper's results with the likelihood's intervals.

    `half_percent`, (n,): half of each 95 % interval.  `apart_percent`, (n,): closed form less
    likelihood; both in % of the likelihood's value.
    """
    draw = partial(_draw_closed_form, names, half_percent, apart_percent)
    return Drawing(WIDTH_IN, lines_height_in(len(names), 2), draw)


def _draw_closed_form(
    names: tuple[str, ...],
    half_percent: Floats,
    apart: Floats,
    figure: FigureBase,
) -> None:
    n = len(names)
    (axes,) = line_axes(figure, n, (0.075,))
    interval_bars(axes, half_percent)
    axes.plot(apart, range(n), "D", ms=5.0, color=PALETTE[2], label="closed form (paper's chain)")
    axes.plot([], [], "s", ms=8.0, color=PALETTE[1], alpha=0.45, label="likelihood, 95 % interval")
    axes.set_yticks(range(n), names)
    axes.set_xlim(*about_zero(np.concatenate([apart, half_percent]), 1.1))
    axes.set_xlabel("difference from the likelihood's estimate, %")
    shared_legend(figure)


def predictions_drawing(
    runs: tuple[str, ...], fitted: Floats, predicted: Floats, limit: Floats
) -> Drawing:
    """Return a drawing of chi2/n of each run, fitted and predicted, with the limit, each (n,)."""
    draw = partial(_draw_predictions, runs, fitted, predicted, limit)
    return Drawing(WIDTH_IN, lines_height_in(len(runs), 3), draw)


def _draw_predictions(
    runs: tuple[str, ...],
    fitted: Floats,
    predicted: Floats,
    limit: Floats,
    figure: FigureBase,
) -> None:
    n = len(runs)
    (axes,) = line_axes(figure, n, (0.19,))
    place = np.arange(n)
    limit = np.where(np.isfinite(limit), limit, 1.0)
    axes.barh(place, limit - 1.0, 0.8, left=1.0, color=FAINT, alpha=0.7, label="noise level")
    axes.hlines(place, fitted, predicted, PALETTE[2], lw=1.4, alpha=0.6)
    axes.plot(fitted, place, "o", ms=5.0, mfc="white", color=PALETTE[1], label="fitted")
    axes.plot(predicted, place, "D", ms=4.5, color=PALETTE[2], label="predicted, left out")
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(place, runs)
    everything = np.concatenate([fitted, predicted, limit])
    high = float(np.nanmax(everything))
    if high > 3.0:
        axes.set_xscale("log")
        axes.set_xlim(0.8, high * 1.3)
    else:
        axes.set_xlim(min(0.9, float(np.nanmin(everything)) - 0.02), max(1.1, high + 0.02))
    axes.set_xlabel("chi2/n of the run's residuals; 1 = noise alone")
    shared_legend(figure)


def correlation_drawing(names: tuple[str, ...], matrix: Floats) -> Drawing:
    """Return a drawing of the correlation matrix, (n, n), without its diagonal, which is 1."""
    draw = partial(_draw_correlation, names, matrix)
    return Drawing(WIDTH_IN, 2.0 * _HEAD_IN + _ROW_IN * len(names), draw)


def _draw_correlation(names: tuple[str, ...], matrix: Floats, figure: FigureBase) -> None:
    n = len(names)
    height = height_in(figure)
    axes = figure.add_axes((0.07, 0.0, 0.92, 1.0 - _HEAD_IN / height))
    values = np.where(np.eye(n, dtype=bool), np.nan, matrix)
    texts = [[f"{v:+.2f}".replace("0.", ".") if np.isfinite(v) else "" for v in r] for r in values]
    _heat(axes, values, _BOTH_WAYS, (-1.0, 1.0), texts)
    _label(axes, names, names)


def snr_drawing(runs: tuple[str, ...], modes: tuple[str, ...], decibel: Floats) -> Drawing:
    """Return a drawing of the energy of each mode in each run, (n_runs, n_modes), NaN for none."""
    draw = partial(_draw_snr, runs, modes, decibel)
    return Drawing(WIDTH_IN, 2.0 * _HEAD_IN + _ROW_IN * len(runs), draw)


def _draw_snr(
    runs: tuple[str, ...], modes: tuple[str, ...], decibel: Floats, figure: FigureBase
) -> None:
    n, m = len(runs), len(modes)
    height = height_in(figure)
    axes = figure.add_axes((0.19, 0.0, 0.8, 1.0 - 2.0 * _HEAD_IN / height))
    texts = [[f"{v:z.0f}" if np.isfinite(v) else "" for v in row] for row in decibel]
    top = max(float(np.nanmax(decibel, initial=SNR_LIMIT_DB)), 2.0 * SNR_LIMIT_DB)
    _heat(axes, decibel, _ONE_WAY, (0.0, top), texts)
    _label(axes, runs, [name.replace(" wheels ", " wheels\n") for name in modes])
    for i in range(n):
        for j in range(m):
            if decibel[i, j] < SNR_LIMIT_DB:
                axes.plot([j - 0.42], [i], "v", ms=3.0, color=PALETTE[2])


def _heat(
    axes: Axes,
    values: Floats,
    colours: Sequence[str],
    limits: tuple[float, float],
    texts: Sequence[Sequence[str]],
) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    low, high = limits
    between = LinearSegmentedColormap.from_list("colours", colours)
    n, m = values.shape
    axes.pcolormesh(
        np.arange(m + 1) - 0.5, np.arange(n + 1) - 0.5, np.ma.masked_invalid(values), cmap=between,
        vmin=low, vmax=high, edgecolors="white", linewidth=0.8,
    )  # fmt: skip
    away = np.abs(values) / max(abs(low), abs(high))
    for i, row in enumerate(texts):
        for j, text in enumerate(row):
            colour = "white" if away[i, j] > _DARK else INK
            axes.text(j, i, text, ha="center", va="center", fontsize=7.0, color=colour)
    axes.set_ylim(n - 0.5, -0.5)


def _label(axes: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    axes.set_yticks(range(len(rows)), rows, parse_math=False)
    axes.set_xticks(range(len(columns)), columns, fontsize=8.0)
    axes.xaxis.tick_top()
    axes.tick_params(length=0.0)
    for spine in axes.spines.values():
        spine.set_visible(False)
