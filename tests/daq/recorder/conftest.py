"""A bench whose runs come fast, and session files that are built without another process."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest

from daq.session.build import main

from ..recorder_run import quick, two

__all__ = ["quick", "two"]


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
