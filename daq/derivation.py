"""Session files derived beside the recording: one process at a time, started and polled."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from .errors import printable
from .messages import SessionState, SessionStatus

_ENDING_S = 1.0


@dataclass(frozen=True, slots=True)
class _Job:
    target: Path
    segments: tuple[Path, ...]


class Derivation:
    """Derives session files, one after the other; HDF5 never runs within the recorder."""

    def __init__(self) -> None:
        self._jobs: deque[_Job] = deque()
        self._job: _Job | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._told: IO[bytes] | None = None
        self.status = SessionStatus()

    def begin(self, target: Path, segments: Sequence[Path]) -> None:
        """Have the session file of these segments built; never raises."""
        job = _Job(target, tuple(segments))
        if job not in self._jobs:
            self._jobs.append(job)
        self.status = SessionStatus(SessionState.BUILDING, str(target))
        self.poll()

    def poll(self) -> None:
        """See how far it is; to be called now and then."""
        if self._process is not None:
            code = self._process.poll()
            if code is None:
                return
            self._finish(code)
        if self._process is None and self._jobs:
            self._start(self._jobs.popleft())

    def close(self) -> None:
        """End what is under way: a session file is whole or absent, and can be built any time."""
        self._jobs.clear()
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_ENDING_S)
            if self._process.poll() is None:
                self._process.kill()
                self._process.wait()
            self._finish(-1)

    def _start(self, job: _Job) -> None:
        self._job = job
        command = [sys.executable, "-m", "daq.derive", str(job.target), *map(str, job.segments)]
        try:
            self._told = tempfile.TemporaryFile()  # not a pipe: nobody reads while it runs
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=self._told,
                stderr=subprocess.STDOUT,
                process_group=0,  # a Ctrl-C at the terminal is not for it
            )
        except OSError as error:
            self._finish_with(SessionState.FAILED, error.strerror or str(error))

    def _finish(self, code: int) -> None:
        said = ""
        if self._told is not None:
            with suppress(OSError, ValueError):
                self._told.seek(0)
                said = self._told.read().decode("utf-8", "replace").strip()
            self._told.close()
        last = said.splitlines()[-1] if said else ""
        if code == 0:
            self._finish_with(SessionState.READY, _loss(last))
        else:
            self._finish_with(SessionState.FAILED, printable(last or f"ended with code {code}"))

    def _finish_with(self, state: SessionState, text: str) -> None:
        assert self._job is not None  # it was begun
        if not self._jobs:
            self.status = SessionStatus(state, str(self._job.target), text)
        self._process = self._told = self._job = None


def _loss(line: str) -> str:
    """Return what the journal has lost, as the process told in its JSON line."""
    with suppress(ValueError, AttributeError):
        return str(json.loads(line).get("lost", ""))
    return ""
