"""Sections that support the numbers: runs, noise, correlation, and the paper's chain."""

from __future__ import annotations

import numpy as np

from ..document import Document, unit_text
from ..estimate_text import half_percent
from ..identification import Identification
from ..trust.excitation import SNR_LIMIT_DB
from .blocks import Block, Cell, Picture, Section, Table, cited
from .panels import ClosedFormPanel, CorrelationPanel, SnrPanel
from .words import parameter_words


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
        SnrPanel(tuple(result.quality.snr_db), tuple(result.mode_names[first]), rows, SNR_LIMIT_DB),
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
                CorrelationPanel(tuple(names), np.array(matrix)),
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
            ClosedFormPanel(
                tuple(names), np.array([half_percent(e) for e in estimates]), np.array(apart)
            ),
        ),
        Table("Both in numbers", columns, tuple(rows)),
    ]
    if ways:
        title = "Its damping by each way to the damping matrix, N s/m"
        blocks.append(Table(title, ("way", "#c_sf", "#c_sr"), tuple(ways)))
    return Section("closed_form", "Closed form and likelihood", lead, tuple(blocks))
