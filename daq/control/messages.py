"""Defines the messages between a recorder and its clients: typed, JSON on the wire.

A client sends an `Order` and gets a `Reply`; all get `Status` and `Live` ten times per second.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from pydantic import ConfigDict, TypeAdapter

from dbc.words import Finding

from ..bench.campaign import Origin, Step
from ..runlog import LoggedNote, LoggedRun, Override
from ..runs import Excitation, Losses

if TYPE_CHECKING:
    from ..bench.config import Bench

PROTOCOL = 7
"""Version of the messages, increased when an older client could misread them."""
_WHEN_USED = ConfigDict(defer_build=True)
"""Builds validators at the first message, so that they do not delay the first screen."""


class Phase(StrEnum):
    """State of the run loop."""

    IDLE = "idle"
    """Not armed; frames are still recorded."""
    WAITING = "waiting"
    """Armed by the operator, but the car is not at rest yet or the pre-trigger is not full."""
    ARMED = "armed"
    TRIGGERED = "triggered"
    DECAY = "decay"
    ACCEPTED = "accepted"
    """The last run was accepted; lasts until the countdown ends."""
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


# Status -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Alarm:
    """A fault that is present now."""

    code: str
    """One of `daq.alarms.texts.EXPLAINED`."""
    subject: str
    """The bus, message, channel or folder; empty for the recorder itself."""
    text: str
    """The fault in words, with numbers."""
    advice: str
    since_ns: int
    """Wall-clock time since which it is present, ns since 1970."""
    count: int = 0
    """Number of events or frames."""


@dataclass(frozen=True, slots=True)
class BusStatus:
    """One bus; counts are since the start."""

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
    """The journal, and the free space on its disk."""

    free_bytes: int
    journal_bytes: int
    recorded_frames: int
    """Frames of this recording, or of the time since the last one, on the disk (fdatasync'ed): the
    only meaning of "recorded"."""
    lag_s: float
    """Age of the oldest received frame that is not on the disk, s."""
    held_frames: int = 0
    """Number of frames in memory because the disk refuses them."""
    failed: str = ""
    """Reason why the disk refuses data."""
    dropped_frames: int = 0
    """Frames lost because neither disk nor memory had room; `disk_gap` events report them."""
    warning: str = ""
    """A fault although the disk stores everything: a file was removed, or a write failed and was
    repeated in another file."""
    total_bytes: int = 0


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """The queue between readers and writer, in blocks; `high` is the maximum since the start."""

    blocks: int
    high: int
    room: int


@dataclass(frozen=True, slots=True)
class StorageStatus:
    """Numbers of frames that arrived and that are on the disk, since the start of the recorder."""

    received_frames: int = 0
    """Of all buses, with those that found no room in the queue."""
    stored_frames: int = 0
    """Of all campaigns and of the times between them."""
    late_s: float = 0.0
    """Time for which frames have arrived and none was stored, s."""


@dataclass(frozen=True, slots=True)
class Due:
    """The next step of the campaign, or the present one."""

    step: Step
    """The step; its `label` is that of the next attempt."""
    accepted: int
    planned: int
    rejected: int
    """Numbers of runs of this mass state and excitation."""
    instruction: str


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
    """The session file of the recording (or, after `Stop`, of the previous one)."""

    state: SessionState = SessionState.NONE
    path: str = ""
    text: str = ""
    """Reason of a failure, or the losses of the journal."""
    recording: str = ""
    """Identity of the recording of which it is (`Status.recording`)."""
    revision: int = 0
    """Revision of the run log from which it was built."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The complete state of a recorder: a terminal that connects needs nothing else.

    The recording fills it in; the recorder adds what has a default, and the server its clients.
    """

    __pydantic_config__ = _WHEN_USED
    wall_ns: int
    """The host's wall-clock time, ns since 1970."""
    t_ns: int
    """Time stamp of the latest frame, ns; 0 before the first."""
    recording: str = ""
    """Identity of the campaign's recording; changes with `Start`.  Empty between two campaigns,
    after `Stop`, although frames are also recorded then."""
    folder: str = ""
    vehicle: str
    bench_crc32: int
    """CRC of the present bench.toml: a client asks for the file when this changes."""
    phase: Phase
    phase_s: float
    countdown_s: float | None
    """Time until the next run is armed, s; None if no run will be armed."""
    not_at_rest: tuple[str, ...]
    """Trigger channels that prevent arming."""
    bump_ns: int
    """Time stamp of the last bump, ns; 0 if there was none."""
    peak_left: float | None
    """Ratio of the present motion to its peak, in the phase DECAY; else None."""
    halted: str
    """Code for which the run loop stopped by itself, that of three rejects in a row; else empty."""
    due: Due | None
    """The step that is due; None when the campaign is complete."""
    tallies: tuple[Tally, ...]
    """In the order of the campaign."""
    runs: tuple[LoggedRun, ...]
    notes: tuple[LoggedNote, ...]
    overrides: tuple[Override, ...]
    undo: str
    redo: str
    """The verdicts that `Undo` and `Redo` would change, in words; empty if there is none."""
    alarms: tuple[Alarm, ...]
    """In order of severity."""
    overloaded: tuple[str, ...]
    """Channels that reached the end of their range since the last `Acknowledge`."""
    buses: tuple[BusStatus, ...]
    sensors_alive: int
    sensors_expected: int
    """Numbers of messages of the bench: those that arrive, and all."""
    losses: Losses
    disk: DiskStatus = DiskStatus(0, 0, 0, 0.0)
    queue: QueueStatus = QueueStatus(0, 0, 0)
    session: SessionStatus = SessionStatus()
    controller: str = ""
    viewers: int = 0
    software: str = ""
    protocol: int = PROTOCOL
    revision: int = 0
    """Revision of the run log, of which `runs`, `notes` and `overrides` are parts."""
    storage: StorageStatus = StorageStatus()
    origin: Origin = Origin.REAL
    begun: str = ""
    """After a crash or a stop, whether the interrupted campaign is continued, or why a new one was
    begun.  Empty if no campaign was interrupted."""

    @property
    def own_session(self) -> str:
        """Path of the session file of this recording; empty if the file is of the previous one."""
        return self.session.path if self.session.recording == self.recording else ""

    @property
    def outdated(self) -> bool:
        """True if runs, weights or vehicle have changed since the session file was built."""
        return bool(self.own_session) and self.session.revision != self.revision


@dataclass(frozen=True, slots=True)
class Setup:
    """The settings with which a recorder was started, or which a terminal expects."""

    origin: Origin
    bench_crc32: int | None = None
    """CRC of bench.toml as read from the file and its DBC; None if a terminal expects none."""


def setup_of(bench: Bench) -> Setup:
    """Return the setup of a recorder that is started with a bench."""
    return Setup(bench.origin, zlib.crc32((bench.text + bench.dbc_text).encode()))


def differences(running: Setup, wanted: Setup) -> tuple[str, ...]:
    """Return in words how a running recorder differs from the wanted one; empty if it does not."""
    words = {
        Origin.REAL: "a real bus",
        Origin.SIMULATED: "a simulated car",
        Origin.REPLAYED: "a replayed recording",
    }
    texts = []
    if running.origin is not wanted.origin:
        texts.append(f"it records {words[running.origin]}, not {words[wanted.origin]}")
    if wanted.bench_crc32 is not None and running.bench_crc32 != wanted.bench_crc32:
        texts.append("it was started with another bench.toml or DBC")
    return tuple(texts)


# Live data and answers ----------------------------------------------------------------------------


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
    lanes: tuple[Lane, ...]


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to an order."""

    __pydantic_config__ = _WHEN_USED
    error: str = ""
    """Error in one line; empty if the order was carried out."""
    status: Status | None = None
    """Answer to `Hello`, `AskStatus` and every order; None before the first status."""
    bench_text: str = ""
    """Answer to `AskBench`."""
    check: tuple[Finding, ...] = ()
    """Answer to `AskCheck`."""
    setup: Setup | None = None
    """Answer to `Hello`: the settings with which the recorder was started."""


REPLY, STATUS, LIVE = TypeAdapter(Reply), TypeAdapter(Status), TypeAdapter(Live)


# Questions, which any client may ask --------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Hello:
    """Announce a client: a controller may send orders, a viewer may only ask questions."""

    name: str
    """Name of the person, for the journal."""
    control: bool = False
    take_over: bool = False
    """True to take control from the client that has it; else a second controller is refused."""


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Ask for the status."""


@dataclass(frozen=True, slots=True)
class AskBench:
    """Ask for the present bench.toml."""


@dataclass(frozen=True, slots=True)
class AskCheck:
    """Ask for the bench check over the last seconds of traffic."""

    seconds: float


# Orders on the recording --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Start:
    """Begin a campaign; end the present one."""

    bench_text: str = ""
    """A new bench.toml (same buses and DBC); empty keeps the present one."""


@dataclass(frozen=True, slots=True)
class Configure:
    """Change bench.toml within the recording: vehicle, weights, facts, signs, tares, campaign."""

    bench_text: str


@dataclass(frozen=True, slots=True)
class Stop:
    """End the campaign and derive its session file; recording continues."""


@dataclass(frozen=True, slots=True)
class Build:
    """Derive the session file from the recording so far; recording continues."""


@dataclass(frozen=True, slots=True)
class ShutDown:
    """Write what is in the queue, seal the journal and end the recorder."""


# Orders on the runs -------------------------------------------------------------------------------


class Until(StrEnum):
    """Extent of an order to arm."""

    EXCITATION = "excitation"
    """Until the repeats of this excitation are accepted; then a person moves the boards."""
    COMPLETE = "complete"


@dataclass(frozen=True, slots=True)
class Arm:
    """Wait for bumps and count them as runs."""

    until: Until = Until.EXCITATION
    mass_state: str = ""
    """The mass state that the sender has seen on the car: needed if the next run has another mass
    state than the last one, unless all runs are armed together."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Count no bump until armed again; frames are still recorded."""


@dataclass(frozen=True, slots=True)
class Choose:
    """Make this the next run, also beyond the planned repeats; then the campaign continues."""

    mass_state: str
    excitation: Excitation


@dataclass(frozen=True, slots=True)
class Accept:
    """Accept a rejected run, with a reason."""

    label: str
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Reject:
    """Reject a run; it is kept."""

    label: str = ""
    """Label of the run; empty for the run being recorded, or else the last one."""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Undo:
    """Take back the last verdict (of the recorder or of a person)."""


@dataclass(frozen=True, slots=True)
class Redo:
    """Take back the last `Undo`."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Set a mark at the time of the latest frame."""

    text: str


@dataclass(frozen=True, slots=True)
class Note:
    """Write a note on the recording, or on one of its runs."""

    text: str
    label: str = ""


@dataclass(frozen=True, slots=True)
class OverrideWarning:
    """Continue although the bench check warns; the report names person and reason."""

    subject: str
    reason: str


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Switch the overload lamps off."""


Question = Hello | AskStatus | AskBench | AskCheck
"""The orders that a viewer may send; all others need control."""
Order = (
    Question | Start | Configure | Stop | Build | ShutDown | Arm | Pause | Choose
    | Accept | Reject | Undo | Redo | Mark | Note | OverrideWarning | Acknowledge
)  # fmt: skip
