"""A bench whose runs come fast, and session files that are built without another process."""

from __future__ import annotations

import io
from dataclasses import replace
from types import SimpleNamespace

import pytest

from daq.bench.config import Bench
from daq.recorder import recording as judging
from daq.session.build import main
from daq.verdict.window import RunMeasure


@pytest.fixture
def quick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a bench whose runs come thick and fast; its judge lets everything pass."""
    monkeypatch.setattr(judging, "judge", lambda *_: ((), RunMeasure()))
    return replace(bench, campaign=replace(bench.campaign, accept_after_s=0.1))


@pytest.fixture
def built_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Build session files in this process, whose imports are made already."""

    class Built:
        def __init__(self, command: list[str], **_: object) -> None:
            said = io.StringIO()
            self.returncode = main(command[3:], said)
            self.output = said.getvalue().encode()

        def kill(self) -> None: ...

        def communicate(self) -> tuple[bytes, None]:
            return self.output, None

    # Of the recorder alone: libraries start processes, too.
    started = SimpleNamespace(Popen=Built, DEVNULL=None, PIPE=None, STDOUT=None)
    monkeypatch.setattr("daq.recorder.recorder.subprocess", started)
