"""The messages between a recorder and its clients: typed, versioned, JSON on the wire.

A client sends an `Order` (`daq.control.orders`) in a `Request` and gets a `Reply`.  The recorder
publishes its `Status` and the `Live` samples to all clients, ten times a second.  These are data;
`daq.control.server` and `daq.control.client` transport them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from pydantic import ConfigDict, TypeAdapter

from ..bench.campaign import Step
from ..bench.origin import Origin
from ..runlog.runlog import LoggedRun, Override, Remark
from ..runs import Excitation, Losses
from .orders import Order

PROTOCOL = 2
"""Version of the messages, raised when an older client could misread them."""
STATUS_TOPIC, LIVE_TOPIC = b"status", b"live"
_WHEN_USED = ConfigDict(defer_build=True)
"""A client builds what reads and writes a message when the first one comes, not before its
screen."""


class Phase(StrEnum):
    """State of the run loop."""

    IDLE = "idle"
    """Not armed; frames are recorded nevertheless."""
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
    """State of a bus, from the best to the worst."""

    OK = "ok"
    ERROR_PASSIVE = "error-passive"
    SILENT = "silent"
    BUS_OFF = "bus-off"
    DISCONNECTED = "disconnected"


class SessionState(StrEnum):
    """State of the session file of the recording."""

    NONE = "none"
    BUILDING = "building"
    READY = "ready"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Request:
    """A message with an order; its reply has the same `number`."""

    __pydantic_config__ = _WHEN_USED
    client: str
    number: int
    order: Order
    protocol: int = PROTOCOL


# Status ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Alarm:
    """A fault that is present now."""

    code: str
    """`not_recording`, `bus_silent`, `bus_off`, `error_passive`, `disconnected`, `stale`,
    `queue_high`, `disk_low`, `journal_failed`, `clock_step`, `stuck`, `saturated`, ...
    (`daq.alarms`)."""
    subject: str
    """The bus, message, channel or folder; empty for the recorder itself."""
    text: str
    """The fault in words, with the numbers."""
    advice: str
    """Advice for the operator."""
    since_ns: int
    """Wall clock, ns since 1970."""
    count: int = 0
    """Number of events or frames, where they are counted."""


@dataclass(frozen=True, slots=True)
class BusStatus:
    """One bus; counts are those since the start."""

    name: str
    state: BusState
    load: float
    """Share of the bit rate in use, 0..1."""
    frames_per_s: float
    frames: int
    error_frames: int
    reopened: int
    tx_errors: int | None = None
    rx_errors: int | None = None


@dataclass(frozen=True, slots=True)
class DiskStatus:
    """The journal, and the room on its disk."""

    free_bytes: int
    journal_bytes: int
    recorded_frames: int
    """Frames of this recording, or of the time since the last one, that are on the disk
    (fdatasync'ed): the only meaning of "recorded"."""
    lag_s: float
    """Age of the oldest frame that was received and is not on the disk."""
    held_frames: int = 0
    """Frames in memory because the disk refuses them."""
    failed: str = ""
    """Why the disk refuses; empty if it does not."""
    dropped_frames: int = 0
    """Frames lost because neither disk nor memory had room; `disk_gap` events report them."""
    warning: str = ""
    """A fault although the disk takes everything: nothing that may be deleted, a file that was
    taken away, a write that failed and was repeated in another file."""
    total_bytes: int = 0


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """The queue between readers and writer, in blocks; `high` is the most since the start."""

    blocks: int
    high: int
    room: int


@dataclass(frozen=True, slots=True)
class StorageStatus:
    """Frames that arrive compared with those on the disk, since the recorder was started."""

    received_frames: int = 0
    """Frames of all buses, those included that found no room in the queue."""
    stored_frames: int = 0
    """Frames on the disk (fdatasync'ed), of all campaigns and of the times between them."""
    late_s: float = 0.0
    """Time for which frames have arrived and none was stored, s."""


@dataclass(frozen=True, slots=True)
class Due:
    """The next step, or the one being done."""

    step: Step
    """Its `label` is that of the next attempt."""
    accepted: int
    planned: int
    rejected: int
    """Accepted, planned and rejected are numbers of runs of this mass state and excitation."""
    instruction: str
    """Instruction for the operator."""


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
    path: str = ""
    text: str = ""
    """Why it failed, or the losses of the journal."""
    recording: str = ""
    """Identity of its recording."""
    revision: int = 0
    """Revision of the run log that it was built from."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """An accepted run that does not belong to the others of its kind."""

    label: str
    """Label of the run."""
    text: str
    """Its difference from the others, in words."""


@dataclass(frozen=True, slots=True)
class Status:
    """The whole state of a recorder: a terminal that attaches needs nothing else."""

    __pydantic_config__ = _WHEN_USED
    wall_ns: int
    """The host's wall clock."""
    t_ns: int
    """Time stamp of the latest frame; 0 before the first."""
    recording: str
    """Identity of the campaign's recording; changes with `Start`.  Empty between two campaigns,
    after `Stop`: what is on the bus is recorded then, too."""
    folder: str
    vehicle: str
    bench_crc32: int
    """CRC of the bench.toml in force: a client asks for it when this changes."""
    phase: Phase
    """State of the run loop."""
    phase_s: float
    """Time in that state, s."""
    countdown_s: float | None
    """Time until the next run is armed, s; None if none will be."""
    not_at_rest: tuple[str, ...]
    """Trigger channels that prevent arming."""
    bump_ns: int
    """Time stamp of the last bump; 0 if none."""
    peak_left: float | None
    """Share of the motion's peak that is left, in DECAY."""
    halted: str
    """Why the run loop stopped by itself: after three rejects for one reason, its code."""
    due: Due | None
    """None when the campaign is complete."""
    tallies: tuple[Tally, ...]
    """In the order of the campaign."""
    runs: tuple[LoggedRun, ...]
    notes: tuple[Remark, ...]
    overrides: tuple[Override, ...]
    undo: str
    """The verdict that would be undone, in words; empty if there is none."""
    redo: str
    """The verdict that would be redone, in words; empty if there is none."""
    alarms: tuple[Alarm, ...]
    """In order of gravity."""
    overloaded: tuple[str, ...]
    """Channels that reached the end of their range since the last `Acknowledge`."""
    buses: tuple[BusStatus, ...]
    sensors_alive: int
    """Number of messages of the bench that arrive."""
    sensors_expected: int
    """Number of messages of the bench."""
    losses: Losses
    disk: DiskStatus
    queue: QueueStatus
    session: SessionStatus
    controller: str = ""
    viewers: int = 0
    software: str = ""
    protocol: int = PROTOCOL
    revision: int = 0
    """Revision of the run log, of which `runs`, `notes` and `overrides` are parts."""
    storage: StorageStatus = StorageStatus()
    """Frames that arrive compared with those stored."""
    origin: Origin = Origin.REAL
    """Where the frames come from."""
    begun: str = ""
    """How the campaign follows on one that a crash or a stop has cut: that it goes on, or why a new
    one was begun.  Empty if there was none."""
    proposed: tuple[LeftOut, ...] = ()
    """Runs that the recorder proposes to leave out, of kinds with more runs than planned (the order
    `LeaveOut`)."""

    @property
    def own_session(self) -> str:
        """Path of the session file of this recording; empty if it is of the one before."""
        return self.session.path if self.session.recording == self.recording else ""

    @property
    def outdated(self) -> bool:
        """True if runs, weights or vehicle have changed since the session file was built."""
        return bool(self.own_session) and self.session.revision != self.revision


# The run log apart from the status -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LogNews:
    """The state of the run log as a number, and what has changed since the one before."""

    __pydantic_config__ = _WHEN_USED
    serial: int
    """One more with each change; two more if the change is not sent."""
    runs: tuple[LoggedRun, ...] = ()
    """Runs that are new or changed."""
    notes: tuple[Remark, ...] = ()
    """Notes that are new."""
    overrides: tuple[Override, ...] = ()
    """Overrides that are new."""
    whole: bool = False
    """True if these are all: the answer to `AskLog`."""


@dataclass(frozen=True, slots=True)
class StatusNews:
    """A status as it is published: it does not grow with the number of runs."""

    __pydantic_config__ = _WHEN_USED
    status: Status
    """Without runs, notes and overrides (`daq.control.log_copy`)."""
    log: LogNews


@dataclass(frozen=True, slots=True)
class Setup:
    """Settings that a recorder was started with; of a terminal, those it was started for."""

    origin: Origin
    """Where the frames come from."""
    vehicle: str = ""
    """Name in bench.toml."""
    bench_crc32: int | None = None
    """CRC of bench.toml as read from the file; None if a terminal was given none."""
    dbc_crc32: int | None = None
    """CRC of the DBC; None as before."""
    buses: tuple[str, ...] | None = None
    """Interface and channel of each bus; None if a terminal was given none."""


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

    __pydantic_config__ = _WHEN_USED
    first_bin: int
    """Bin k has time stamps k bin_s .. (k + 1) bin_s; each is sent once, when complete."""
    bin_s: float
    """Width of a bin, s."""
    lanes: tuple[Lane, ...]
    """All of the same number of bins."""


@dataclass(frozen=True, slots=True)
class CheckItem:
    """One line of the bench check (`daq.check.result`); its verdict is OK, WARN or FAIL."""

    verdict: str
    subject: str
    reason: str
    advice: str
    figures: dict[str, float]


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a request."""

    __pydantic_config__ = _WHEN_USED
    number: int
    """Number of the request."""
    error: str = ""
    """One line; empty if the order was carried out."""
    status: Status | None = None
    """Answer to `Hello`, `AskStatus` and every order."""
    live: Live | None = None
    """Answer to `AskHistory`."""
    bench_text: str = ""
    """Answer to `AskBench`."""
    check: tuple[CheckItem, ...] = ()
    """Answer to `AskCheck`."""
    log: LogNews | None = None
    """Answer to `AskLog`; beside a status on the wire, the run log that it is without."""
    setup: Setup | None = None
    """Answer to `AskSetup`."""
    protocol: int = PROTOCOL


REQUEST, REPLY = TypeAdapter(Request), TypeAdapter(Reply)
STATUS, LIVE = TypeAdapter(Status), TypeAdapter(Live)
STATUS_NEWS, LOG = TypeAdapter(StatusNews), TypeAdapter(LogNews)
