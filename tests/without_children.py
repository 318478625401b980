"""Asks cantools in this process, as its child does in one of its own.

A child costs half a second and more.  What the process wall is for is tested in
`tests.dbc.test_witness` and the whole commands of `tests.flow`.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from types import SimpleNamespace
from typing import IO

import pytest

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


@pytest.fixture
def without_children(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let DBCs be witnessed in this process."""
    kept = {name: getattr(subprocess, name) for name in ("PIPE", "DEVNULL", "TimeoutExpired")}
    monkeypatch.setattr(second_reader, "subprocess", SimpleNamespace(Popen=_Cantools, **kept))
