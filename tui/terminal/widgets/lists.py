"""Texts of the boxes of the home and the run screen: next action, sketch, runs, journal, alarms."""

from __future__ import annotations

from datetime import UTC, datetime
from statistics import fmean, stdev
from textwrap import wrap
from typing import TYPE_CHECKING

from rich.text import Text
from textual.content import Content

from daq.bench.campaign import sketch
from daq.control.messages import Status, Tally
from daq.errors import printable
from daq.runlog import LoggedRun, LoggedStatus

from ..state.campaign import NextAction, cause_words, obstacle, progress
from ..state.feed import Lost
from ..state.glyphs import Glyphs
from ..state.words import banner, reason_words
from .table import Cell, right

if TYPE_CHECKING:
    from daq.bench.config import Bench

_SHOWN = 200
"""Largest number of runs, and of entries of the journal, that are shown: the newest."""
_ALARM_ROWS, _ROWS_EACH = 4, 2
"""Rows of all alarms, and of each but the gravest, whose advice is shown completely."""
_SPACE = "bold $accent"


def next_text(
    status: Status | None, action: NextAction, lost: Lost | None, glyphs: Glyphs
) -> Content:
    """Return the next bump in words, and what SPACE does; without a recorder, how to start one."""
    if lost is not None:
        shown = banner(status, lost, action, glyphs)
        head = Content.styled(f"{shown.symbol} {shown.word}", "bold $error")
        words = Content.styled(shown.second, _SPACE)
        return Content("\n").join([head, Content(shown.first), Content(""), words])
    lines: list[Content] = []
    if status is None:
        lines = [Content("waiting for the recorder; to start it takes some seconds")]
    elif action.step is not None:
        lines = [Content.styled(f"{glyphs.now} Step {action.step.title}", "bold")]
    elif (alarm := obstacle(status)) is not None:
        name, advice, details = cause_words(alarm)
        head = Content.styled(f"{glyphs.bad} STOP  {name}", "bold $error")
        lines = [head, Content(advice), Content(details)]
    elif status.due is not None:
        due = status.due
        title = f"{due.step.mass_state.capitalize()} · {due.step.excitation.words.upper()}"
        count = f"run {min(due.accepted + 1, due.planned)} of {due.planned}"
        if due.accepted >= due.planned:
            count = f"run {due.accepted + 1}, {due.planned} were planned"
        lines = [
            Content.styled(f"{glyphs.now} {title}, {count}", "bold"),
            Content(printable(due.instruction, 300)),
        ]
    else:
        lines = [Content(f"step {progress(status).due.title}")]
    return Content("\n").join([*lines, Content(""), Content.styled(action.words, _SPACE)])


def sketch_text(status: Status, bench: Bench | None) -> Content:
    """Return the sketch of the bump that is due."""
    if bench is None or status.due is None:
        return Content("")
    return Content("\n".join(sketch(bench.campaign, status.due.step.excitation)))


def tally_rows(status: Status, glyphs: Glyphs) -> list[list[Cell]]:
    """Return accepted and planned runs of each kind, the one that is due marked."""
    due = status.due.step if status.due else None
    due_kind = (due.mass_state, due.excitation) if due else None
    rows: list[list[Cell]] = []
    for tally in status.tallies:
        accepted, planned = tally.accepted, tally.planned
        is_due = due_kind == (tally.mass_state, tally.excitation)
        kind = f"{glyphs.now if is_due else ' '} {tally.mass_state} {tally.excitation.words}"
        more = f" +{accepted - planned}" if accepted > planned else ""
        rejected = f"{tally.rejected} rejected: {_reasons(status, tally)}" if tally.rejected else ""
        rows.append(
            [
                Text(kind, "bold" if is_due else "", no_wrap=True),
                glyphs.bar(accepted, planned),
                right(f"{min(accepted, planned)}/{planned}{more}"),
                right(_frequency(status, tally)),
                rejected,
            ]
        )
    return rows


def _of_kind(status: Status, tally: Tally, state: LoggedStatus) -> list[LoggedRun]:
    kind = (tally.mass_state, tally.excitation, state)
    return [run for run in status.runs if (run.mass_state, run.excitation, run.status) == kind]


def _frequency(status: Status, tally: Tally) -> str:
    """Return the mean frequency of the accepted runs of a kind, with its scatter."""
    runs = _of_kind(status, tally, LoggedStatus.ACCEPTED)
    values = [f.value for run in runs for f in run.findings if f.code == "motion" and f.value > 0]
    if not values:
        return ""
    scatter = f" ± {stdev(values):.2f}" if len(values) > 1 else ""
    return f"{fmean(values):.2f}{scatter} Hz"


def _reasons(status: Status, tally: Tally) -> str:
    runs = _of_kind(status, tally, LoggedStatus.REJECTED)
    words = [reason_words(run.failed.code) if run.failed else "by hand" for run in runs]
    return printable(", ".join(dict.fromkeys(words)), 60)


def runs_text(status: Status, glyphs: Glyphs) -> Content:
    """Return the runs, the newest first: accepted with their figures, rejected with reasons."""
    lines = []
    for run in reversed(status.runs[-_SHOWN:]):
        name = f"{run.mass_state} {run.excitation.words} {run.repeat}"
        if run.status is LoggedStatus.OPEN:
            lines.append(Content.styled(f"{glyphs.now} running   {name}", "bold"))
        elif run.status is LoggedStatus.ACCEPTED:
            text = next((f.text for f in run.findings if f.code == "motion"), "")
            text += f"  taken by {run.by}: {run.reason}" if run.by and run.reason else ""
            mark = (f"{glyphs.good} accepted  ", "bold $success")
            lines.append(Content.assemble(mark, f"{name}  {printable(text.strip(), 160)}"))
        else:
            mark = (f"{glyphs.bad} rejected  ", "bold $error")
            why = printable("; ".join(run.reasons), 160)
            lines.append(Content.assemble(mark, f"{name}  {why}, kept"))
    return Content("\n").join(lines or [Content("no runs yet")])


def journal_text(status: Status) -> Content:
    """Return notes, overridden warnings and verdicts, the newest first."""
    entries = []
    for note in status.notes:  # a mark has no author
        about = f" on {note.label}" if note.label else ""
        text = f"note{about}: {note.text} ({note.by})" if note.by else note.text
        entries.append((note.t_ns, text))
    for o in status.overrides:
        entries.append((o.t_ns, f"WARN {o.subject} overridden by {o.by}: {o.reason}"))
    for run in status.runs:
        state = "is recorded" if run.status is LoggedStatus.OPEN else run.status.value
        entries.append((run.t_ns, f"{run.excitation.words} {run.repeat} {state}"))
    entries.sort(key=lambda entry: entry[0], reverse=True)
    lines = [f"{_clock_time(t_ns)}  {printable(text, 120)}" for t_ns, text in entries[:_SHOWN]]
    return Content("\n".join(lines) or "nothing yet")


def _clock_time(t_ns: int) -> str:
    """Return the time of day of a time stamp, in the terminal's time zone."""
    return datetime.fromtimestamp(t_ns * 1e-9, UTC).astimezone().strftime("%H:%M:%S")


def alarms_text(status: Status, glyphs: Glyphs, width: int) -> Content:
    """Return the alarms with their advice, which comes last and is never cut; empty without any."""
    alarms = [
        (
            f"{glyphs.warn} {printable(reason_words(alarm.code).upper(), 40)}",
            f"{printable(f'{alarm.subject}: ' if alarm.subject else '', 40)}"
            f"{printable(alarm.text, 120)}: {printable(alarm.advice, 120)}",
        )
        for alarm in status.alarms
    ]
    if status.overloaded:
        names = printable(", ".join(status.overloaded), 120)
        text = f"{names} touched the end of the range: A puts the lamp out"
        alarms.append((f"{glyphs.overload} OVERLOAD", text))
    rows: list[Content] = []
    for i, (head, text) in enumerate(alarms):
        first, *others = wrap(f"{head} {text}", width, subsequent_indent="  ")
        lines = [Content.assemble((head, "bold $error"), first.removeprefix(head))]
        most = _ROWS_EACH if i else _ALARM_ROWS - 1
        lines += map(Content, others[: most - 1])
        after = len(alarms) - i - 1
        most_rows = _ALARM_ROWS - 1 if after else _ALARM_ROWS  # the last one says `and 2 more`
        if len(rows) + len(lines) > most_rows:
            rows.append(Content(f"{glyphs.warn} and {after + 1} more"))
            break
        rows += lines
    return Content("\n").join(rows)
