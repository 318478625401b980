"""Defines the orders and questions that a client may send to a recorder."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from ..runs import Excitation

_Reason = Annotated[str, Field(max_length=500)]
_StatedReason = Annotated[str, Field(min_length=1, max_length=500)]
_Short = Annotated[str, Field(max_length=200)]

# Questions, which any client may ask --------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Hello:
    """Announce a client: a controller may send orders, a viewer may only ask questions."""

    name: str
    """Name of the person, for the journal."""
    control: bool = False
    take_over: bool = False
    """True to take control from the client that has it; else a second controller is refused."""
    attends: bool = True
    """False for one that asks once: it is no viewer, and a demonstration does not go on for it."""


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Ask for the status."""


@dataclass(frozen=True, slots=True)
class AskHistory:
    """Ask for the live samples of the last seconds, so that the lanes begin full."""

    seconds: Annotated[float, Field(gt=0, le=60)] = 10.0


@dataclass(frozen=True, slots=True)
class AskBench:
    """Ask for the present bench.toml."""


@dataclass(frozen=True, slots=True)
class AskCheck:
    """Ask for the bench check over the last seconds of traffic."""

    seconds: Annotated[float, Field(gt=0, le=10)] = 5.0


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

    RUN = "run"
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
    reason: _Reason = ""


@dataclass(frozen=True, slots=True)
class Reject:
    """Reject a run; it is kept."""

    label: str = ""
    """Label of the run; empty for the run being recorded, or else the last one."""
    reason: _Reason = ""


@dataclass(frozen=True, slots=True)
class Undo:
    """Take back the last verdict (of the recorder or of a person)."""


@dataclass(frozen=True, slots=True)
class Redo:
    """Take back the last `Undo`."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Set a mark at the time of the latest frame."""

    text: _Short


@dataclass(frozen=True, slots=True)
class Note:
    """Write a note on the recording, or on one of its runs."""

    text: Annotated[str, Field(min_length=1, max_length=2000)]
    label: str = ""


@dataclass(frozen=True, slots=True)
class OverrideWarning:
    """Continue although the bench check warns; the report names person and reason."""

    subject: _Short
    reason: _StatedReason


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """Switch the overload lamps off."""


Question = Hello | AskStatus | AskHistory | AskBench | AskCheck
"""The orders that a viewer may send; all others need control."""
Order = (
    Question | Start | Configure | Stop | Build | ShutDown | Arm | Pause | Choose
    | Accept | Reject | Undo | Redo | Mark | Note | OverrideWarning | Acknowledge
)  # fmt: skip
