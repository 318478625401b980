"""What the numbers rest on: runs, noise, correlation, and the paper's chain beside them."""

from __future__ import annotations

import numpy as np

from ..identification import Identification
from ..trust.excitation import SNR_LIMIT_DB
from .blocks import Block, Cell, Picture, Section, Table
from .numbers import number
from .panels import ClosedFormPanel, CorrelationPanel, SnrPanel
from .words import parameter_words


def information_section(result: Identification) -> Section:
    """Return what each run contributed and how far each mode stands out of the noise in it."""
    blocks: list[Block] = []
    if result.quality.snr_db:
        blocks.append(_snr(result))
    if result.drivers:
        blocks.append(_drivers(result))
    if result.quality.chi2_by_run:
        blocks.append(_misfit(result))
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
        f"{SNR_LIMIT_DB:.0f} dB: that run says nothing of that mode, which is normal as long as "
        "another run does.",
        SnrPanel(tuple(result.quality.snr_db), tuple(result.mode_names[first]), rows, SNR_LIMIT_DB),
    )


def _drivers(result: Identification) -> Table:
    sources = dict.fromkeys(s for row in result.drivers.values() for s in row)
    labels = [label for label in result.quality.chi2_by_run if label in sources]
    names = list(result.drivers)
    rows = []
    for source in (*labels, *(s for s in sources if s not in labels)):
        cells = [
            Cell(f"{result.drivers[n][source] * 100:.1f}", f"drivers/{n}/{source}")
            if source in result.drivers[n]
            else Cell("")
            for n in names
        ]
        rows.append((Cell(source), *cells))
    return Table(
        "Share of each parameter's precision, %",
        ("run or fact", *(f"#{name}" for name in names)),
        tuple(rows),
        "Columns add up to 100 %: were a run worth 1 % more, the variance would fall by its share "
        "of 1 %.",
    )


def _misfit(result: Identification) -> Table:
    by_run = result.quality.chi2_by_run
    channels = list(dict.fromkeys(c for row in by_run.values() for c in row))
    rows = []
    for run, row in by_run.items():
        cells = [
            Cell(f"{row[c]:.3f}", f"chi2_by_run/{run}/{c}") if c in row else Cell("")
            for c in channels
        ]
        rows.append((Cell(run), *cells))
    return Table(
        "chi2/n of each run and channel",
        ("run", *(f"#{channel}" for channel in channels)),
        tuple(rows),
        "1 where the fit leaves noise alone.",
    )


def correlation_section(result: Identification) -> Section:
    """Return the correlation matrix."""
    blocks: tuple[Block, ...] = ()
    if result.correlation.names:
        blocks = (
            Picture(
                "correlation",
                "Correlation of the errors",
                "Near +1 two parameters are wrong together, so that their ratio is known far "
                "better than either; near -1 their sum or product is.",
                CorrelationPanel(result.correlation.names, result.correlation.matrix),
            ),
        )
    return Section(
        "correlation",
        "Correlation",
        "How the errors of the parameters hang together.",
        blocks,
    )


def closed_form_section(result: Identification) -> Section:
    """Return the closed form beside the likelihood."""
    names = [n for n in result.closed_form if n in result.parameters]
    lead = (
        "The paper's chain (Eqs. 22-33) needs no start values and no iteration, but uses less of "
        "the data. It stands beside the likelihood as a check by another way."
    )
    if not names:
        lead += " It has no answer for this session: it needs all seven modes in two mass states."
        return Section("closed_form", "Closed form beside likelihood", lead, ())
    pairs = [(result.closed_form[n], result.parameters[n]) for n in names]
    rows = [
        (
            Cell(name),
            Cell(parameter_words(name)),
            Cell(number(closed), f"closed_form/{name}"),
            Cell(number(e.value), f"parameters/{name}/value"),
            Cell(f"{(closed / e.value - 1.0) * 100:+.2f} %"),
            Cell("" if e.unit == "1" else e.unit),
        )
        for name, (closed, e) in zip(names, pairs, strict=True)
    ]
    columns = ("", "parameter", "#closed form", "#likelihood", "#difference", "unit")
    ways = [
        (
            Cell(way),
            *(Cell(number(c[n]), f"closed_form_damping/{way}/{n}") for n in ("c_sf", "c_sr")),
        )
        for way, c in result.closed_form_damping.items()
        if {"c_sf", "c_sr"} <= set(c)
    ]
    blocks: list[Block] = [
        Picture(
            "closed_form",
            "Closed form less likelihood",
            "A diamond outside the blue bar is an error of the closed form where the verdict is "
            "good: it is the less precise of the two.",
            ClosedFormPanel(
                tuple(names),
                np.array([(e.high - e.low) / 2 / abs(e.value) * 100 for _, e in pairs]),
                np.array([(closed / e.value - 1.0) * 100 for closed, e in pairs]),
            ),
        ),
        Table("Both in numbers", columns, tuple(rows)),
    ]
    if ways:
        title = "Its damping by each way to the damping matrix, N s/m"
        blocks.append(Table(title, ("way", "#c_sf", "#c_sr"), tuple(ways)))
    return Section("closed_form", "Closed form beside likelihood", lead, tuple(blocks))
