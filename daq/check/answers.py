"""Questions of a proposal to its user, and the answers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from dbc.errors import InputError
from dbc.units import to_si

from ..channels import Quantity
from ..vehicle import Corner
from .guess_map import Asked, Guess

YES, NO, BODY = "y", "n", "body"
_CORNERS = " ".join(Corner)
HINTS = {
    Asked.RIGHT: "y",
    Asked.CORNER: f"y, {_CORNERS} or body",
    Asked.WHEEL: f"y, {_CORNERS}, or n if it is no travel",
    Asked.WHERE: f"{_CORNERS}, or n if it is no travel",
    Asked.FORWARD: "y or an axis as -x",
    Asked.UNIT: "y or a unit",
    Asked.OURS: "y or n",
}
"""Answers that are understood."""
AT_WHEEL = frozenset({Asked.CORNER, Asked.WHEEL, Asked.WHERE})
"""Questions about one channel, whatever sensor it is of."""
_AXIS = re.compile(r"[+-]?[xyz]")


@dataclass(frozen=True, slots=True)
class Question:
    """A question about a guess that is not sure."""

    line: str
    """The question, with what it is about."""
    asked: Asked = Asked.RIGHT
    """Kind of the answer."""
    sensor: str = ""
    """Sensor that it is about; empty if the bench has no list of sensors."""

    def understood(self, typed: str) -> str:
        """Return an answer in the form that a proposal takes; empty if it is none."""
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
                return text * _is_unit(text)
        return ""


def _is_unit(text: str) -> bool:
    try:
        return to_si(text).unit != "1"
    except InputError:
        return False


Answers = Mapping[Question, str]
"""Answers as `Question.understood` returns them."""
NO_ANSWERS: Answers = MappingProxyType({})


def stated_forward(answers: Answers) -> dict[str, str]:
    """Return the axes that point forward, by sensor, as far as they are stated."""
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
        if tare is not None:  # as it was read, in the unit that was guessed
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
