"""Step 2: checks the bench, and the place, the sign and the zero of every sensor."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content

from daq import Channel, Corner, Quantity
from daq.bench.edit import with_channel
from daq.check.check import WORDS
from daq.check.pushes import ORDER, PushResult, judge_push, shows_push, spoken
from daq.control.messages import AskCheck, Mark, OverrideWarning, Status
from dbc.words import Finding, printable

from ..campaign import BETWEEN_RUNS, BenchStep
from ..widgets import SPACE_INK, Cell, Question, Table, Words
from .base import MARK_KEYS, BenchScreen

if TYPE_CHECKING:
    from daq.bench.config import Bench

OK, WARN, FAIL, NOW, WAIT = "OK", "WARN", "FAIL", "NOW", "wait"
TARED = (Quantity.SUSPENSION_TRAVEL, Quantity.PITCH_RATE, Quantity.ROLL_RATE)
"""Quantities that are zero at rest; not accelerations, for which a tare would hide gravity."""
_LARGEST_ZERO = {"m": 0.5e-3, "rad/s": 1e-3}
"""Largest offset that counts as zero, by unit: below what a tare can improve."""


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One line: state in a word, subject, result and advice."""

    state: str
    subject: str
    text: str
    advice: str = ""
    overridden: bool = False

    @property
    def needs_override(self) -> bool:
        """True if the operator must override it."""
        return self.state == WARN and not self.overridden


def push_subject(corner: str) -> str:
    """Return the subject of the line on the push of a corner."""
    return f"push {corner}"


def zero_offsets(
    findings: Sequence[Finding], channels: Sequence[Channel]
) -> list[tuple[Channel, float]] | None:
    """Return the channels that should read zero at rest but do not, each with its level, SI.

    `findings`: of a check with hands off the car.  None if it lacks a reading of such a channel.
    """
    levels = {f.subject: f.figures["level"] for f in findings if "level" in f.figures}
    readings = [(c, levels.get(f"channel {c.name}")) for c in channels if c.quantity in TARED]
    known = [(c, level) for c, level in readings if level is not None]
    if len(known) < len(readings):
        return None
    return [(c, level) for c, level in known if abs(level) > _LARGEST_ZERO[c.unit]]


_INKS = {OK: "success", WARN: "warning", FAIL: "error", NOW: "accent"}
"""Colours of the theme for the states, which are words and symbols first."""

PERIOD_S, WINDOW_S = 1.0, 3.0
"""Seconds between two checks, and seconds of samples in each."""
HANDS_OFF_S = 5.0
"""Seconds for which hands must be off the car while the zero is measured."""
_ASK_AGAIN_S = 15.0
"""Seconds of the recording without a push after which it is asked for again."""
_ZERO = "zero"


class CheckScreen(BenchScreen):
    """Shows lines OK, WARN or FAIL; then guides through the push test and the zeros."""

    STEP: ClassVar[BenchStep] = BenchStep.CHECK
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("r", "again", "Again", tooltip="Repeat the marked push or zero"),
        Binding("o", "override", "Override", tooltip="Override the marked WARN, with a reason"),
        Binding("i", "invert", "Invert", tooltip="Invert the sign of the marked FAIL's channel"),
        Binding("s", "skip", "Skip", tooltip="Skip the marked corner, with a reason"),
        *MARK_KEYS,
    ]

    def __init__(self) -> None:
        super().__init__()
        self._recording = ""  # identity of the recording whose pushes and zero these are
        self._findings: tuple[Finding, ...] = ()  # of the recorder's last check
        self._rest_findings: tuple[Finding, ...] = ()  # of its check with hands off; () if none
        self._rows: list[CheckRow] = []  # the lines that are shown
        self._corner: Corner | None = None  # whose push is awaited
        self._push_begin_bin = 0  # number of the lanes' bin from which that push is looked for
        self._push_results: dict[Corner, PushResult] = {}
        self._acknowledged = ""  # answer of the sensors to the last push, in words
        self._failing: set[str] = set()  # subjects of the lines that failed when shown last
        self._hands_off_s = 0.0  # time that hands must still be off; 0: no zero is measured
        self._settling_s = 0.0  # time in which a check would still have samples of a push

    def compose_body(self) -> ComposeResult:
        """Compose the lines, and below or beside them the explanation of the marked one."""
        with Horizontal(id="checks"):
            yield Table("lines")
            yield Words("explained", "box")

    def on_mount(self) -> None:
        """Request the check now, and again each second."""
        self.run_worker(self._request_check(WINDOW_S))
        self.set_interval(PERIOD_S, self._check_again)

    @property
    def next_enabled(self) -> bool:
        """True while SPACE does something: not while the car is pushed or must be at rest."""
        return self._next[1] is not None

    # The recorder's check -----------------------------------------------------------------------

    async def _check_again(self) -> None:
        """Request the check, or go on with the zero's measurement; called once a period.

        Nothing is requested during a push and just after it, or while another screen is in front.
        """
        if not self.is_current:
            return
        if self._hands_off_s:
            remaining_s = max(0.0, self._hands_off_s - PERIOD_S)
            if not remaining_s:  # the last period lasts until the answer; without one, all again
                # The first period may have begun before SPACE, with hands on the car.
                if await self._request_check(HANDS_OFF_S - PERIOD_S):
                    self._rest_findings = self._findings
                else:
                    remaining_s = HANDS_OFF_S
            self._hands_off_s = remaining_s
            self._show()
        elif self._settling_s:
            self._settling_s = max(0.0, self._settling_s - PERIOD_S)
        elif self._corner is None:
            await self._request_check(WINDOW_S)

    async def _request_check(self, window_s: float) -> bool:
        """Request the check of the last seconds; return True if a recorder has answered."""
        app = self.bench_app
        if app.status is None or app.lost is not None:
            return False
        reply = await app.ask(AskCheck(window_s))
        if reply is None:
            return False
        self._findings = reply.check
        self._show()
        return True

    # Showing ------------------------------------------------------------------------------------

    def show_status(self, status: Status) -> None:
        """Show the lines, if the bench is known.

        The mark stays on the line of its subject, but goes to a line that begins to fail.  Pushes
        and zero hold for one recording: the next one is of another car.
        """
        bench = self.bench_app.bench
        if bench is None or not self.query("#explained"):
            return
        if status.recording != self._recording:
            self._recording, self._corner, self._hands_off_s = status.recording, None, 0.0
            self._rest_findings, self._push_results = (), {}
        marked, rows = self._marked, self._current_rows(status, bench)
        self._rows = rows
        lines = self.query_one(Table)
        cursor = min(lines.cursor_row, len(rows) - 1)
        if marked is not None and rows[cursor].subject != marked.subject:
            at_subject = (i for i, row in enumerate(rows) if row.subject == marked.subject)
            cursor = next(at_subject, cursor)
        failing = {row.subject for row in rows if row.state == FAIL}
        if new := failing - self._failing:  # only once: then the person moves the mark
            cursor = next(i for i, row in enumerate(rows) if row.subject in new)
        lines.show(("", "", ""), [self._cells(row) for row in rows], cursor)
        self._failing = failing
        self._explain()

    def _current_rows(self, status: Status, bench: Bench) -> list[CheckRow]:
        """Return the lines of the check, of the push test and of the zero."""
        overridden = {o.subject: f"{o.reason} ({o.by})" for o in status.overrides}
        rows = []
        for item in self._findings:
            state = WORDS[item.severity]
            is_overridden = state == WARN and item.subject in overridden
            advice = f"overridden: {overridden[item.subject]}" if is_overridden else item.advice
            rows.append(CheckRow(state, item.subject, item.text, advice, is_overridden))
        if not self._findings:
            rows.append(CheckRow(WAIT, "sensors", "listening"))
        if shows_push(bench.channels):
            skipped = [overridden.get(push_subject(corner)) for corner in ORDER]
            rows += map(self._push_row, ORDER, skipped)
        else:
            rows.append(CheckRow(OK, "push", "no sensor of this bench can distinguish the corners"))
        return [*rows, self._zero_row(bench)]

    def _push_row(self, corner: Corner, reason: str | None) -> CheckRow:
        """Return the line on the push of a corner; `reason`: why a person skipped it, if so."""
        subject, result = push_subject(corner), self._push_results.get(corner)
        if corner is self._corner:
            text = result.text if result else f"push DOWN at the {spoken(corner)}, let go"
            return CheckRow(NOW, subject, text)
        if result is not None:  # a skipped corner may be pushed after all
            return CheckRow(OK if result.passed else FAIL, subject, result.text, result.advice)
        if reason is not None:
            return CheckRow(WARN, subject, f"skipped: {reason}", overridden=True)
        return CheckRow(WAIT, subject, spoken(corner))

    def _cells(self, row: CheckRow) -> list[Cell]:
        """Return symbol and state, subject, and text of a line."""
        glyphs, colours = self.bench_app.glyphs, self.app.theme_variables
        sign = {OK: glyphs.good, WARN: glyphs.warn, FAIL: glyphs.bad, NOW: glyphs.now}
        ink = f"bold {colours[_INKS[row.state]]}" if row.state in _INKS else ""
        state = Text(f" {sign.get(row.state, glyphs.empty)} {row.state:<5}", ink)
        text = printable(row.text, 200)
        if row.overridden and row.advice:
            text += f" - {printable(row.advice, 80)}"
        return [state, printable(row.subject, 40), f" {text}"]

    def _zero_row(self, bench: Bench) -> CheckRow:
        """Return the line on the zero of travels and rates: not or being measured, right or off."""
        if self._hands_off_s:
            return CheckRow(NOW, _ZERO, f"hands off the car: {self._hands_off_s:.0f} s more")
        offsets, texts = zero_offsets(self._rest_findings, bench.channels), []
        if offsets is None:
            return CheckRow(WAIT, _ZERO, f"hands off for {HANDS_OFF_S:.0f} s")
        for c, level in offsets:
            level_text = f"{level * 1e3:+.1f} mm" if c.unit == "m" else f"{level:+.4f} {c.unit}"
            texts.append(f"{c.name} {level_text}")
        if not texts:
            return CheckRow(OK, _ZERO, "travels and rates read zero at rest")
        advice = "the zero of the car at ride height (goes to the report)"
        return CheckRow(NOW, _ZERO, ", ".join(texts), advice)  # until SPACE takes it as zero

    def _explain(self) -> None:
        """Show what SPACE does, then text and advice of the marked line, or of the push."""
        row, box = self._marked, self.query_one("#explained", Words)
        if row is None:
            return
        box.border_title = printable(row.subject, 50).replace("[", "(")
        texts = [row.text, row.advice]
        if self._corner is not None:  # the line on SPACE says what its row says
            texts = [self._acknowledged or "S skips it, with a reason"]
        lines = [Content(printable(text, 300)) for text in texts if text]
        box.say(Content("\n").join([Content.styled(self._next[0], SPACE_INK), *lines]))

    @property
    def _next(self) -> tuple[str, Callable[[], Awaitable[None]] | None]:
        """Words and action of SPACE; no action while the words say what is awaited."""
        app, corner = self.bench_app, self._corner
        if self.lost_words:
            return self.lost_words, None
        if corner is not None:
            words = self._push_row(corner, None).text
            waited_s = (app.lanes.end_bin - self._push_begin_bin) * app.lanes.bin_s
            remaining_s = max(0.0, _ASK_AGAIN_S - waited_s)
            return f"{words[:1].upper()}{words[1:]}, {remaining_s:.0f} s left", None
        if self._hands_off_s:
            return "Hands off the car.", None
        if not self._findings:
            return "Listening to the sensors.", None
        if blocked := sum(row.state == FAIL for row in self._rows):
            correct = f"correct {'it' if blocked == 1 else 'them'}"
            return f"{blocked} FAIL: {correct}, then SPACE goes on", None
        if (following := self._next_corner()) is not None:
            return "SPACE = push the corners", partial(self._begin_push, following)
        offsets = zero_offsets(self._rest_findings, app.bench.channels if app.bench else ())
        if offsets is None:
            return "SPACE = zero: hands off the car", self._measure_zero
        if offsets:
            return "SPACE = take this as zero", partial(self._take_zero, offsets)
        if needs_override := sum(row.needs_override for row in self._rows):
            return f"SPACE = override {needs_override} WARN", self._override_first
        return "SPACE = the bench is fit: go on to step 3 Baseline", self._end_step

    def _mark_subject(self, subject: str) -> None:
        """Mark the line on a subject, and show the lines anew."""
        self.mark_row(next(i for i, row in enumerate(self._rows) if row.subject == subject))

    @property
    def _marked(self) -> CheckRow | None:
        """The marked line; None before there are lines."""
        cursor = self.query_one(Table).cursor_row
        return self._rows[cursor] if cursor < len(self._rows) else None

    @property
    def _marked_corner(self) -> Corner | None:
        """The corner whose push the marked line is on; None if it is on something else."""
        marked = self._marked.subject if self._marked else ""
        return next((corner for corner in ORDER if push_subject(corner) == marked), None)

    # SPACE --------------------------------------------------------------------------------------

    async def action_next(self) -> None:
        """Do the first open one of these: push test, zero, warnings, next step."""
        _, action = self._next
        if action is not None:
            await action()

    async def _override_first(self) -> None:
        """Ask for the reason to override the first warning."""
        self.mark_row(next(i for i, row in enumerate(self._rows) if row.needs_override))
        self.action_override()

    async def _end_step(self) -> None:
        """Mark the step as done, and go on to the baseline."""
        if await self.bench_app.finish(self.STEP):
            await self.bench_app.go_to(BenchStep.BASELINE)

    async def action_again(self) -> None:
        """Repeat the marked push, or measure the zero again."""
        if corner := self._corner or self._marked_corner:
            await self._begin_push(corner)
        elif self._marked is not None and self._marked.subject == _ZERO:
            await self._measure_zero()

    # Warnings -----------------------------------------------------------------------------------

    def action_override(self) -> None:
        """Override the marked warning, and others of its subject, with a reason and a name."""
        row = self._marked
        if row is None or not row.needs_override:
            self.bench_app.warn("O overrides a line that says WARN: mark one")
            return
        warnings = [r.text for r in self._rows if r.subject == row.subject and r.needs_override]
        self._ask_reason(row.subject, f"{'; '.join(warnings)}. Why is that acceptable here?")

    def action_skip(self) -> None:
        """Skip the corner whose push is awaited, else the marked one, with a reason."""
        corner = self._corner or self._marked_corner
        if corner is None:
            self.bench_app.warn("S skips a corner of the push test: mark its line")
            return
        self._ask_reason(push_subject(corner), "Why is this corner not pushed?", corner)

    def _ask_reason(self, subject: str, question: str, skipped: Corner | None = None) -> None:
        """Ask for the reason of an override and send it; go on after a skipped corner."""

        async def answered(reason: str | None) -> None:
            if not reason or await self.bench_app.ask(OverrideWarning(subject, reason)) is None:
                return
            if skipped is not None:
                self._push_results.pop(skipped, None)
                await self._end_push()
            self._show()

        self.app.push_screen(Question(f"{subject}: {question}", "reason"), answered)

    # The push test -------------------------------------------------------------------------------

    def _next_corner(self) -> Corner | None:
        """Return the next corner to push; None once each is pushed or skipped."""
        app = self.bench_app
        if app.bench is None or app.status is None or not shows_push(app.bench.channels):
            return None
        skipped = {override.subject for override in app.status.overrides}
        open_corners = (c for c in ORDER if push_subject(c) not in skipped)
        return next((c for c in open_corners if c not in self._push_results), None)

    async def _begin_push(self, corner: Corner, acknowledged: str = "") -> None:
        """Wait for a push; a mark in the recording names the corner.

        `acknowledged`: what the sensors saw of the push before.
        """
        app = self.bench_app
        if app.status is None or app.status.phase not in BETWEEN_RUNS:
            app.warn("a run is armed: pause it first")
            return
        self._push_results.pop(corner, None)
        self._hands_off_s = 0.0
        self._corner, self._push_begin_bin = corner, app.lanes.end_bin
        self._acknowledged = acknowledged
        self._mark_subject(push_subject(corner))
        if await app.ask(Mark(push_subject(corner))) is None:
            self._corner = None
            self._show()

    async def on_live_arrived(self) -> None:
        """Judge the push on the corner that is due; without a push in time, ask for it again."""
        app, corner = self.bench_app, self._corner
        if corner is None or app.bench is None or not app.lanes.bin_s:
            return
        bin_s, end_bin = app.lanes.bin_s, app.lanes.end_bin
        # From the begin, however late this screen gets its turn: a push is over in a second.
        begin_bin = self._push_begin_bin
        n_rest = round(10.0 / bin_s)  # 10 s of bins before a push give the level at rest
        first_bin, n_bins = begin_bin - n_rest, end_bin - begin_bin + n_rest
        channels = app.bench.channels
        envelopes = {c.name: app.lanes.window(c.name, first_bin, n_bins) for c in channels}
        result = judge_push(corner, channels, envelopes, n_rest, bin_s)
        self._push_results[corner] = result
        if result.done:
            await self._end_push(f"{spoken(corner)} seen: {result.text}")
        elif (end_bin - begin_bin) * bin_s >= _ASK_AGAIN_S:
            self._push_begin_bin = end_bin
            self.app.bell()
            self._acknowledged = f"{spoken(corner)} not seen yet"
            await app.ask(Mark(push_subject(corner)))
        else:
            self._show()

    async def _end_push(self, acknowledged: str = "") -> None:
        """End the wait for a push; ask for the next corner unless the last push was wrong.

        `acknowledged`: what the sensors saw of the last push.
        """
        corner, self._corner = self._corner, None
        self._settling_s = WINDOW_S + PERIOD_S
        result = self._push_results.get(corner) if corner is not None else None
        following = self._next_corner()
        if (result is None or result.passed) and following is not None:
            await self._begin_push(following, acknowledged)
        self._show()

    # Sign and zero ------------------------------------------------------------------------------

    async def action_invert(self) -> None:
        """Invert the sign of the channel of the marked line."""
        app, row = self.bench_app, self._marked
        if row is None or app.bench is None:
            return
        corner = self._marked_corner
        name = row.subject.removeprefix("channel ")
        if corner is not None:  # the first channel that moved the wrong way
            inverted = self._push_results[corner].inverted if corner in self._push_results else ()
            name = next(iter(inverted), "")
        channel = next((c for c in app.bench.channels if c.name == name), None)
        if channel is None or row.state != FAIL:
            app.warn("I inverts the sign of a channel whose line says FAIL: mark one")
            return
        sign, tare = -channel.sign, -channel.tare
        if await app.configure(lambda text: with_channel(text, channel.name, sign, tare)):
            self._rest_findings = ()  # the level that was measured has the other sign
            app.inform(f"sign of {channel.name} is now {sign:+.0f}")
            if corner is not None:
                await self._begin_push(corner)

    async def _measure_zero(self) -> None:
        """Begin to measure the zero: hands off the car for some seconds."""
        self._hands_off_s, self._rest_findings = HANDS_OFF_S, ()
        self._mark_subject(_ZERO)

    async def _take_zero(self, offsets: Sequence[tuple[Channel, float]]) -> None:
        """Set the zero of channels to their levels at rest, SI, and measure it again."""

        def tared(text: str) -> str:
            for channel, level in offsets:
                text = with_channel(text, channel.name, tare=round(channel.tare + level, 7))
            return text

        if await self.bench_app.configure(tared):
            self._findings = ()  # readings from before the new zero are invalid
            await self._measure_zero()
