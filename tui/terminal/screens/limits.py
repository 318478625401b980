"""Asks for the permitted axle loads."""

from __future__ import annotations

from collections.abc import Callable

from daq import InputError

from ..forms.axle_limits import AxleLimits, keep_limits, parse_limits
from .base import BenchScreen
from .dialogs import Question

_WORDS = "Largest permitted axle loads in kg, front and rear, from the papers of the car"


def ask_limits(screen: BenchScreen, take: Callable[[AxleLimits], None]) -> None:
    """Ask for the limits, store them in the recorder's folder, and pass them to `take`."""

    def answered(text: str | None) -> None:
        if text is None:
            return
        app = screen.bench_app
        try:
            limits = parse_limits(text)
        except InputError as error:
            app.warn(str(error))
            return
        if trouble := keep_limits(app.folder, limits):
            app.warn(trouble)
        take(limits)

    screen.app.push_screen(Question(_WORDS, "1050 980"), answered)
