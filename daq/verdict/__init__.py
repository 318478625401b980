"""Judges a run immediately after its end, in plain words."""

from .judge import judge
from .motion import peak_left
from .window import RunMeasure, RunWindow
from .words import WORDS, Words

__all__ = ["WORDS", "RunMeasure", "RunWindow", "Words", "judge", "peak_left"]
