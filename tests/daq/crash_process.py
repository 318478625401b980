"""A whole `bumpbench record` under a sender, and its recording compared with what was sent."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from daq import InputError, read_session
from daq.control.address import control_address
from daq.control.client import Client, RecorderGoneError
from daq.control.messages import Status
from daq.control.orders import AskStatus
from daq.journal.contents import JournalLoss
from daq.journal.folder import segments_in
from daq.journal.reader import read_journal
from tui.commands.recover import recover

from .crash_sender import Sender, numbers_of
from .small_campaign import small_bench

ROOT = Path(__file__).parents[2]
PATIENCE_S = 150.0
SOUND_DISK = ("sound", "0")
_BENCH = {
    "interface": '"slcan"',
    "segment_mb": "1",
    "reserve_mb": "1",
    "excitations": '["bounce", "roll"]',
    "pre_s": "0.1",
    "post_s": "0.5",
    "rest_s": "0.1",
}


class RecorderProcess:
    """A daemon that records what a sender sends; killed at the end of a `with` if it still runs.

    Parameters
    ----------
    folder : Path
        Of the recordings.
    disk : sequence of str
        Kind and number for `crash_recorder`.
    held : str
        Memory for blocks that wait, bytes; empty: as it is.
    beside : Path or None
        Where bench.toml and log are; next to the folder if None.
    """

    def __init__(
        self,
        folder: Path,
        sender: Sender,
        disk: Sequence[str] = SOUND_DISK,
        held: str = "",
        beside: Path | None = None,
    ) -> None:
        text = small_bench().text
        for key, value in (_BENCH | {"channel": f'"{sender.device}"'}).items():
            text = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", text, flags=re.MULTILINE)
        self.place = beside or folder.parent
        bench = self.place / "bench.toml"
        bench.write_text(text)
        self._sender, self._openings = sender, len(sender.openings)
        self._folder = folder
        self._client: Client | None = None
        command = [
            *(sys.executable, "-m", "tests.daq.crash_recorder", *disk),
            *("record", str(bench), "--out", str(folder), "--keep-on"),
            *("--log", str(self.place / "log")),
        ]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "HELD_BYTES": held}
        with (self.place / "stderr").open("ab") as stderr:
            self.process = subprocess.Popen(command, cwd=self.place, env=environment, stderr=stderr)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.process.poll() is None:
            self.kill()

    def wait_open(self) -> None:
        """Return when it has opened the line."""
        self._until(lambda: len(self._sender.openings) > self._openings)

    def status(self) -> Status:
        """Return its status."""
        while True:
            with contextlib.suppress(RecorderGoneError):
                if self._client is None:
                    self._client = Client(control_address(self._folder), "crash", control=False)
                found = self._client.ask(AskStatus(), PATIENCE_S).status
                assert found is not None
                return found
            assert self.process.poll() is None, (self.place / "stderr").read_text()
            time.sleep(0.02)

    def until(self, what: Callable[[Status], bool]) -> Status:
        """Return the first status of which something is true."""
        last: list[Status] = []

        def is_so() -> bool:
            last[:] = [self.status()]
            return what(last[0])

        self._until(is_so)
        return last[0]

    def kill(self) -> None:
        """Kill it, and take what it has not read out of the line."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        self._sender.cut()
        self._close()

    def end(self) -> None:
        """End it as systemd does; raise AssertionError if it does not exit with 0."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == 0, (self.place / "stderr").read_text()
        self._close()

    def wait_builders(self) -> None:
        """Return when no process that builds a session uses the folder any more."""
        _wait(lambda: str(self._folder) not in _commands())

    def _close(self) -> None:
        if self._client is not None:
            self._client.close()

    def _until(self, condition: Callable[[], bool]) -> None:
        def is_so() -> bool:
            assert self.process.poll() is None, (self.place / "stderr").read_text()
            return condition()

        _wait(is_so)


def _wait(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, "waited too long"
        time.sleep(0.01)


def _commands() -> str:
    """Return the command lines of all session builders."""
    command = ["pgrep", "--full", "--list-full", "daq.derive.build_session"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


@dataclass(frozen=True, slots=True)
class Recovered:
    """Holds the findings of `bumpbench recover`, and the numbers of the stored frames."""

    numbers: NDArray[np.int64]
    lost: JournalLoss
    runs: int


def recovered(folder: Path, sender: Sender) -> Recovered:
    """Recover a folder by the command, and compare journal and session with what was sent.

    Raises
    ------
    AssertionError
        If a frame is doubled, altered or out of order, frames of a run are not those of the
        journal, or the command says that something is lost when nothing is, or nothing when it is.
    """
    segments = segments_in(folder / "journal")
    said = io.StringIO()
    target = folder / "recovered.h5"
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
            code = recover([folder], target, json=True)
        contents = read_journal(segments)
    except InputError:  # killed before the head of the first segment was written
        return Recovered(np.empty(0, np.int64), JournalLoss(), 0)
    lost = contents.lost
    assert code == (3 if lost.any else 0), said.getvalue()
    document = json.loads(said.getvalue())
    assert bool(document["loss"]) == lost.any
    n = numbers_of(contents.frames)
    assert document["frames_recorded"] == len(n)
    steps = np.diff(n)
    assert np.all(steps > 0), "frames are doubled or out of order"
    assert not np.any(n >= sender.sent), "frames were stored that were never sent"
    runs = read_session(target).runs
    for run in runs:
        if len(run.frames):
            # A window of time may begin with any frame: the journal knows its number.
            first = int(np.searchsorted(contents.frames.t_ns, run.frames.t_ns[0]))
            own = slice(first, first + len(run.frames))
            assert np.array_equal(run.frames.data[:, :8], contents.frames.data[own, :8])
            assert np.array_equal(run.frames.can_id, contents.frames.can_id[own])
            assert np.array_equal(run.frames.t_ns, contents.frames.t_ns[own])
    return Recovered(n, lost, len(runs))


def assert_gapless(n: NDArray[np.int64], sender: Sender) -> None:
    """Check that frames are missing only between the last frame of a recorder and the next opening.

    Raises
    ------
    AssertionError
        If a recorder has lost a frame between two others.
    """
    (before,) = np.nonzero(np.diff(n) != 1)
    starts = [int(n[0]), *map(int, n[before + 1])] if len(n) else []
    assert set(starts) <= set(sender.openings), "a frame is missing between two of one recorder"
