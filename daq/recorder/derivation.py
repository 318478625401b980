"""Builds session files during the recording, each in a process that is started and polled."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ..control.messages import SessionState, SessionStatus
from ..errors import printable
from ..session.build import DONE, DONE_WITH_LOSS

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
    building: SessionStatus


class Derivation:
    """Builds session files, one after another; HDF5 never runs within the recorder."""

    def __init__(self) -> None:
        self._jobs: list[_Job] = []  # the first one has the process
        self._process: subprocess.Popen[bytes] | None = None
        self._deadline_s: float  # of the process, since it was started
        self.status = SessionStatus()

    def begin(self, target: Path, segments: Sequence[Path], recording: str, revision: int) -> None:
        """Start building the session file of a recording; never raises.

        `recording`: its identity.  `revision`: present revision of its run log.
        """
        self.status = SessionStatus(SessionState.BUILDING, str(target), "", recording, revision)
        running = self._jobs[:1] if self._process is not None else []
        # A waiting job for the same file is superseded: the new one has all runs.
        waiting = [job for job in self._jobs[len(running) :] if job.target != target]
        self._jobs = [*running, *waiting, _Job(target, tuple(segments), self.status)]
        self.poll()

    def poll(self) -> None:
        """Handle processes that have ended or hang; to be called with every block."""
        if self._process is not None:
            if self._process.poll() is not None:
                self._finish(self._process)
            elif time.monotonic() > self._deadline_s:
                self._process.kill()  # if it waits for a hung disk it may end later
                self._report(SessionState.FAILED, "it took too long and was ended: check the disk")
        while self._process is None and self._jobs:
            self._start(self._jobs[0])

    def close(self) -> None:
        """End the process; a session file is complete or absent, and can be built again later."""
        del self._jobs[1:]
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_ENDING_S)
            if self._process.poll() is None:
                self._process.kill()
                self._process.wait()
            self._finish(self._process)

    def _start(self, job: _Job) -> None:
        size = 0
        for path in job.segments:
            with suppress(OSError):  # deleted meanwhile to make room
                size += path.stat().st_size
        self._deadline_s = time.monotonic() + PATIENCE_S + size / SLOWEST_BYTES_PER_S
        builder = [sys.executable, "-m", "daq.session.build"]
        try:
            self._process = subprocess.Popen(
                [*builder, str(job.target), *map(str, job.segments)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,  # its output fits a pipe: read at the end
                stderr=subprocess.STDOUT,
                process_group=0,  # not affected by Ctrl-C at the terminal
            )
        except OSError as error:
            self._report(SessionState.FAILED, error.strerror or str(error))
            del self._jobs[0]

    def _finish(self, process: subprocess.Popen[bytes]) -> None:
        lines = process.communicate()[0].decode("utf-8", "replace").splitlines()
        last, text = lines[-1] if lines else "", ""
        with suppress(ValueError, AttributeError):  # its JSON line has an error, or losses
            result = json.loads(last)
            text = printable(str(result.get("error") or result.get("loss") or ""), 400)
        if process.returncode in (DONE, DONE_WITH_LOSS):
            self._report(SessionState.READY, text)
        elif time.monotonic() <= self._deadline_s:  # else it is reported already
            failure = printable(f"ended with code {process.returncode}: {last}")
            self._report(SessionState.FAILED, text or failure)
        self._process = None
        del self._jobs[0]

    def _report(self, state: SessionState, text: str) -> None:
        if len(self._jobs) == 1:  # else the next one is being built
            self.status = replace(self._jobs[0].building, state=state, text=text)
