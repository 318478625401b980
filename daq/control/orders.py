"""Defines the orders and questions that a client may send to a recorder.

Each has its name in `order`, by which it is read back from JSON (`daq.control.messages`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from ..runs import Excitation


class Until(StrEnum):
    """Extent of an order to arm."""

    RUN = "run"
    EXCITATION = "excitation"
    """Until the repeats of this excitation are accepted; then a person moves the boards."""
    COMPLETE = "complete"


@dataclass(frozen=True, slots=True)
class Hello:
    """Announce a client: a controller may send orders, a viewer may only ask questions."""

    name: str
    """Name of the person, for the journal."""
    control: bool = False
    """True to be the controller."""
    take_over: bool = False
    """True to take control from the client that has it; else a second controller is refused."""
    attends: bool = True
    """False for one that asks once: it is no viewer, and a demonstration does not go on for it."""
    order: Literal["hello"] = "hello"


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Ask for the status."""

    order: Literal["status"] = "status"


@dataclass(frozen=True, slots=True)
class AskHistory:
    """Ask for the live samples of the last seconds, so that the lanes begin full."""

    seconds: Annotated[float, Field(gt=0, le=60)] = 10.0
    order: Literal["history"] = "history"


@dataclass(frozen=True, slots=True)
class AskBench:
    """Ask for the present bench.toml."""

    order: Literal["bench"] = "bench"


@dataclass(frozen=True, slots=True)
class AskSetup:
    """Ask for the settings with which the recorder was started."""

    order: Literal["setup"] = "setup"


@dataclass(frozen=True, slots=True)
class AskCheck:
    """Ask for the bench check over the last seconds of traffic."""

    seconds: Annotated[float, Field(gt=0, le=10)] = 5.0
    order: Literal["check"] = "check"


@dataclass(frozen=True, slots=True)
class Start:
    """Begin a campaign; end the present one."""

    bench_text: str = ""
    """A new bench.toml (same buses and DBC); empty keeps the present one."""
    order: Literal["start"] = "start"


@dataclass(frozen=True, slots=True)
class Configure:
    """Change bench.toml within the recording: vehicle, weights, facts, signs, tares, campaign."""

    bench_text: str
    order: Literal["configure"] = "configure"


@dataclass(frozen=True, slots=True)
class Stop:
    """End the campaign and derive its session file; recording continues."""

    order: Literal["stop"] = "stop"


@dataclass(frozen=True, slots=True)
class Build:
    """Derive the session file from the recording so far; recording continues."""

    order: Literal["build"] = "build"


@dataclass(frozen=True, slots=True)
class Arm:
    """Wait for bumps and count them as runs."""

    until: Until = Until.EXCITATION
    mass_state: str = ""
    """The mass state that the sender has seen on the car: needed if the next run has another mass
    state than the last one, unless all runs are armed together."""
    order: Literal["arm"] = "arm"


@dataclass(frozen=True, slots=True)
class Pause:
    """Count no bump until armed again; frames are still recorded."""

    order: Literal["pause"] = "pause"


@dataclass(frozen=True, slots=True)
class Choose:
    """Make this the next run, also beyond the planned repeats; then the campaign continues."""

    mass_state: str
    excitation: Excitation
    order: Literal["choose"] = "choose"


@dataclass(frozen=True, slots=True)
class Accept:
    """Accept a rejected run, with a reason."""

    label: str
    reason: Annotated[str, Field(max_length=500)] = ""
    order: Literal["accept"] = "accept"


@dataclass(frozen=True, slots=True)
class Reject:
    """Reject a run; it is kept."""

    label: str = ""
    """Label of the run; empty for the run being recorded, or else the last one."""
    reason: Annotated[str, Field(max_length=500)] = ""
    order: Literal["reject"] = "reject"


@dataclass(frozen=True, slots=True)
class Undo:
    """Take back the last verdict (of the recorder or of a person)."""

    order: Literal["undo"] = "undo"


@dataclass(frozen=True, slots=True)
class LeaveOut:
    """Reject all runs that the recorder proposes to leave out (`Status.proposed`)."""

    order: Literal["leave_out"] = "leave_out"


@dataclass(frozen=True, slots=True)
class Redo:
    """Take back the last `Undo`."""

    order: Literal["redo"] = "redo"


@dataclass(frozen=True, slots=True)
class Mark:
    """Set a mark at the time of the latest frame."""

    text: Annotated[str, Field(max_length=200)]
    order: Literal["mark"] = "mark"


@dataclass(frozen=True, slots=True)
class Note:
    """Write a note on the recording, or on one of its runs."""

    text: Annotated[str, Field(min_length=1, max_length=2000)]
    label: str = ""
    order: Literal["note"] = "note"


@dataclass(frozen=True, slots=True)
class OverrideWarning:
    """Continue although the bench check warns; the report names person and reason."""

    subject: Annotated[str, Field(max_length=200)]
    reason: Annotated[str, Field(min_length=1, max_length=500)]
    order: Literal["override"] = "override"


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Switch the overload lamps off."""

    order: Literal["acknowledge"] = "acknowledge"


@dataclass(frozen=True, slots=True)
class ShutDown:
    """Write what is in the queue, seal the journal and end the recorder."""

    order: Literal["shutdown"] = "shutdown"


Order = Annotated[
    Hello
    | AskStatus
    | AskHistory
    | AskBench
    | AskSetup
    | AskCheck
    | Start
    | Configure
    | Stop
    | Build
    | Arm
    | Pause
    | Choose
    | Accept
    | Reject
    | Undo
    | LeaveOut
    | Redo
    | Mark
    | Note
    | OverrideWarning
    | Acknowledge
    | ShutDown,
    Field(discriminator="order"),
]
QUESTIONS = (Hello, AskStatus, AskHistory, AskBench, AskSetup, AskCheck)
"""Messages that a viewer may send; all others need control."""
