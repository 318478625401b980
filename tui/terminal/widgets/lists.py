"""Boxes of the home and the run screen: next action, sketch, tallies, runs, journal, alarms."""

from __future__ import annotations

from datetime import UTC, datetime
from statistics import fmean, stdev
from textwrap import wrap
from typing import TYPE_CHECKING

from textual.content import Content

from daq.bench.campaign import sketch
from daq.control.messages import Status, Tally
from daq.errors import printable
from daq.runlog import LoggedRun, LoggedStatus

from ..state.campaign import NextAction, cause_words, obstacle, progress
from ..state.feed import Lost
from ..state.glyphs import Glyphs
from ..state.words import banner, proposal_words, reason_words
from .bars import DrawnWords, Words

if TYPE_CHECKING:
    from daq.bench.config import Bench

_NAMED = 2
"""Largest number of runs that are named; the list of runs names all."""


class NextPanel(DrawnWords):
    """The next bump in words, and what SPACE does."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "Next"

    def show(self, status: Status | None, action: NextAction, lost: Lost | None) -> None:
        """Show the next action; without a recorder, that is to start one."""
        if lost is not None:
            shown = banner(status, lost, action, self._glyphs)
            head = Content.assemble((f"{shown.symbol} {shown.word}", "bold $error"))
            words = Content.assemble((shown.second, "bold $accent"))
            self.say(Content("\n").join([head, Content(shown.first), Content(""), words]))
            return
        lines: list[Content] = []
        if status is None:
            lines = [Content("waiting for the recorder; to start it takes some seconds")]
        elif action.step is not None:
            lines = [Content.assemble((f"{self._glyphs.now} Step {action.step.title}", "bold"))]
        elif (alarm := obstacle(status)) is not None:
            name, advice, details = cause_words(alarm)
            head = Content.assemble((f"{self._glyphs.bad} STOP  {name}", "bold $error"))
            lines = [head, Content(advice), Content(details)]
        elif status.due is not None:
            due = status.due
            title = f"{due.step.mass_state.capitalize()} · {due.step.excitation.words.upper()}"
            count = f"run {min(due.accepted + 1, due.planned)} of {due.planned}"
            if due.accepted >= due.planned:
                count = f"run {due.accepted + 1}, {due.planned} were planned"
            lines = [
                Content.assemble((f"{self._glyphs.now} {title}, {count}", "bold")),
                Content(printable(due.instruction, 300)),
            ]
        else:
            lines = [Content(f"step {progress(status).due.title}")]
        lines += [Content(line) for line in _unlike(status)]
        lines += [Content(""), Content.assemble((action.words, "bold $accent"))]
        self.say(Content("\n").join(lines))


def _unlike(status: Status | None) -> list[str]:
    """Return the runs that differ from the others, in what, and the key that leaves them out."""
    if status is None or not status.proposed:
        return []
    runs = [f"  {run.label}: {printable(run.text, 120)}" for run in status.proposed[:_NAMED]]
    return [proposal_words(status), *runs]


class SketchBox(Words):
    """The sketch of the bump that is due."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "How to bump"

    def show(self, status: Status, bench: Bench | None) -> None:
        """Show the sketch of the bump that is due."""
        if bench is None or status.due is None:
            self.say(Content(""))
            return
        lines = sketch(bench.campaign, status.due.step.excitation)
        self.border_title = f"How to bump: {status.due.step.excitation.words}"
        self.say(Content("\n".join(lines)))


_KEPT = 200
_ALARM_ROWS = 4
_ROWS_EACH = 2
"""Rows of each alarm except the gravest, whose advice is shown completely."""
_WITH_REASONS = 48


def clock_time(t_ns: int) -> str:
    """Return the time of day of a time stamp, in the terminal's time zone."""
    return datetime.fromtimestamp(t_ns * 1e-9, UTC).astimezone().strftime("%H:%M:%S")


class TallyList(DrawnWords):
    """Accepted and planned runs of each kind, the one that is due marked; up and down choose."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "Progress"

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__(glyphs)
        self.chosen = 0
        self._status: Status | None = None

    def on_resize(self) -> None:
        """Fit the tallies into the new width."""
        if self._status is not None:
            self.show(self._status)

    def move(self, by: int, status: Status) -> None:
        """Choose another kind of bump."""
        self.chosen = min(max(self.chosen + by, 0), max(0, len(status.tallies) - 1))
        self.show(status)

    def show(self, status: Status) -> None:
        """Show the tallies."""
        self._status = status
        lines = []
        wide = self.size.width > _WITH_REASONS
        reasons = _reasons(status)
        due = status.due.step if status.due else None
        name = max((len(tally.excitation.words) for tally in status.tallies), default=0) + 1
        for i, tally in enumerate(status.tallies):
            here = due is not None and (tally.mass_state, tally.excitation) == (
                due.mass_state,
                due.excitation,
            )
            bar = self._glyphs.bar(tally.accepted, tally.planned)
            more = f" +{tally.accepted - tally.planned}" if tally.accepted > tally.planned else ""
            pointer = ">" if i == self.chosen else " "
            sign = self._glyphs.now if here else " "
            words = f"{pointer}{sign} {tally.mass_state:<9}{tally.excitation.words:<{name}} {bar}  "
            count = f"{min(tally.accepted, tally.planned)}/{tally.planned}{more}"
            why = reasons.get((tally.mass_state, tally.excitation.value), "") if wide else ""
            measured = _frequency(status, tally, wide)
            word = "rejected" if wide or not measured else "rej."
            rejected = f"  {tally.rejected} {word}  {why}".rstrip() if tally.rejected else ""
            room = self.size.width - len(words) - len(count)
            if len(measured) + len(rejected) > room:
                measured = ""  # the rejects are more important
            if len(rejected) > room:
                rejected = rejected.removesuffix(why).rstrip()
            lines.append(
                Content.assemble(
                    (f"{words}{count}", "bold" if here else ""), f"{measured}{rejected}"
                )
            )
        self.say(Content("\n").join(lines))


class RunList(DrawnWords):
    """The runs, the newest on top: accepted with their figures, rejected with their reasons."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "Runs"

    def show(self, status: Status) -> None:
        """Show the runs."""
        lines = []
        unlike = {run.label: run.text for run in status.proposed}
        for run in reversed(status.runs[-_KEPT:]):
            name = f"{run.mass_state} {run.excitation.words} {run.repeat}"
            if run.status is LoggedStatus.OPEN:
                lines.append(Content.assemble((f"{self._glyphs.now} running   {name}", "bold")))
            elif run.status is LoggedStatus.ACCEPTED:
                mark = (f"{self._glyphs.good} accepted  ", "bold $success")
                text = run_figures(run)
                if run.label in unlike:
                    text = f"unlike the others: {printable(unlike[run.label], 160)}"
                lines.append(Content.assemble(mark, f"{name}  {text}"))
            else:
                mark = (f"{self._glyphs.bad} rejected  ", "bold $error")
                why = printable("; ".join(run.reasons), 160)
                lines.append(Content.assemble(mark, f"{name}  {why}, kept"))
        self.say(Content("\n").join(lines or [Content("no runs yet")]))


class Journal(Words):
    """Notes, overridden warnings and verdicts, the newest on top."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "Journal"

    def show(self, status: Status) -> None:
        """Show what happened."""
        entries = [(note.t_ns, _note(note.text, note.label, note.by)) for note in status.notes]
        entries += [
            (o.t_ns, f"WARN {o.subject} overridden by {o.by}: {o.reason}") for o in status.overrides
        ]
        entries += [
            (run.t_ns, f"{run.excitation.words} {run.repeat} {_state(run)}") for run in status.runs
        ]
        entries.sort(key=lambda entry: entry[0], reverse=True)
        lines = [f"{clock_time(t_ns)}  {printable(text, 120)}" for t_ns, text in entries[:_KEPT]]
        self.say(Content("\n".join(lines) if lines else "nothing yet"))


class AlarmList(DrawnWords):
    """Active alarms with their advice; hidden without any, and while no recorder answers."""

    def show(self, status: Status | None) -> None:
        """Show the alarms of a status; none without a recorder that answers."""
        if status is None:
            self.display = False
            return
        alarms = [
            (
                f"{self._glyphs.warn} {printable(reason_words(alarm.code).upper(), 40)}",
                f"{printable(f'{alarm.subject}: ' if alarm.subject else '', 40)}"
                f"{printable(alarm.text, 120)}: {printable(alarm.advice, 120)}",
            )
            for alarm in status.alarms
        ]
        if status.overloaded:
            many = len(status.overloaded) > 1
            ends = "the end of their range: A puts the lamps" if many else "the end of its range"
            lamps = ends if many else f"{ends}: A puts the lamp"
            names = printable(", ".join(status.overloaded), 120)
            alarms.append((f"{self._glyphs.overload} OVERLOAD", f"{names} touched {lamps} out"))
        self.display = bool(alarms)
        self.say(Content("\n").join(self._rows(alarms, self.size.width or self.app.size.width)))

    def _rows(self, alarms: list[tuple[str, str]], width: int) -> list[Content]:
        """Fold long texts: the advice comes last and must not be cut off."""
        rows: list[Content] = []
        for i, (head, text) in enumerate(alarms):
            first, *rest = wrap(f"{head} {text}", width, subsequent_indent="  ")
            lines = [Content.assemble((head, "bold $error"), first.removeprefix(head))]
            lines += [Content(line) for line in rest[: (_ROWS_EACH if i else _ALARM_ROWS - 1) - 1]]
            last = i == len(alarms) - 1
            if len(rows) + len(lines) > _ALARM_ROWS - (not last):
                return [*rows, Content(f"{self._glyphs.warn} and {len(alarms) - i} more")]
            rows += lines
        return rows


def run_figures(run: LoggedRun) -> str:
    """Return the measured figures of a run, as far as the verdict has them."""
    figures = next((f.text for f in run.findings if f.code == "motion"), "")
    taken = f"taken by {run.by}: {run.reason}" if run.by and run.reason else ""
    return printable("  ".join(part for part in (figures, taken) if part), 160)


def _frequency(status: Status, tally: Tally, wide: bool) -> str:
    """Return the mean frequency of the accepted runs of a kind, with its scatter if there is room.

    `status` and `tally`: the recording, and the kind of bump.
    """
    kind = (tally.mass_state, tally.excitation)
    found = [
        finding.value
        for run in status.runs
        if run.status is LoggedStatus.ACCEPTED and (run.mass_state, run.excitation) == kind
        for finding in run.findings
        if finding.code == "motion" and finding.value > 0
    ]
    if not found:
        return ""
    scatter = f" ± {stdev(found):.2f}" if wide and len(found) > 1 else ""
    return f"  {fmean(found):.2f}{scatter} Hz"


def _note(text: str, label: str, by: str) -> str:
    """Return the words for a note; a mark, which has no author, as it is."""
    about = f" on {label}" if label else ""
    return f"note{about}: {text} ({by})" if by else text


def _state(run: LoggedRun) -> str:
    return "is recorded" if run.status is LoggedStatus.OPEN else run.status.value


def _reasons(status: Status) -> dict[tuple[str, str], str]:
    """Return why runs of each kind were rejected, in short words."""
    why: dict[tuple[str, str], dict[str, None]] = {}
    for run in status.runs:
        if run.status is LoggedStatus.REJECTED:
            reason = reason_words(run.failed.code) if run.failed else "by hand"
            why.setdefault((run.mass_state, run.excitation.value), {})[reason] = None
    return {kind: printable(", ".join(codes), 60) for kind, codes in why.items()}


class ProgressLine(DrawnWords):
    """`bounce ■■▶··  pitch ·····   1 rejected │ no overload`."""

    def show(self, status: Status) -> None:
        """Show the tallies of the mass state that is due."""
        glyphs = self._glyphs
        due = status.due.step if status.due else None
        states = [tally.mass_state for tally in status.tallies]
        state = due.mass_state if due else (states[-1] if states else "")
        parts = []
        rejected = 0
        for tally in status.tallies:
            if tally.mass_state != state:
                continue
            rejected += tally.rejected
            here = due is not None and due.excitation is tally.excitation
            bar = glyphs.bar(tally.accepted, tally.planned, glyphs.now if here else "")
            parts.append(f"{tally.excitation.words} {bar}")
        lamps = printable(", ".join(status.overloaded), 30)
        lamp = f"{glyphs.overload} OVERLOAD {lamps}" if lamps else "no overload"
        bars, end = "  ".join(parts), f"{glyphs.axis} {lamp}"
        words = f" {state}: {bars}   {rejected} rejected {end}"
        if len(words) > self.size.width > 0:
            words = f" {bars}  {rejected} rej. {end}"
        self.say(Content(words))
