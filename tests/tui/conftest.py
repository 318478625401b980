"""What commands write and show on their bars of progress; coroutines as tests."""

from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

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
        yield lambda done, text: lines.append((round(done, 9), text))

    monkeypatch.setattr(output, "progress", progress)
    return shown


def said(capsys: pytest.CaptureFixture[str], *arguments: str, code: int) -> tuple[str, str]:
    """Run a command and return what it writes to stdout and stderr."""
    assert run(list(arguments)) == code, capsys.readouterr().err
    out, err = capsys.readouterr()
    return out, err


def answered(
    capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0
) -> tuple[dict[str, Any], str]:
    """Run a command with --json and return its document and what it writes to stderr."""
    out, err = said(capsys, *arguments, "--json", code=code)
    document = json.loads(out)
    assert isinstance(document, dict)
    return document, err


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a coroutine of a test in a loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    wanted = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in wanted}))
    return True
