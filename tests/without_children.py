"""Reads session files and asks cantools in this process, as their children do in one of their own.

A child costs half a second and more.  What the process walls are for is tested where they stand:
`tests.daq.session.test_session_guard`, `tests.dbc.test_witness` and the whole commands of
`tests.flow`; everywhere else the same code runs here.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import IO

import pytest

from daq.session import read, validate
from daq.session.sandbox import child as session_child
from daq.session.sandbox.wire import receive
from daq.session.schema import max_total_bytes
from daq.session.tree import Group, Part
from dbc.witness import second_reader
from dbc.witness.child import answer


class _Cantools:
    """The child of `second_reader` as far as it is used, without a process."""

    returncode = 0

    def __init__(self, _: Sequence[str], stdin: IO[str], **__: object) -> None:
        self._said = json.dumps(answer(json.load(stdin)))

    def communicate(self, timeout: float | None = None) -> tuple[str, None]:
        return self._said, None

    def kill(self) -> None:
        """Nothing runs."""


def _load(path: Path | str, part: Part = Part.WHOLE) -> Group:
    """Read a session file as `guard.load_guarded`, through the child's code and the wire."""
    stream = BytesIO()
    size = Path(path).stat().st_size if Path(path).is_file() else 0
    session_child.main(stream, str(path), 0, 0, part)
    stream.seek(0)
    return receive(stream, max_total_bytes(size))


@pytest.fixture
def without_children(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let session files be read and DBCs be witnessed in this process."""
    monkeypatch.setattr(session_child, "limit", lambda *_: None)
    monkeypatch.setattr(read, "load_guarded", _load)
    monkeypatch.setattr(validate, "load_guarded", _load)
    kept = {name: getattr(subprocess, name) for name in ("PIPE", "DEVNULL", "TimeoutExpired")}
    monkeypatch.setattr(second_reader, "subprocess", SimpleNamespace(Popen=_Cantools, **kept))
