"""Defines a guess at what a signal measures, the question about it, its answer and its mark."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from dbc.errors import printable
from dbc.finding import Finding, Severity
from dbc.units import known_si, to_si

from ..channels import Quantity
from ..vehicle import Corner

YES, NO, BODY = "y", "n", "body"
_CORNERS = " ".join(Corner)
_AXIS = re.compile(r"[+-]?[xyz]")


class Asked(StrEnum):
    """Kind of a question; the value states its possible answers."""

    RIGHT = "y"
    """Asks if the guess is right."""
    CORNER = f"y, {_CORNERS} or body"
    """Corner of an acceleration."""
    WHEEL = f"y, {_CORNERS}, or n if it is not a travel"
    """Wheel of a travel, which is guessed."""
    WHERE = f"{_CORNERS}, or n if it is not a travel"
    """Wheel of a travel, which nothing shows."""
    FORWARD = "y or an axis as -x"
    """Axis that points forward."""
    UNIT = "y or a unit"
    OURS = "y or n"
    """Asks if the sensor is one of this bench."""

    @property
    def is_of_channel(self) -> bool:
        """True if the answer counts for one channel, not for all of its sensor."""
        return self in (Asked.CORNER, Asked.WHEEL, Asked.WHERE)


@dataclass(frozen=True, slots=True)
class Question:
    """A question about an uncertain guess."""

    line: str
    """The question, with its subject."""
    asked: Asked = Asked.RIGHT
    """Kind of the answer."""
    sensor: str = ""
    """Sensor that the question is about; empty if the bench has no list of sensors."""

    def understood(self, typed: str) -> str:
        """Return an answer in the form that a proposal uses; empty if it is not a valid answer."""
        text = typed.strip()
        lower = text.lower()
        if lower in ("y", "yes") and self.asked is not Asked.WHERE:
            return YES
        match self.asked:
            case Asked.WHEEL | Asked.WHERE | Asked.OURS if lower in ("n", "no"):
                return NO
            case Asked.CORNER if lower == BODY:
                return BODY
            case Asked.CORNER | Asked.WHEEL | Asked.WHERE if text.upper() in set(Corner):
                return text.upper()
            case Asked.FORWARD if _AXIS.fullmatch(lower):
                return lower if len(lower) == 2 else f"+{lower}"
            case Asked.UNIT if (known := known_si(text)) is not None and known.unit != "1":
                return text
        return ""


Answers = Mapping[Question, str]
"""Answers as `Question.understood` returns them."""


@dataclass(frozen=True, slots=True)
class Guess:
    """A guess at what a signal measures."""

    quantity: Quantity
    """Guessed quantity."""
    corner: Corner | None
    """Guessed wheel."""
    sign: int
    """Sign, -1 if gravity shows that the sensor is upside down."""
    why: str
    """Reasons for the guess."""
    ask: str = ""
    """Question to the user about an uncertain guess; empty if it is certain."""
    asked: Asked = Asked.RIGHT
    """Kind of the answer."""
    unit: str = ""
    """Unit of the signal if the database states none."""
    is_proven: bool = False
    """True if pushes on the corners have proven corner and sign."""
    tare: float | None = None
    """Travel at rest, SI, with the sign; None if it was not measured."""

    def answered(self, answer: str) -> Guess:
        """Return the guess with an answer, as `Question.understood` returns it."""
        sure = replace(self, ask="")
        if answer == YES:
            return sure
        if self.asked is Asked.UNIT:
            tare = self.tare
            if tare is not None:  # the reading, in the guessed unit
                tare *= to_si(answer).factor / to_si(self.unit).factor
            return replace(sure, unit=answer, tare=tare)
        if not self.asked.is_of_channel:  # it changes the guesses of its sensor elsewhere
            return self
        if answer == BODY:
            return replace(sure, quantity=Quantity.BODY_ACCELERATION, corner=None)
        if answer == NO:
            return replace(sure, quantity=Quantity.UNUSED, corner=None)
        is_hub = self.asked is Asked.CORNER
        quantity = Quantity.HUB_ACCELERATION if is_hub else Quantity.SUSPENSION_TRAVEL
        return replace(sure, quantity=quantity, corner=Corner(answer))


ASK = "# ASK: "
"""Beginning of a mark in bench.toml or channel map, on a separate line or after a value."""


def open_questions(text: str, name: str) -> list[Finding]:
    """Return a warning for each mark that is still in a bench.toml or channel map of this name."""
    advice = "find the answer, correct the lines next to the mark if necessary, and delete the mark"
    return [
        Finding("ask", Severity.WARNING, f"asks: {printable(ask, 160)}", f"{name}:{number}", advice)
        for number, line in enumerate(text.splitlines(), start=1)
        for _, mark, ask in [line.partition(ASK)]
        if mark
    ]
