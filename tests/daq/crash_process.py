"""A sender on a serial line whose frames carry their number, and what was stored compared with it.

It behaves as an slcan adapter: frames come from the command `O` on, at the rate of a bus or as fast
as the line takes them.  Every 16th frame is one of a hub that is bumped every 1.2 s.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from daq import InputError, read_session
from daq.control.address import control_address
from daq.control.exchange import Client, RecorderGoneError
from daq.control.messages import AskStatus, Status
from daq.journal import writer as backlog
from daq.journal.reader import JournalLoss, segments_in
from daq.journal.segment import SyncedFile
from daq.recorder import recorder as engine
from dbc.frames import FrameBatch
from tui import cli
from tui.commands.record import recover

from .crash_frames import FailingDisk, SmallDisk, read_journal
from .small_campaign import bumps, small_bench, small_codec

RATE_HZ = 16_000
"""Frames a second of a paced sender: four full buses of 500 kbit/s."""
NUMBERED_ID = 0x7A0
"""A message that no DBC has; its payload is the number of the frame."""
HUB_EVERY = 16
LENGTH = 6
"""Payload of every frame, bytes: that of the hub's message."""
_CHUNK = 800
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)


@cache
def _hub() -> tuple[int, NDArray[np.uint8]]:
    """Return identifier and payloads of the hub's message over 1.2 s at 1 kHz."""
    frames = bumps(small_codec(), 1)
    assert np.all(frames.length == LENGTH)
    return int(frames.can_id[0]), frames.data[:, :LENGTH]


def frames_of(n: NDArray[np.int64]) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Return identifiers and payloads of the frames of these numbers."""
    hub_id, hub_data = _hub()
    hub = n % HUB_EVERY == 0
    data = n.astype(">u8").view(np.uint8).reshape(-1, 8)[:, 8 - LENGTH :].copy()
    data[hub] = hub_data[n[hub] // HUB_EVERY % len(hub_data)]
    return np.where(hub, hub_id, NUMBERED_ID).astype(np.uint32), data


def lines_of(n: NDArray[np.int64]) -> bytes:
    """Return the frames of these numbers as an slcan adapter sends them."""
    can_id, data = frames_of(n)
    line = np.empty((len(n), 6 + 2 * LENGTH), np.uint8)
    line[:, 0] = ord("t")
    for k, shift in enumerate((8, 4, 0)):
        line[:, 1 + k] = _DIGITS[can_id >> shift & 15]
    line[:, 4] = _DIGITS[LENGTH]
    line[:, 5:-1:2], line[:, 6:-1:2] = _DIGITS[data >> 4], _DIGITS[data & 15]
    line[:, -1] = ord("\r")
    return line.tobytes()


def numbers_of(frames: FrameBatch) -> NDArray[np.int64]:
    """Return the sender's numbers of stored frames; the first of a recorder is a numbered one."""
    assert np.all(frames.length == LENGTH)
    padded = np.zeros((len(frames), 8), np.uint8)
    padded[:, 8 - LENGTH :] = frames.data[:, :LENGTH]
    n = padded.view(">u8").reshape(-1).astype(np.int64)
    (hub,) = np.nonzero(frames.can_id != NUMBERED_ID)
    assert not len(hub) or hub[0] > 0, "a frame of the hub is the first"
    n[hub] = n[hub - 1] + 1
    # Where frames were dropped just before it, the one behind it shows the number.
    astray = hub[(n[hub] % HUB_EVERY != 0) & (hub + 1 < len(n))]
    n[astray] = n[astray + 1] - 1
    can_id, data = frames_of(n)
    assert np.array_equal(frames.can_id, can_id), "an identifier is not what was sent"
    assert np.array_equal(frames.data[:, :LENGTH], data), "a payload is not what was sent"
    assert not frames.flags.any()
    return n


class Sender:
    """Sends for as long as a `with` lasts.

    `hot`: as fast as the line takes it, in place of `RATE_HZ`.  `device`: the recorder's end of the
    line.  `openings`: number of the first frame after each time a recorder has opened the line.
    `sent`: number of the frame after the last one that was begun.
    """

    def __init__(self, *, hot: bool) -> None:
        self._hot = hot
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self.openings: list[int] = []
        self.sent = 1
        self._open = self._pausing = False
        self._rest = b""
        self._first, self._first_s = 1, 0.0
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sender")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def cut(self) -> None:
        """Send nothing more, and forget what is in the line: its recorder was killed."""
        with self._lock:
            self._read_commands()  # of the killed one
            self._open, self._rest = False, b""
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def pause(self) -> int:
        """Stop behind a whole frame; return the number of the next one."""
        self._pausing = True
        while self._rest:
            time.sleep(0.005)
        with self._lock:
            self._open = self._pausing = False
            return self.sent

    def _run(self) -> None:
        while not self._over.is_set():
            writing = [self._master] if self._rest else []
            select.select([self._master], writing, [], 0.01)
            with self._lock:
                self._read_commands()
                if self._open:
                    self._send()

    def _read_commands(self) -> None:
        try:
            commands = os.read(self._master, 4096)
        except BlockingIOError:
            return
        if b"O\r" in commands and not self._open:
            self.sent += -self.sent % HUB_EVERY + 1  # the first one is no frame of the hub
            self.openings.append(self.sent)
            self._open, self._first, self._first_s = True, self.sent, time.monotonic()
        elif b"C\r" in commands and b"O\r" not in commands:
            self._open, self._rest = False, b""

    def _send(self) -> None:
        if not self._rest and not self._pausing:
            due = self._first + round((time.monotonic() - self._first_s) * RATE_HZ) - self.sent
            count = _CHUNK if self._hot else min(due, 10 * _CHUNK)
            self._rest = lines_of(np.arange(self.sent, self.sent + count))
            self.sent += count
        try:
            while self._rest:
                self._rest = self._rest[os.write(self._master, self._rest) :]
        except BlockingIOError:
            return


# A whole `bumpbench record` under a sender, and its recording compared with what was sent -------


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

    `folder`: of the recordings.  `disk`: kind and number for `main`.  `held`: memory for
    blocks that wait, bytes; empty: as it is.  `beside`: where bench.toml and log are; next to the
    folder if None.
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
            *(sys.executable, "-m", "tests.daq.crash_process", *disk),
            *("record", str(bench), "--out", str(folder), "--keep-on"),
            *("--log", str(self.place / "log")),
        ]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "HELD_BYTES": held}
        with (self.place / "stderr").open("ab") as stderr:
            self.process = subprocess.Popen(command, cwd=self.place, env=environment, stderr=stderr)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
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
    command = ["pgrep", "--full", "--list-full", "daq.session.build"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


@dataclass(frozen=True, slots=True)
class Recovered:
    """Holds the findings of `bumpbench recover`, and the numbers of the stored frames."""

    numbers: NDArray[np.int64]
    lost: JournalLoss
    runs: int
    dropped: int = 0
    """Frames that the journal counts as dropped between the bus and the disk."""


def recovered(folder: Path, sender: Sender) -> Recovered:
    """Recover a folder by the command, and compare journal and session with what was sent."""
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
    dropped = contents.hops.between(0, 2**62).queue_dropped
    return Recovered(n, lost, len(runs), dropped)


def assert_gapless(n: NDArray[np.int64], sender: Sender) -> None:
    """Check that frames are missing only between a recorder's last one and the next opening."""
    (before,) = np.nonzero(np.diff(n) != 1)
    starts = [int(n[0]), *map(int, n[before + 1])] if len(n) else []
    assert set(starts) <= set(sender.openings), "a frame is missing between two of one recorder"


# R1: the whole `bumpbench record` under SIGKILL at random moments, paced and unthrottled --------


KILLS_A_FOLDER = 10
"""Kills of recorders that take up each other's recording, before the next folder is begun."""


@dataclass(frozen=True, slots=True)
class Kills:
    """Kills in one folder: how many, frames acknowledged and read at the end, runs recovered."""

    kills: int
    acknowledged: int
    read: int
    runs: int
    in_flight: tuple[int, ...]
    """Frames that a paced sender had sent and that were not stored, one for each kill."""


def kill_series(folder: Path, count: int, rng: np.random.Generator, *, hot: bool) -> Kills:
    """Kill `count` recorders that take up one recording, recover after each, and end the last."""
    before = np.empty(0, np.int64)
    acknowledged, in_flight = 0, []
    folder.mkdir(parents=True)
    with Sender(hot=hot) as sender:
        for _ in range(count):
            with RecorderProcess(folder / "out", sender) as recorder:
                if rng.random() < 0.1:  # while it starts
                    time.sleep(rng.uniform(0.2, 2.0))
                else:
                    recorder.wait_open()
                    deadline_s = time.monotonic() + rng.uniform(0.05, 2.0)
                    while not acknowledged or time.monotonic() < deadline_s:
                        acknowledged = max(acknowledged, recorder.status().disk.recorded_frames)
                sent = sender.sent
            found = recovered(folder / "out", sender)
            n = found.numbers
            assert len(n) >= acknowledged, f"{acknowledged - len(n)} acknowledged frames lost"
            assert np.array_equal(n[: len(before)], before), "earlier frames are gone"
            assert_gapless(n, sender)
            lost = found.lost
            assert lost.blocks_missing == found.dropped == 0
            if not hot and len(n) > len(before):
                in_flight.append(sent - 1 - int(n[-1]))
            before = n
        with RecorderProcess(folder / "out", sender) as last:
            last.wait_open()
            time.sleep(0.3)
            stop = sender.pause()
            expected = len(before) + stop - sender.openings[-1]
            last.until(lambda status: status.disk.recorded_frames == expected)
            last.end()
        found = recovered(folder / "out", sender)
        assert_gapless(found.numbers, sender)
        assert len(found.numbers) == expected
        assert found.numbers[-1] == stop - 1
        lost = found.lost  # a write that a kill cut off is no frame that was acknowledged
        assert lost.blocks_missing == found.dropped == 0, lost.text
    return Kills(count, acknowledged, expected, found.runs, tuple(in_flight))


def kills(folder: Path, first: int, count: int, seed: int = 1) -> Kills:
    """Kill the `first` and following of a campaign's recorders, every other folder unthrottled."""
    rng = np.random.default_rng([seed, first])
    place = folder / f"kills{first}"
    done = kill_series(place, count, rng, hot=first // KILLS_A_FOLDER % 2 == 1)
    shutil.rmtree(place)
    return done


# R5: the disk of a `bumpbench record` as a power cut leaves it, without what the kernel held ----


_IMAGE_BYTES = 256_000_000


@contextmanager
def mounted(image: Path, folder: Path) -> Iterator[bool]:
    """Mount an image; False where that is not allowed."""
    folder.mkdir()
    mount = ["mount", "-o", "loop", str(image), str(folder)]
    allowed = not subprocess.run(mount, capture_output=True, check=False).returncode
    try:
        yield allowed
    finally:
        if allowed:
            subprocess.run(["umount", str(folder)], check=True)


def cut_once(folder: Path, after_s: float, *, hot: bool) -> tuple[int, int] | None:
    """Copy a disk in mid-write and recover what is on it; None where that is not possible.

    The recorder is halted for the copy, so that the image is of one moment: all that had only
    reached the kernel's cache is not on it.

    Returns (int, int) Frames acknowledged, and read from the copy after the file system's own
    recovery.
    """
    folder.mkdir()
    image, copy = folder / "disk", folder / "copy"
    with image.open("wb") as file:
        file.truncate(_IMAGE_BYTES)
    made = subprocess.run(["mkfs.ext4", "-q", str(image)], capture_output=True, check=False)
    if made.returncode:
        return None
    with mounted(image, folder / "live") as allowed, Sender(hot=hot) as sender:
        if not allowed:
            return None
        with RecorderProcess(folder / "live" / "out", sender, beside=folder) as recorder:
            recorder.wait_open()
            acknowledged, deadline_s = 0, time.monotonic() + after_s
            while time.monotonic() < deadline_s:
                acknowledged = recorder.status().disk.recorded_frames
            recorder.process.send_signal(signal.SIGSTOP)
            os.waitpid(recorder.process.pid, os.WUNTRACED)
            shutil.copyfile(image, copy)
        recorder.wait_builders()
        with mounted(copy, folder / "after") as again:
            assert again, "the copy cannot be mounted"
            found = recovered(folder / "after" / "out", sender)
    n, lost = found.numbers, found.lost
    assert len(n) >= acknowledged, f"{acknowledged - len(n)} acknowledged frames lost"
    assert_gapless(n, sender)
    assert lost.blocks_missing == found.dropped == 0, lost.text
    return acknowledged, len(n)


def cut(folder: Path, i: int, seed: int = 5) -> tuple[int, int] | None:
    """Cut the power, every other time of an unthrottled one; None where nothing can be mounted."""
    place = folder / f"cut{i}"
    done = cut_once(place, np.random.default_rng([seed, i]).uniform(0.5, 3.0), hot=i % 2 == 1)
    shutil.rmtree(place)
    return done


# `bumpbench` on a disk that misbehaves: `python -m tests.daq.crash_process KIND NUMBER ...` -----
#
# The kinds are those of `FailingDisk`, whose operation of that number fails, and `small`: a disk
# with room for so many bytes, until there is a file `more_room` in the working directory.  What
# follows are the arguments of `bumpbench`.  In the environment, `HELD_BYTES` makes the memory
# smaller in which blocks wait for the disk.


MORE_ROOM = Path("more_room")
_MORE_BYTES = 100_000_000


class _Refilled(SmallDisk):
    """A small disk that gets room when a file asks for it."""

    def create(self, path: Path) -> SyncedFile:
        if MORE_ROOM.exists():
            self.free = _MORE_BYTES
        return super().create(path)


def main(arguments: list[str]) -> int:
    """Run a command with a recorder on such a disk, and return its exit code."""
    die_with_parent()  # a campaign that is killed leaves no recorder behind
    kind, number, *command = arguments
    if held := os.environ.get("HELD_BYTES"):
        vars(backlog)["HELD_BYTES"] = int(held)
    if kind != "sound":
        disk = _Refilled(int(number)) if kind == "small" else FailingDisk(kind, int(number))
        vars(engine)["Recorder"] = partial(engine.Recorder, create=disk.create)
    return cli.run(command)


def die_with_parent() -> None:
    """End this process as soon as the one that started it has ended; on Linux only."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() == 1:  # it ended while this process was starting
            sys.exit(1)


Part = Callable[[], Any]


def timed(part: Part) -> tuple[Any, str, float]:
    """Return the result of a part of a campaign, why it failed (empty if not), and its time, s."""
    began_s, result, failed = time.monotonic(), None, ""
    try:
        result = part()
    except AssertionError as error:
        failed = str(error) or repr(error)
    return result, failed, time.monotonic() - began_s


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
