"""Keeps the log of runs: events of recording, judging, overriding and undoing, and their fold."""

from .run_log import LoggedRun, LoggedStatus, fold

__all__ = ["LoggedRun", "LoggedStatus", "fold"]
