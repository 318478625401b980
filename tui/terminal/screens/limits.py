"""Asks what the axles may carry."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from daq.errors import InputError

from ..forms.axle_limits import AxleLimits, keep_limits, parse_limits
from .question import Question

if TYPE_CHECKING:
    from ..app import BenchApp

_WORDS = "Largest permitted axle loads in kg, front and rear, as the papers of the car say"


def ask_limits(app: BenchApp, take: Callable[[AxleLimits], None]) -> None:
    """Ask for the limits, keep them beside the recording, and hand them on."""

    def answered(text: str | None) -> None:
        if text is None:
            return
        try:
            limits = parse_limits(text)
        except InputError as error:
            app.warn(str(error))
            return
        if trouble := keep_limits(app.folder, limits):
            app.warn(trouble)
        take(limits)

    app.push_screen(Question(_WORDS, "1050 980"), answered)
