"""What the recorder and its clients say to each other: typed, versioned, JSON on the wire.

A client sends an `Order` (`daq.control.orders`) in a `Request` and gets a `Reply`.  The recorder
publishes its `Status` and the `Live` samples ten times a second to whoever listens.  All of it is
data; who carries it is `daq.control.server` and `daq.control.client`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from pydantic import TypeAdapter

from ..bench.campaign import Step
from ..runlog.runlog import LoggedRun, Override, Remark
from ..runs import Excitation, Losses
from .orders import Order

PROTOCOL = 1
"""Raised when an older client could misread what is said."""
STATUS_TOPIC, LIVE_TOPIC = b"status", b"live"


class Phase(StrEnum):
    """Where the run loop stands."""

    IDLE = "idle"
    """Nothing is armed; frames are journalled all the same."""
    WAITING = "waiting"
    """Armed by the operator, but the car is not at rest yet or the pre-trigger is not full."""
    ARMED = "armed"
    TRIGGERED = "triggered"
    DECAY = "decay"
    ACCEPTED = "accepted"
    """The run just judged, until the countdown ends."""
    REJECTED = "rejected"
    PAUSED = "paused"
    COMPLETE = "complete"


class BusState(StrEnum):
    """How a bus is doing, the worse the later."""

    OK = "ok"
    ERROR_PASSIVE = "error-passive"
    SILENT = "silent"
    BUS_OFF = "bus-off"
    DISCONNECTED = "disconnected"


class SessionState(StrEnum):
    """How far the session file of the recording is."""

    NONE = "none"
    BUILDING = "building"
    READY = "ready"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Request:
    """An order on its way; `number` comes back with the reply."""

    client: str
    number: int
    order: Order
    protocol: int = PROTOCOL


# Status ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something is wrong now."""

    code: str
    """`bus_silent`, `bus_off`, `error_passive`, `disconnected`, `stale`, `queue_high`, `disk_low`,
    `journal_failed`, `clock_step`, `stuck`, `saturated`, ... (`daq.alarms`)."""
    subject: str
    """The bus, message, channel or folder; '' for the recorder itself."""
    text: str
    advice: str
    """`text`, `advice`: what is wrong, with the number; what to do."""
    since_ns: int
    """Wall clock, ns since 1970."""
    count: int = 0
    """How often or how many frames, where that is counted."""


@dataclass(frozen=True, slots=True)
class BusStatus:
    """One bus: `load` is the share of the bit rate in use, 0..1; counts since the start."""

    name: str
    state: BusState
    load: float
    frames_per_s: float
    frames: int
    error_frames: int
    reopened: int
    tx_errors: int | None = None
    rx_errors: int | None = None


@dataclass(frozen=True, slots=True)
class DiskStatus:
    """The journal: what is on the disk and what room is left."""

    free_bytes: int
    journal_bytes: int
    recorded_frames: int
    """On the disk (fdatasync'ed): the only meaning of "recorded"."""
    lag_s: float
    """Age of the oldest frame that was received and is not."""
    held_frames: int = 0
    """Kept in memory because the disk refuses."""
    failed: str = ""
    """Why the disk refuses; empty if it does not."""
    dropped_frames: int = 0
    """Lost because neither disk nor memory had room; `disk_gap` events tell where."""
    warning: str = ""
    """What is wrong although the disk takes everything: nothing that may be deleted, a file that
    was taken away, a write that failed and went elsewhere."""
    total_bytes: int = 0


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """The queue between readers and writer, in blocks; `high` since the start."""

    blocks: int
    high: int
    room: int


@dataclass(frozen=True, slots=True)
class Due:
    """The step that is to be done next, or is being done."""

    step: Step
    """Its `label` is that of the next attempt."""
    accepted: int
    planned: int
    rejected: int
    """`accepted`, `planned`, `rejected`: runs of this mass state and excitation so far."""
    instruction: str
    """What the operator is to do."""


@dataclass(frozen=True, slots=True)
class Tally:
    """Runs of one mass state and excitation."""

    mass_state: str
    excitation: Excitation
    accepted: int
    planned: int
    rejected: int


@dataclass(frozen=True, slots=True)
class SessionStatus:
    """The session file of the recording (or, after `Stop`, of the one before)."""

    state: SessionState = SessionState.NONE
    """Whether it is there."""
    path: str = ""
    text: str = ""
    """`path`, `text`: where; what went wrong, or what the journal has lost."""
    recording: str = ""
    """Identity of its recording."""
    revision: int = 0
    """Of the book (`daq.runlog.runlog.Book`) that it was built from."""


@dataclass(frozen=True, slots=True)
class Status:
    """Where the recorder stands; all a terminal needs to be where the old one was."""

    wall_ns: int
    t_ns: int
    """`wall_ns`, `t_ns`: host's clock; time stamp of the latest frame (0 before the first)."""
    recording: str
    """Identity of the recording; changes with `Start` and `Stop`."""
    folder: str
    vehicle: str
    bench_crc32: int
    """Of the bench.toml in force: ask for it when this changes."""
    phase: Phase
    phase_s: float
    """`phase`, `phase_s`: where the run loop stands, and for how long, s."""
    countdown_s: float | None
    """Until the next run is armed."""
    not_at_rest: tuple[str, ...]
    """Trigger channels that keep it from being armed."""
    bump_ns: int
    """Time stamp of the last bump; 0 if none."""
    peak_left: float | None
    """Share of the motion's peak that is left, in DECAY."""
    halted: str
    """Why the run loop stopped by itself (three rejects for one reason: that reason's code)."""
    due: Due | None
    """None when the campaign is complete."""
    tallies: tuple[Tally, ...]
    """In the order of the campaign."""
    runs: tuple[LoggedRun, ...]
    notes: tuple[Remark, ...]
    overrides: tuple[Override, ...]
    undo: str
    redo: str
    """What would be undone or redone, in words; empty if nothing."""
    alarms: tuple[Alarm, ...]
    """In order of gravity."""
    overloaded: tuple[str, ...]
    """Channels that touched the end of their range since the last `Acknowledge`."""
    buses: tuple[BusStatus, ...]
    sensors_alive: int
    sensors_expected: int
    """`sensors_alive`, `sensors_expected`: messages of the bench."""
    losses: Losses
    disk: DiskStatus
    queue: QueueStatus
    session: SessionStatus
    controller: str = ""
    viewers: int = 0
    software: str = ""
    protocol: int = PROTOCOL
    revision: int = 0
    """`runs`, `notes`, `overrides`, `revision`: the book of the recording (`daq.runlog.runlog`)."""

    @property
    def own_session(self) -> str:
        """Path of the session file of this recording; empty where that is of the one before."""
        return self.session.path if self.session.recording == self.recording else ""

    @property
    def outdated(self) -> bool:
        """Whether runs, weights or vehicle have changed since the session file was built."""
        return bool(self.own_session) and self.session.revision != self.revision


# Live data and answers --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Lane:
    """Lowest and highest value of one channel in each bin, SI; None where there is no sample."""

    channel: str
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class Live:
    """The newest samples of every channel as an envelope."""

    first_bin: int
    """Bin k holds time stamps k bin_s .. (k + 1) bin_s; bins are told once, when complete."""
    bin_s: float
    """Width of a bin, s."""
    lanes: tuple[Lane, ...]
    """All of the same number of bins."""


@dataclass(frozen=True, slots=True)
class CheckItem:
    """One line of the bench check (`daq.check.result`); verdict is OK, WARN or FAIL."""

    verdict: str
    subject: str
    reason: str
    advice: str
    figures: dict[str, float]


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a request."""

    number: int
    """Of the request."""
    error: str = ""
    """One line; empty if the order was carried out."""
    status: Status | None = None
    live: Live | None = None
    bench_text: str = ""
    check: tuple[CheckItem, ...] = ()
    """What was asked for; after an order, the status."""
    protocol: int = PROTOCOL


REQUEST, REPLY = TypeAdapter(Request), TypeAdapter(Reply)
STATUS, LIVE = TypeAdapter(Status), TypeAdapter(Live)
