"""Defines the questions of a proposal to its user, and the answers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from dbc.units import known_si, to_si

from ..channels import Quantity
from ..vehicle import Corner
from .guess_map import Asked, Guess

YES, NO, BODY = "y", "n", "body"
_CORNERS = " ".join(Corner)
HINTS = {
    Asked.RIGHT: "y",
    Asked.CORNER: f"y, {_CORNERS} or body",
    Asked.WHEEL: f"y, {_CORNERS}, or n if it is not a travel",
    Asked.WHERE: f"{_CORNERS}, or n if it is not a travel",
    Asked.FORWARD: "y or an axis as -x",
    Asked.UNIT: "y or a unit",
    Asked.OURS: "y or n",
}
"""Texts of the possible answers, by kind."""
AT_WHEEL = frozenset({Asked.CORNER, Asked.WHEEL, Asked.WHERE})
"""Kinds of questions that are about one channel, not about its sensor."""
_AXIS = re.compile(r"[+-]?[xyz]")


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
            case Asked.WHEEL | Asked.WHERE:
                return text.upper() * (text.upper() in set(Corner))
            case Asked.CORNER:
                return lower if lower == BODY else text.upper() * (text.upper() in set(Corner))
            case Asked.FORWARD if _AXIS.fullmatch(lower):
                return lower if len(lower) == 2 else f"+{lower}"
            case Asked.UNIT:
                known = known_si(text)
                return text if known is not None and known.unit != "1" else ""
        return ""


Answers = Mapping[Question, str]
"""Answers as `Question.understood` returns them."""
NO_ANSWERS: Answers = MappingProxyType({})


def stated_forward(answers: Answers) -> dict[str, str]:
    """Return the axes that point forward, by sensor, where they are stated."""
    return {
        question.sensor: text
        for question, text in answers.items()
        if question.asked is Asked.FORWARD and text != YES
    }


def answered(guess: Guess, answer: str) -> Guess:
    """Return a guess with the answer to its question."""
    sure = replace(guess, ask="")
    if answer == YES:
        return sure
    if guess.asked is Asked.UNIT:
        tare = guess.tare
        if tare is not None:  # the reading, in the guessed unit
            tare *= to_si(answer).factor / to_si(guess.unit).factor
        return replace(sure, unit=answer, tare=tare)
    if guess.asked not in AT_WHEEL:
        return guess
    if answer == BODY:
        return replace(sure, quantity=Quantity.BODY_ACCELERATION, corner=None)
    if answer == NO:
        return replace(sure, quantity=Quantity.UNUSED, corner=None)
    is_travel = guess.asked is not Asked.CORNER
    quantity = Quantity.SUSPENSION_TRAVEL if is_travel else Quantity.HUB_ACCELERATION
    return replace(sure, quantity=quantity, corner=Corner(answer))
