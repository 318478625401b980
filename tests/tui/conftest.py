"""Commands and screens without a process for each file that they read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tui import output
from tui.output import Stage


@pytest.fixture(autouse=True)
def _in_this_process(request: pytest.FixtureRequest) -> None:
    """Read session files and DBCs here."""
    request.getfixturevalue("without_children")


Stages = dict[str, list[tuple[float, str]]]
"""What each bar of progress has shown: the share that is done, and the words beside it."""


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> Stages:
    """Return what commands show on their bars of progress, by title."""
    shown: Stages = {}

    @contextmanager
    def progress(title: str) -> Iterator[Stage]:
        lines = shown.setdefault(title, [])
        yield lambda done, text="": lines.append((round(done, 9), text))

    monkeypatch.setattr(output, "progress", progress)
    return shown
