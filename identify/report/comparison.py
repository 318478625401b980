"""A comparison of sessions as a page."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from dbc.words import counted

from ..change import Change
from ..compare import Compared, Comparison
from ..fit.uncertainty import COVERAGE_95
from ..numbers import NOT_DETERMINED, half_width, plus_minus, rounded, signed
from ..words import NOT_OK, unit_text, value_text
from .page import Block, Section, Table
from .typeset import page_html

METHOD = (
    "What changed is found by one joint fit of all sessions: every parameter, and every element "
    "that all of them have, is common to them unless the data ask for a difference; of all small "
    "sets of differences, the one is named that explains most for its number. In addition, each "
    "quantity is compared by itself, from fits that share nothing. Every session is compared with "
    "the first one named. The errors of two "
    "sessions are taken as independent; facts and weights stated alike in both have errors in "
    "common, which makes the standard deviation of a difference too large rather than too small. "
    "Differences are significant at 95 % among all that are listed (Holm)."
)


def comparison_html(comparison: Comparison) -> str:
    """Typeset a comparison of sessions, with its JSON document as data, as HTML."""
    return page_html(
        "comparison.jinja",
        {"comparison": comparison.document()},
        sections=comparison_sections(comparison),
        comparison=comparison,
        headline=headline_of(comparison),
    )


def comparison_sections(comparison: Comparison) -> tuple[Section, ...]:
    """Return the section of the differences, and with more than two sessions that of the trends."""
    labels, verdicts = comparison.labels, comparison.verdicts
    sessions = tuple(
        (str(i), label, verdict)
        for i, (label, verdict) in enumerate(zip(labels, verdicts, strict=True), start=1)
    )
    note = "" if set(verdicts) == {"ok"} else NOT_OK
    blocks: list[Block] = [Table("Sessions", ("#", "session", "verdict"), sessions, note)]
    if comparison.change is not None:
        blocks.append(change_table(comparison.change))
    for title, heading, texts, cell in (
        ("Stated differently: is it one car, with its sensors in their places?", "what",
         comparison.unlike, ""),
        ("Stated alike in all sessions: errors in common", "what", comparison.common, ""),
        ("Not compared: a session does not determine it", "", comparison.open, NOT_DETERMINED),
    ):  # fmt: skip
        if texts:
            blocks.append(Table(title, (heading, ""), tuple((text, cell) for text in texts)))
    for i, label in enumerate(labels[1:]):
        for title, rows in (
            ("Parameters", comparison.parameters),
            ("Forces (damper; corner: with friction)", comparison.forces),
            ("Modes", comparison.modes),
        ):
            if rows:
                title = f"{title}: {label} minus {labels[0]}"
                blocks.append(_differences_table(title, rows, i))
    differences = Section("differences", "Differences", METHOD, tuple(blocks))
    return (differences, _trends(comparison)) if len(labels) > 2 else (differences,)


def _differences_table(title: str, rows: Sequence[Compared], i: int) -> Table:
    """Return the differences of quantities from the first session to follower `i`, from 0."""
    columns = ("", "#first", "#this", "#difference", "#±", "#z", "at 95 %", "unit")
    texts = []
    for row in rows:
        first, this, d = row.estimates[0], row.estimates[i + 1], row.differences[i]
        half = COVERAGE_95 * d.std
        values = (value_text(first), value_text(this), signed(d.value, half))
        answer = "✓ differs" if d.significant else "· within chance"
        z, unit = f"{d.z:+.2f}", unit_text(first.unit)
        texts.append((row.name, *values, half_width(0.0, half), z, answer, unit))
    return Table(title, columns, tuple(texts))


def _trends(comparison: Comparison) -> Section:
    """Return slope and constancy of each quantity over the sessions."""
    trends = [(row, row.trend) for row in comparison.quantities if row.trend is not None]
    rows = []
    for row, trend in trends:
        slope = plus_minus(trend.slope, COVERAGE_95 * trend.slope_std)
        unit = unit_text(row.estimates[0].unit)
        drift = "✓ drifts" if trend.drifts else "· none"
        constancy = "✓ varies" if trend.varies else "· constant"
        rows.append(
            (row.name, slope, unit, drift, f"{trend.chi2:.1f} / {trend.freedom}", constancy)
        )
    columns = ("", "#per session", "unit", "slope at 95 %", "#chi2 / n", "constancy at 95 %")
    return Section(
        "trend",
        "Trend over the sessions",
        "Value against session in the order given: a weighted straight line, and how badly one "
        "constant value fits (chi2). Equal steps from session to session are assumed.",
        (Table("Slopes and constancy", columns, tuple(rows)),),
    )


def headline_of(comparison: Comparison) -> str:
    """Return what the joint fit and the quantities by themselves show, in a sentence or two."""
    change, rows = comparison.change, comparison.quantities
    differing = ", ".join(
        row.name
        for row in rows
        if (row.trend and (row.trend.drifts or row.trend.varies))
        or any(d.significant for d in row.differences)
    )
    if differing:
        quantities = f"at 95 % among all {len(rows)} quantities, these differ: {differing}"
        alone = f"Each by itself, {quantities}."
    elif change is not None and change.outcome == "nothing" and not change.apart:
        return f"Nothing differs beyond chance: neither by the joint fit, nor any of {len(rows)}."
    else:
        alone = f"Each by itself, none of {len(rows)} quantities differs beyond chance."
    return f"{change.sentence} {alone}" if change is not None else alone


# What changed -------------------------------------------------------------------------------------


def unchanged_line(change: Change) -> str:
    """Return the test that all else is unchanged, in one line."""
    if change.outcome == "not compared":
        return "Each quantity is compared by itself."
    unchanged = "all else" if change.outcome == "parameters" else "everything"
    if change.apart:
        unchanged = f"{unchanged} that all sessions have"
    freedom = f"{counted(change.rest_freedom, 'degree')} of freedom"
    return (
        f"Test that {unchanged} is unchanged: chi2 {change.rest_chi2:,.1f} on {freedom},"
        f" chance {_chance_text(change.rest_p)}."
    )


def change_table(change: Change) -> Table:
    """Return the named changes from the first session, with intervals, as a table."""
    title, note = "What changed, by one joint fit", unchanged_line(change)
    if not change.named:
        return Table(title, ("what changed", ""), ((change.sentence, ""),), note)
    rows = []
    for named in change.named:
        name = ", or instead ".join((named.name, *named.instead))
        pairs = zip(named.changes, named.shares, strict=True)
        for session, (e, share) in enumerate(pairs, start=2):  # share: of the first one's value
            half = e.high - e.value
            _, low, high = rounded(e.value, e.low, e.high)
            half_share = abs(half / e.value * share) if e.value else 0.0
            row_name = name if len(named.changes) == 1 else f"{name}, session {session}"
            by, unit, chance = signed(e.value, half), unit_text(e.unit), _chance_text(named.p)
            percent = "" if isnan(share) else f"{signed(100.0 * share, 100.0 * half_share)} %"
            rows.append((row_name, named.kind, by, low, high, unit, percent, chance))
    columns = ("what changed", "", "#by", "#from", "#to", "unit", "#share", "#chance")
    return Table(title, columns, tuple(rows), note)


def _chance_text(p: float) -> str:
    """Write a chance; one that is too small to matter is written as a bound."""
    return f"{p:.2g}" if p >= 1e-9 else "below 1e-09"
