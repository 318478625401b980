"""Builds session files during the recording, each in a process that is started and polled."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..control.messages import SessionState, SessionStatus
from ..derive.build_session import DONE, DONE_WITH_LOSS
from ..errors import printable

PATIENCE_S = 600.0
"""Time, s, after which building a session file counts as hung, for an empty journal."""
SLOWEST_BYTES_PER_S = 1e6
"""Rate at which the allowed time grows with the journal, bytes/s; the usual rate is a hundred times
higher."""
_ENDING_S = 1.0
"""Time, s, that a process gets to end before it is killed."""


@dataclass(frozen=True, slots=True)
class _Job:
    target: Path
    segments: tuple[Path, ...]
    recording: str
    revision: int

    def status(self, state: SessionState, text: str = "") -> SessionStatus:
        return SessionStatus(state, str(self.target), text, self.recording, self.revision)


class Derivation:
    """Builds session files, one after another; HDF5 never runs within the recorder."""

    def __init__(self) -> None:
        self._jobs: deque[_Job] = deque()
        self._job: _Job | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._deadline_s: float  # of the process, since it was started
        self._hung = ""
        self.status = SessionStatus()

    def begin(self, target: Path, segments: Sequence[Path], recording: str, revision: int) -> None:
        """Start building the session file of a recording; never raises.

        `recording`: its identity.  `revision`: present revision of its run log.
        """
        waiting = [job for job in self._jobs if job.target != target]  # the new one has all runs
        job = _Job(target, tuple(segments), recording, revision)
        self._jobs = deque([*waiting, job])
        self.status = job.status(SessionState.BUILDING)
        self.poll()

    def poll(self) -> None:
        """Handle processes that have ended or hang; to be called with every block."""
        if self._process is not None:
            if self._process.poll() is None:
                self._end_if_it_hangs(self._process)
                return
            self._finish(self._process)
        if self._process is None and self._jobs:
            self._start(self._jobs.popleft())

    def close(self) -> None:
        """End the process; a session file is complete or absent, and can be built again later."""
        self._jobs.clear()
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_ENDING_S)
            if self._process.poll() is None:
                self._process.kill()
                self._process.wait()
            self._finish(self._process)

    def _end_if_it_hangs(self, process: subprocess.Popen[bytes]) -> None:
        """Kill a process that takes too long; if it waits for a hung disk it may end later."""
        if time.monotonic() < self._deadline_s or self._hung:
            return
        process.kill()
        self._hung = "it took too long and was ended: check the disk"
        self._report(SessionState.FAILED, self._hung)

    def _start(self, job: _Job) -> None:
        patience_s = PATIENCE_S + _size(job.segments) / SLOWEST_BYTES_PER_S
        self._job, self._hung, self._deadline_s = job, "", time.monotonic() + patience_s
        command = [
            sys.executable,
            "-m",
            "daq.derive.build_session",
            str(job.target),
            *map(str, job.segments),
        ]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,  # its output fits a pipe: read at the end
                stderr=subprocess.STDOUT,
                process_group=0,  # not affected by Ctrl-C at the terminal
            )
        except OSError as error:
            self._finish_with(SessionState.FAILED, error.strerror or str(error))

    def _finish(self, process: subprocess.Popen[bytes]) -> None:
        lines = process.communicate()[0].decode("utf-8", "replace").splitlines()
        last, code = lines[-1] if lines else "", process.returncode
        text = _message(last)
        if code in (DONE, DONE_WITH_LOSS):
            self._finish_with(SessionState.READY, text)
        else:
            failure = printable(f"ended with code {code}: {last}")
            self._finish_with(SessionState.FAILED, self._hung or text or failure)

    def _finish_with(self, state: SessionState, text: str) -> None:
        self._report(state, text)
        self._process = self._job = None

    def _report(self, state: SessionState, text: str) -> None:
        assert self._job is not None  # the process was started
        if not self._jobs:
            self.status = self._job.status(state, text)


def _size(paths: Sequence[Path]) -> int:
    size = 0
    for path in paths:
        with suppress(OSError):  # deleted meanwhile to make room
            size += path.stat().st_size
    return size


def _message(line: str) -> str:
    """Return the error, or the losses of the journal, from the process's JSON line."""
    with suppress(ValueError, AttributeError):
        result = json.loads(line)
        return printable(str(result.get("error") or result.get("loss") or ""), 400)
    return ""
