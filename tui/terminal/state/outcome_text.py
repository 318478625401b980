"""Lines of text on an identification; a state is a word and a symbol, never only a colour.

Every function returns plain text; nothing in it is markup, and foreign names are made printable.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from textwrap import wrap

from daq.errors import printable
from dbc import counted

from ...jobs.outcome import Estimated, Outcome, RunOutcome, StateOutcome
from .glyphs import Glyphs, GlyphSet

_BAR = 11
_NARROW = 100
_DOF = ("heave", "pitch", "roll", "FL", "FR", "RL", "RR")
"""As `daq.vehicle.DOF`."""
_OPEN = "not determined"
_SEVERITY = {"refused": "REFUSED", "doubtful": "DOUBT", "ok": "note"}


def mark(verdict: str, glyphs: Glyphs) -> str:
    """Return the symbol of a verdict or severity."""
    return {"ok": glyphs.good, "accepted": glyphs.good, "doubtful": glyphs.warn}.get(
        verdict, glyphs.bad
    )


def verdict_lines(outcome: Outcome, glyphs: Glyphs, width: int, most: int) -> list[str]:
    """Return the verdict in words, then its gravest reasons with advice, at most `most` lines."""
    word = outcome.verdict.upper()
    runs = f"{outcome.used} of {counted(len(outcome.runs), 'run')} used"
    fit = f"   chi2/n {outcome.chi2_per_n:.3f}" if isfinite(outcome.chi2_per_n) else ""
    head = f"{mark(outcome.verdict, glyphs)} {word}  {outcome.headline}"
    tail = f"{runs}{fit}"
    if outcome.without:
        tail += f"   trial without {printable(', '.join(outcome.without), 40)}"
    lines = [f"{head}   {tail}"] if len(head) + len(tail) + 3 <= width else [head, f"  {tail}"]
    grave = [finding for finding in outcome.findings if finding.severity != "ok"]
    rest = [finding for finding in outcome.findings if finding.severity == "ok"]
    for finding in (*grave, *(() if grave else rest)):
        lines += finding_lines(finding.severity, finding.text, glyphs, width)
    if not outcome.findings:
        lines += wrap(outcome.meaning, width - 2, initial_indent="  ", subsequent_indent="  ")
    if len(lines) > most:
        hidden = len(lines) - most + 1
        more = counted(hidden, "more line")
        lines = [*lines[: most - 1], f"  ... {more}: Tab to Findings"]
    return lines


def finding_lines(severity: str, text: str, glyphs: Glyphs, width: int) -> list[str]:
    """Return one finding, folded."""
    symbol = "·" if severity == "ok" else mark(severity, glyphs)
    symbol = "-" if glyphs.name is GlyphSet.ASCII and severity == "ok" else symbol
    head = f"{symbol} {_SEVERITY.get(severity, severity)}: "
    return wrap(head + printable(text, 1000), width, subsequent_indent="    ")


def findings_lines(outcome: Outcome, glyphs: Glyphs, width: int) -> list[str]:
    """Return all findings, and the warnings that a person overrode."""
    lines = [*wrap(outcome.meaning, width), ""]
    for finding in outcome.findings:
        lines += finding_lines(finding.severity, finding.text, glyphs, width)
    if not outcome.findings:
        lines.append(f"{glyphs.good} nothing was found that speaks against the result")
    if outcome.survival:
        lines += ["", "Which parameters can be used:"]
        for text in outcome.survival:
            lines += wrap(f"  {printable(text, 700)}", width, subsequent_indent="    ")
    lines += ["", "Warnings of the bench check that a person overrode:"]
    if not outcome.overrides:
        lines.append("  none")
    for text in outcome.overrides:
        lines += wrap(f"{glyphs.warn} {printable(text, 700)}", width, subsequent_indent="    ")
    return lines


def bar(half_percent: float | None, widest: float, glyphs: Glyphs) -> str:
    """Draw a 95 % interval about its value; the widest of a table fills the bar."""
    plain = glyphs.name is GlyphSet.ASCII
    if half_percent is None:
        return "given".center(_BAR)
    reach = _BAR // 2
    cells = reach
    if isfinite(half_percent) and widest > 0.0:
        cells = max(0, min(reach, round(reach * half_percent / widest)))
    arm = "-" if plain else "─"
    point = "*" if plain else "●"
    space = " " * (reach - cells)
    left = ("|" if plain else "├") + arm * (cells - 1) if cells else ""
    right = arm * (cells - 1) + ("|" if plain else "┤") if cells else ""
    return f"{space}{left}{point}{right}{space}"


def parameter_lines(
    rows: tuple[Estimated, ...], title: str, glyphs: Glyphs, width: int
) -> list[str]:
    """Return quantities with their 95 % intervals, as numbers and as bars."""
    halves = [row.half_percent for row in rows]
    widest = max((half for half in halves if half is not None and isfinite(half)), default=0.0)
    wide = width >= _NARROW
    full = f"bar ±{widest:.2g} %"
    head = f"{title:<30}{'value':>10} {'':<6}{'95 % interval':>19} "
    head += f"{'±':>8}  {full:<18} rests mostly on" if wide else f"{full:>11}"
    lines = [head]
    for row, half in zip(rows, halves, strict=True):
        symbol = "" if row.words == row.name.replace("_", " ") else f"{row.name:<5}"
        interval = row.interval if half is None or isfinite(half) else _OPEN
        words = (symbol + row.words)[:29]
        text = f"{words:<30}{row.value:>10} {row.unit:<6}{interval:>19} "
        drawn = bar(half, widest, glyphs)
        if wide:
            text += f"{row.share:>8}  {drawn:<18} {row.rests_on}"
        else:
            text = f"{text:<67}{drawn}"
        lines.append(text[:width].rstrip())
    return lines


def mode_lines(states: tuple[StateOutcome, ...], width: int) -> list[str]:
    """Return the modes of every mass state with their 95 % intervals."""
    lines: list[str] = []
    for state in states:
        title = f"Mass state {printable(state.name, 20)}"
        if lines:
            lines.append("")
        lines.append(f"{title:<30}{'Hz':>9}{'± 95 %':>10}{'damping ratio':>16}{'± 95 %':>10}")
        for i, mode in enumerate(state.modes, start=1):
            pairs = (
                (mode.frequency_hz, mode.frequency_half_hz),
                (mode.damping_ratio, mode.damping_ratio_half),
            )
            lines.append(f"  {i} {mode.name:<26}" + "".join(map(_mode_cells, pairs, (9, 16))))
    return [line[:width] for line in lines]


def _mode_cells(pair: tuple[str, str], width: int) -> str:
    value, half = pair
    if not half:
        return f"{value:>{width + 10}}"
    return f"{value:>{width}}{half:>10}"


def matrix_lines(states: tuple[StateOutcome, ...], width: int) -> list[str]:
    """Return M, C and K of every mass state, SI."""
    lines: list[str] = []
    if not all(state.mass for state in states):
        return ["No matrices: a parameter in them is not determined (see Findings)."[:width]]
    for state in states:
        for letter, unit, matrix in (
            ("M", "kg, kg m²", state.mass),
            ("C", "N s/m, N m s/rad", state.damping),
            ("K", "N/m, N m/rad", state.stiffness),
        ):
            title = f"{letter} {printable(state.name, 12)}"
            if lines:
                lines.append("")
            lines.append(f"{title:<12}" + "".join(f"{dof:>9}" for dof in _DOF) + f"   {unit}")
            for dof, row in zip(_DOF, matrix, strict=True):
                cells = "".join(f"{_short(value):>9}" for value in row)
                lines.append(f"{dof:>10}  {cells}")
    return [line[:width].rstrip() for line in lines]


def _short(value: float) -> str:
    return "0" if abs(value) < 1e-9 else f"{value:.5g}" if abs(value) < 1e4 else f"{value:,.0f}"


def run_lines(runs: Sequence[RunOutcome], glyphs: Glyphs) -> list[str]:
    """Return one line for each run of the result."""
    labels = [printable(run.label, 40) for run in runs]
    width = max(map(len, labels), default=0)
    lines = []
    for run, label in zip(runs, labels, strict=True):
        fit = f"  chi2/n {run.chi2_per_n:.2f}" if isfinite(run.chi2_per_n) else ""
        used = "" if run.status == "accepted" else f"  {run.status.upper()}"
        lines.append(f"{mark(run.status, glyphs)} {label:<{width}}{used}{fit}".rstrip())
    return lines
