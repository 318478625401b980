"""What commands show on their bars of progress."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tui import output
from tui.cli import run
from tui.output import Stage

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


def said(capsys: pytest.CaptureFixture[str], *arguments: str, code: int) -> tuple[str, str]:
    """Run a command and return what it writes to stdout and stderr."""
    assert run(list(arguments)) == code, capsys.readouterr().err
    out, err = capsys.readouterr()
    return out, err
