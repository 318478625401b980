"""A recorder in the same process: the real run_log and orders, phases turned by hand, no clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from daq.bench.campaign import Campaign
from daq.bench.config import Bench, default_bench_text, parse_bench
from daq.control.exchange import OrderRefusedError
from daq.control.messages import (
    Accept,
    Acknowledge,
    Arm,
    AskBench,
    AskCheck,
    Build,
    BusState,
    BusStatus,
    Choose,
    Configure,
    DiskStatus,
    Due,
    Hello,
    Lane,
    Live,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Pause,
    Phase,
    QueueStatus,
    Redo,
    Reject,
    Reply,
    SessionState,
    SessionStatus,
    Setup,
    Start,
    Status,
    Stop,
    Tally,
    Undo,
)
from daq.runlog import Code, RunLog, advance, entry, next_step, verdict_entry
from daq.runs import Event, Excitation, Losses, RunStatus
from dbc.words import Finding, Severity
from tui.terminal.feed import News, RecorderFeed, Role

WALL_NS = 1_795_267_320_000_000_000  # 2026-11-21 13:22 UTC
BIN_S = 0.02
DOUBLE_BUMP = Finding(
    "double_bump",
    Severity.ERROR,
    "second bump at +0.84 s",
    advice="bump once, keep hands off",
    value=0.84,
    unit="s",
)
GOOD = Finding("too_weak", Severity.NOTE, "peak 9.1 m/s2", "", "", 9.1, 3.0, "m/s2")
INSTRUCTIONS = {
    "bounce": "Roll all four wheels over the boards.",
    "pitch": "Roll the front wheels over the board.",
    "roll": "Roll the left wheels over the board.",
    "warp": "Roll front left and rear right over the boards.",
    "rear_pitch": "Roll the rear wheels over the board.",
}


@cache
def _parsed(text: str) -> Bench:
    return parse_bench(text, "bench.toml", Path(), dbc_text="")


def ready(in_control: bool = True) -> FakeRecorder:
    """Return a recorder before its first bump."""
    recorder = FakeRecorder(in_control=in_control)
    recorder.mark("vehicle", "check")
    return recorder


class FakeRecorder(RecorderFeed):
    """A feed whose recorder is turned by the test.

    `bench_text`: bench.toml in force.  `in_control`: whether the terminal may give orders.
    `check`: the answer to `AskCheck`.
    """

    def __init__(
        self, bench_text: str = "", in_control: bool = True, check: tuple[Finding, ...] = ()
    ) -> None:
        self.bench_text = bench_text or default_bench_text()
        self.in_control, self.check = in_control, check
        self.run_log = RunLog()
        self.orders: list[Order] = []
        self.refuse, self.full = "", False
        self.changes: dict[str, Any] = {}
        """Fields of `Status` that a test wants otherwise."""
        self.phase, self.armed = Phase.IDLE, False
        self.t_ns = WALL_NS
        self.bump_ns = 0
        self.restarts = self.takes_over = 0
        self.setup: Setup | None = None
        self._post: Callable[[News], None] = lambda _: None

    # The feed -----------------------------------------------------------------------------------

    def start(self, post: Callable[[News], None]) -> None:
        self._post = post
        post(Role(self.in_control, "" if self.in_control else "JL is in control"))
        if self.setup is not None:
            post(self.setup)
        post(self.status)

    def stop(self) -> None:
        self._post = lambda _: None

    def take_over(self) -> None:
        self.takes_over += 1
        self.in_control = True
        self._post(Role(True))

    def restart(self) -> None:
        self.restarts += 1

    async def ask(self, order: Order) -> Reply:
        self.orders.append(order)
        if self.refuse:
            raise OrderRefusedError(self.refuse)
        if self.full and isinstance(order, Arm):
            raise OrderRefusedError("the disk is full")
        match order:
            case AskBench():
                return Reply(bench_text=self.bench_text)
            case AskCheck():
                return Reply(check=self.check, status=self.status)
        self._carry_out(order)
        return Reply(status=self.status)

    def _carry_out(self, order: Order) -> None:
        by = "MK"
        match order:
            case Arm():
                self.phase = Phase.ARMED
            case Pause():
                self.phase = Phase.PAUSED
            case Choose(mass_state, excitation):
                self._enter(entry(Code.CHOOSE, 0, mass_state=mass_state, excitation=excitation))
            case Accept(label, reason):
                self._enter(entry(Code.ACCEPT, self.t_ns, label=label, by=by, reason=reason))
            case Reject(label, reason):
                last = label or self.run_log.runs[-1].label
                self._enter(entry(Code.REJECT, self.t_ns, label=last, by=by, reason=reason))
            case Undo():
                self._enter(Event(self.t_ns, Code.UNDO))
            case Redo():
                self._enter(Event(self.t_ns, Code.REDO))
            case Mark(text):
                self._enter(Event(self.t_ns, Code.MARK, text=text))
            case Note(text, label):
                self._enter(entry(Code.NOTE, self.t_ns, text=text, label=label, by=by))
            case OverrideWarning(subject, reason):
                self._enter(entry(Code.OVERRIDE, self.t_ns, subject=subject, reason=reason, by=by))
            case Configure(text):
                self.bench_text = text
            case Start(text):
                self.bench_text, self.run_log = text or self.bench_text, RunLog()
            case Acknowledge():
                self.changes.pop("overloaded", None)
            case Stop() | Build():
                self.changes["session"] = SessionStatus(SessionState.BUILDING)
            case Hello():
                pass

    # Turned by the test -------------------------------------------------------------------------

    def publish(self, **changes: object) -> None:
        """Publish a status, with these fields otherwise from now on."""
        self.changes |= changes
        self._post(self.status)

    def turn(self, phase: Phase) -> None:
        """Go to a phase and say so."""
        self.phase = phase
        self.publish()

    def post(self, news: News) -> None:
        """Post anything, as the feed's thread would."""
        self._post(news)

    def bump(self) -> str:
        """Let the bump come that is due; return its label."""
        step = next_step(self.campaign, self.run_log)
        assert step is not None
        self.t_ns += 12_000_000_000
        self.bump_ns = self.t_ns
        self._enter(Event(self.t_ns, Code.BUMP, text=step.label))
        self.turn(Phase.TRIGGERED)
        return step.label

    def judge(self, *findings: Finding) -> None:
        """End the run with a verdict."""
        run = self.run_log.open
        assert run is not None
        self._enter(verdict_entry(self.t_ns, run.label, findings or (GOOD,)))
        after = self.run_log.run(run.label)
        assert after is not None
        accepted = after.status is RunStatus.ACCEPTED
        self.turn(Phase.ACCEPTED if accepted else Phase.REJECTED)

    def finish(self, mass_state: str) -> None:
        """Accept every planned run of a mass state."""
        while (step := next_step(self.campaign, self.run_log)) and step.mass_state == mass_state:
            self.bump()
            self.judge()
        self.turn(Phase.IDLE if step else Phase.COMPLETE)

    def choose(self, mass_state: str, excitation: Excitation) -> None:
        """Choose the kind of the next run."""
        self._carry_out(Choose(mass_state, excitation))

    def mark(self, *steps: str) -> None:
        """Say that steps without bumps are done."""
        for step in steps:
            self._enter(Event(self.t_ns, Code.MARK, text=f"step {step} done"))

    def built(self, path: str) -> SessionStatus:
        """Return that the session file of the recording as it stands is there."""
        status = self.status
        return SessionStatus(SessionState.READY, path, "", status.recording, status.revision)

    def live(self, seconds: float = 10.0) -> Live:
        """Return a decay after the last bump (or rest) on every channel, up to now + 3 s."""
        last = int(self.t_ns * 1e-9 / BIN_S) + 150
        first = last - int(seconds / BIN_S)
        t_s = np.arange(first, last) * BIN_S - self.bump_ns * 1e-9
        swing = np.where(t_s > 0, np.exp(-t_s / 0.8) * np.sin(9.0 * t_s), 0.0)
        lanes = []
        for k, channel in enumerate(self.bench.channels):
            value = (8.0 - 0.5 * k) * swing + 0.05 * np.sin(np.arange(first, last) + k)
            low, high = value - 0.04, value + 0.04
            lanes.append(Lane(channel.name, tuple(low.tolist()), tuple(high.tolist())))
        return Live(first, BIN_S, tuple(lanes))

    # What it says -------------------------------------------------------------------------------

    @property
    def bench(self) -> Bench:
        return _parsed(self.bench_text)

    @property
    def campaign(self) -> Campaign:
        return self.bench.campaign

    @property
    def status(self) -> Status:
        bench, run_log = self.bench, self.run_log
        step = next_step(bench.campaign, run_log)
        kinds = dict.fromkeys((s.mass_state, s.excitation) for s in bench.campaign.steps)
        tallies = tuple(
            Tally(
                *kind,
                accepted=run_log.accepted(*kind),
                planned=bench.campaign.repeats,
                rejected=sum(r.status is RunStatus.REJECTED for r in run_log.of(*kind)),
            )
            for kind in kinds
        )
        due = None
        if step is not None:
            kind = (step.mass_state, step.excitation)
            tally = next(t for t in tallies if (t.mass_state, t.excitation) == kind)
            numbers = (tally.accepted, tally.planned, tally.rejected)
            due = Due(step, *numbers, INSTRUCTIONS[step.excitation])
        reported = Status(
            wall_ns=WALL_NS,
            t_ns=self.t_ns,
            recording="0f3c" * 8,
            folder="bench",
            vehicle=bench.vehicle.name,
            bench_crc32=crc32(self.bench_text.encode()),
            phase=self.phase,
            phase_s=1.0,
            countdown_s=2.4 if self.phase in (Phase.ACCEPTED, Phase.REJECTED) else None,
            not_at_rest=(),
            bump_ns=self.bump_ns,
            peak_left=0.06 if self.phase is Phase.DECAY else None,
            halted="",
            due=due,
            tallies=tallies,
            runs=run_log.runs,
            notes=run_log.notes,
            overrides=run_log.overrides,
            undo=f"verdict on {run_log.done[-1].after.label}" if run_log.done else "",
            redo=f"verdict on {run_log.undone[-1].after.label}" if run_log.undone else "",
            alarms=(),
            overloaded=(),
            buses=(BusStatus("can0", BusState.OK, 0.38, 4000.0, 160_000, 0, 0),),
            sensors_alive=4,
            sensors_expected=4,
            losses=Losses(),
            disk=DiskStatus(81_000_000_000, 5_000_000, 160_000, 0.1),
            queue=QueueStatus(0, 2, 64),
            session=SessionStatus(),
            controller="MK",
            revision=run_log.revision,
        )
        return replace(reported, **self.changes)

    def _enter(self, event: Event) -> None:
        self.run_log = advance(self.run_log, event)
