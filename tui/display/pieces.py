"""Parts of the page in addition to its word: alarm, sketch, progress."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from daq import Excitation, Status
from daq.bench import Method
from daq.bumps import BUMPS
from daq.errors import printable

from ..terminal.state.run_words import reason_words

if TYPE_CHECKING:
    from daq import Bench


@dataclass(frozen=True, slots=True)
class AlarmLine:
    """The gravest alarm in words."""

    cue: str
    """Changes when another alarm comes."""
    text: str
    advice: str
    more: int
    """Number of further alarms."""
    speech: str
    """Sentence to speak."""


@dataclass(frozen=True, slots=True)
class Row:
    """Progress of one mass state and kind of bump."""

    mass_state: str
    kind: str
    """The kind of bump in words."""
    accepted: int
    planned: int
    rejected: int
    due: bool
    """True if the next run is one of these."""


@dataclass(frozen=True, slots=True)
class Sketch:
    """The boards to place, or where to push, on the car seen from above."""

    method: Method
    wheels: tuple[bool, bool, bool, bool]
    """Wheels with a board or block, in the order of `Corner`; none for a push."""
    hand: tuple[int, int] | None
    """Place where hands push, forward and to the left of the body's middle; None without a push."""
    legend: str
    """Text of the sketch: the board or block, with its height."""


def alarm_line(status: Status) -> AlarmLine | None:
    """Return the gravest alarm of a status; None if there is none."""
    if not status.alarms:
        return None
    first, *others = status.alarms
    subject = f" {printable(first.subject, 60)}" if first.subject else ""
    what = f"{reason_words(first.code)}{subject}"
    return AlarmLine(
        f"{first.code} {first.subject} {first.since_ns}",
        f"{reason_words(first.code).upper()}{subject}: {printable(first.text, 160)}",
        printable(first.advice, 160),
        len(others),
        f"Alarm: {what}.",
    )


def rows_of(status: Status) -> tuple[Row, ...]:
    """Return the progress of a campaign."""
    step = status.due.step if status.due else None
    here = (step.mass_state, step.excitation) if step else None
    return tuple(
        Row(
            printable(tally.mass_state, 20),
            tally.excitation.words,
            tally.accepted,
            tally.planned,
            tally.rejected,
            (tally.mass_state, tally.excitation) == here,
        )
        for tally in status.tallies
    )


def sketch_of(bench: Bench, excitation: Excitation) -> Sketch:
    """Return the sketch of a bump; a push that cannot make it is a drop."""
    procedure = bench.procedure
    height = f"{procedure.bump_height_m * 1e3:g} mm"
    bump = BUMPS[excitation]
    fl, fr, rl, rr = (share > 0.0 for share in bump.shares)
    if procedure.method is Method.PUSH and bump.hand is not None:
        none = (False, False, False, False)
        return Sketch(Method.PUSH, none, bump.hand, f"push {height} down here")
    if procedure.method is Method.ROLL_OVER:
        return Sketch(Method.ROLL_OVER, (fl, fr, rl, rr), None, f"board, {height}")
    return Sketch(Method.DROP, (fl, fr, rl, rr), None, f"wheel on a block, {height}")
