"""A recorder on a simulated bench in a process of its own, and the operator's terminal on it."""

from __future__ import annotations

import asyncio
import fcntl
import math
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from itertools import groupby
from pathlib import Path

from textual.pilot import Pilot

from daq.bench.config import default_bench_text
from daq.control.address import control_address, is_running
from daq.control.exchange import Client
from daq.control.messages import AskStatus, Mark, ShutDown, Status
from tui.recorders.process import failure, start_recorder
from tui.terminal.app import BenchApp
from tui.terminal.campaign import BenchStep
from tui.terminal.device import LOCK_OUT_S
from tui.terminal.feed import RecorderFeed
from tui.terminal.words import choose_glyphs

from ..tui.terminal.conftest import screen_text

PATIENCE_S = 300.0
"""For what processes do on a machine that has much else to do."""
SIZE = (80, 24)
SHIPPED_BUMPS = '["bounce", "pitch", "roll"]'
SEEN_S = 0.8
"""A verdict stands for so long, of our time."""


class DemoBench:
    """A folder, its bench.toml and the recorders that were started in it.

    Parameters
    ----------
    folder : Path
        Empty or of an earlier recorder.
    speed : float
        Seconds of the car in one of ours.
    repeats : int
        Planned of each kind of bump.
    fault : str
        What spoils the second bump.
    bumps : str
        The planned kinds of bump, as bench.toml writes them, with one of the shipped weights; all
        bumps and weights of the shipped bench if empty.
    """

    def __init__(
        self, folder: Path, speed: float, repeats: int = 1, fault: str = "", bumps: str = ""
    ) -> None:
        self.folder = folder / "recorder"
        self.bench = folder / "bench.toml"
        text = default_bench_text().replace("repeats = 2", f"repeats = {repeats}")
        if bumps:
            text = text.replace(SHIPPED_BUMPS, bumps)
            text = re.sub(r"(?s)(\[\[weight\]\].*?)\[\[weight\]\].*?(?=# The IMU)", r"\1", text)
        seen = f"accept_after_s = {SEEN_S * speed:g}"
        self.bench.write_text(text.replace("accept_after_s = 3.0", seen))
        self._speed, self._fault = speed, fault
        self.processes: list[subprocess.Popen[bytes]] = []

    def start(self) -> subprocess.Popen[bytes]:
        """Start a recorder; it takes up what the one before has left."""
        words = ["--idle", "--demo", "--speed", f"{self._speed:g}"]
        words += ["--fault", self._fault] if self._fault else []
        process = start_recorder(self.folder, str(self.bench), *words)
        self.processes.append(process)
        return process

    def started(self) -> DemoBench:
        """Start a recorder and wait until it answers."""
        wait_for_recorder(self.start(), self.folder)
        return self

    def skip_to_bumps(self) -> None:
        """Say that vehicle and check are done."""
        client = Client(control_address(self.folder), "Test", control=True)
        for step in (BenchStep.VEHICLE, BenchStep.CHECK):
            client.ask(Mark(step.mark), PATIENCE_S)
        client.close()

    def status(self) -> Status:
        """Ask the recorder where it stands, without being seen by a terminal."""
        client = Client(control_address(self.folder), "onlooker", control=False)
        reported = client.ask(AskStatus(), PATIENCE_S).status
        client.close()
        assert reported is not None
        return reported

    def wait(self, condition: Callable[[Status], bool]) -> Status:
        """Wait until the recorder's news say so."""
        client = Client(control_address(self.folder), "onlooker", control=False)
        deadline_s = time.monotonic() + PATIENCE_S
        try:
            while time.monotonic() < deadline_s:
                news = client.news(1.0)
                if isinstance(news, Status) and condition(news):
                    return news
        finally:
            client.close()
        raise AssertionError(self.status().phase)

    def kill(self) -> None:
        """Kill the recorder as the kernel does when memory is short."""
        self.processes[-1].kill()
        self.processes[-1].wait()


@contextmanager
def demo_bench(
    folder: Path, speed: float, repeats: int = 1, fault: str = "", bumps: str = ""
) -> Iterator[DemoBench]:
    """Give a bench whose recorders end with the test."""
    bench = DemoBench(folder, speed, repeats, fault, bumps)
    try:
        yield bench
    finally:
        for process in bench.processes:
            process.kill()
            process.wait()


def wait_for_recorder(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Wait until a started recorder answers."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_running(control_address(folder)):
        assert not (failed := failure(process, folder)), failed
        assert time.monotonic() < deadline_s, "the recorder does not answer"
        time.sleep(0.05)


def end_recorder(folder: Path) -> None:
    """End a recorder that a terminal has started: it is the child of no test."""
    address = control_address(folder)
    for _ in range(20):
        if not is_running(address):
            return
        with suppress(Exception):  # the terminal that is ending may still be in control
            client = Client(address, "Test", control=True, take_over=True)
            client.ask(ShutDown())
            client.close()
        time.sleep(0.25)


def terminal_on(
    folder: Path,
    restart: Callable[[], subprocess.Popen[bytes] | None] = lambda: None,
    auto: bool = False,
) -> BenchApp:
    """Return a terminal on the recorder of a folder."""
    glyphs = choose_glyphs("braille", {})
    return BenchApp(RecorderFeed(folder, "MK", restart), folder, glyphs, "MK", auto=auto)


class Seat:
    """Somebody before a terminal: looks at the screen, and presses keys."""

    def __init__(self, app: BenchApp, pilot: Pilot[None]) -> None:
        self.app, self.pilot = app, pilot
        self.screens: list[str] = []
        self._pressed_s = -math.inf

    @property
    def text(self) -> str:
        """The text on the screen."""
        return screen_text(self.app)

    async def until(
        self, condition: Callable[[], bool], meanwhile: Callable[[], object] = lambda: None
    ) -> None:
        """Wait for what processes do."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, self.text
            await self.pilot.pause(0.25)
            name = type(self.app.screen).__name__
            if self.screens[-1:] != [name]:
                self.screens.append(name)
            waits = meanwhile()
            if asyncio.iscoroutine(waits):
                await waits

    async def space_if_offered(self) -> None:
        """Press SPACE if the screen says that it does something now; a press is not a held key."""
        now_s = time.monotonic()
        if now_s - self._pressed_s < 2 * LOCK_OUT_S:
            return
        if "SPACE =" in self.text or "SPACE starts" in self.text:
            self._pressed_s = now_s
            await self.pilot.press("space")

    def went_through(self) -> list[str]:
        """Return the screens of the steps in the order in which they were met."""
        names = [name.removesuffix("Screen") for name in self.screens]
        passed = ("Report", "Confirm")
        return [name for name, _ in groupby(n for n in names if n not in passed)]

    def sees(self, words: str) -> Callable[[], bool]:
        """Return whether words are on the screen."""
        return lambda: words in self.text


@asynccontextmanager
async def seat(app: BenchApp, size: tuple[int, int] = SIZE) -> AsyncIterator[Seat]:
    """Sit down before a terminal."""
    async with app.run_test(size=size) as pilot:
        yield Seat(app, pilot)


class PtyTerminal:
    """`bumpbench tui` in a real pseudo terminal, whose output somebody reads."""

    def __init__(self, *arguments: str, size: tuple[int, int] = SIZE) -> None:
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            rows = struct.pack("HHHH", size[1], size[0], 0, 0)
            fcntl.ioctl(0, termios.TIOCSWINSZ, rows)
            os.environ.update(TERM="xterm-256color", TEXTUAL_ANIMATIONS="none")
            os.execv(sys.executable, [sys.executable, "-m", "tui", "tui", *arguments])
        self.said = b""

    def until(self, words: bytes) -> None:
        """Read until the terminal has said something; the window's title names the phase."""
        deadline_s = time.monotonic() + PATIENCE_S
        while words not in self.said:
            assert time.monotonic() < deadline_s, self.said[-4000:]
            if select.select([self._master], [], [], 0.1)[0]:
                self.said += os.read(self._master, 1 << 16)

    def kill(self) -> None:
        """Kill it, and let nothing of it remain."""
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        os.close(self._master)
