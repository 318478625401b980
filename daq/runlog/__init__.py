"""Keeps the log of runs: events of recording, judging, overriding and undoing, and their fold."""

from .fold import fold
from .runlog import LoggedRun, LoggedStatus

__all__ = ["LoggedRun", "LoggedStatus", "fold"]
