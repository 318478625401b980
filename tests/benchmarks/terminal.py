"""Measures the CPU of the operator's terminal: the command in a pseudo terminal, on a recorder.

The recorder is another process that publishes a status and the samples of eight lanes ten times a
second.  Bars: 12 % of a core and 200 kB/s at 140x40, first screen within 0.6 s of the start of the
command, in control within 1 s once the terminal before was killed and is known to be dead.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import select
import statistics
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

RATE_HZ = 10.0
SETTLED_S, SECONDS = 4.0, 8.0
"""Begin and length of the time over which the share of a core is taken, s."""
SIZES = ((80, 24), (140, 40), (200, 50))
STARTS = 5
"""Starts of which the median is printed."""
ARMED = b"ARMED  "
"""In the banner of a run alone: the title of the window goes on with a dash."""
IN_CONTROL = b"op. MK"


def publish(folder: str) -> None:
    """Publish as a recorder with an armed run, until killed."""
    from daq.control.address import control_address
    from daq.control.exchange import Server
    from daq.control.messages import Lane, Live, Order, Phase, Reply
    from tests.tui.terminal.fake_recorder import FakeRecorder

    recorder = FakeRecorder()
    recorder.start(lambda _: None)
    recorder.mark("vehicle", "check")
    for _ in range(5):
        recorder.bump()
        recorder.judge()
    recorder.phase = Phase.ARMED

    pool = ThreadPoolExecutor(1)  # the server's own thread runs a loop already

    def submit(order: Order, _: str) -> Future[Reply]:
        return pool.submit(asyncio.run, recorder.ask(order))

    server = Server(submit, control_address(Path(folder)))
    status = recorder.status
    rng = np.random.default_rng(1)
    first = recorder.live().first_bin + 500
    names = [channel.name for channel in recorder.bench.channels]
    for turn in range(1_000_000):
        t_s = (first + np.arange(5)) * 0.02
        lanes = []
        for k, name in enumerate(names):
            value = 4.0 * np.sin(9.0 * t_s + k) * np.abs(np.sin(0.7 * t_s))
            value += rng.normal(0.0, 0.1, 5)
            lanes.append(Lane(name, tuple(value - 0.1), tuple(value + 0.1)))
        now = replace(status, t_ns=round(first * 2e7), phase_s=turn / RATE_HZ)
        server.publish(now, Live(first, 0.02, tuple(lanes)))
        first += 5
        time.sleep(1.0 / RATE_HZ)


def empty() -> None:
    """Run what Textual needs for one word: no terminal of its kind comes sooner."""
    from textual.app import App, ComposeResult
    from textual.widgets import Static

    class Empty(App[None]):
        def compose(self) -> ComposeResult:
            yield Static("ARMED  ")

    Empty().run()


@dataclass
class Terminal:
    """A command in a pseudo terminal; what it draws is read all the time."""

    command: Sequence[str]
    columns: int = 140
    rows: int = 40

    def __post_init__(self) -> None:
        self.begun_s = time.monotonic()
        self.seen, self.count = b"", 0
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            size = struct.pack("HHHH", self.rows, self.columns, 0, 0)
            fcntl.ioctl(0, termios.TIOCSWINSZ, size)
            os.environ.update(TERM="xterm-256color", COLORTERM="truecolor")
            os.environ.update(OPENBLAS_NUM_THREADS="1")
            os.execv(sys.executable, [sys.executable, *self.command])

    def until(self, word: bytes) -> tuple[float, float]:
        """Return seconds and CPU seconds from the start until a word is drawn."""
        while word not in self.seen:
            assert time.monotonic() - self.begun_s < 60.0, self.seen[-2000:]
            self._read(0.01)
        return time.monotonic() - self.begun_s, self.cpu_s

    def watch(self, seconds: float) -> None:
        """Read for some time."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._read(0.05)

    @property
    def cpu_s(self) -> float:
        """CPU seconds of the process so far."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def kill(self) -> None:
        """Kill it."""
        os.kill(self.pid, 9)
        os.waitpid(self.pid, 0)
        os.close(self._master)

    def _read(self, wait_s: float) -> None:
        if select.select([self._master], [], [], wait_s)[0]:
            piece = os.read(self._master, 1 << 16)
            self.count += len(piece)
            self.seen = (self.seen + piece)[-200_000:]


@contextmanager
def recorder(folder: str) -> Iterator[list[str]]:
    """Publish in a folder; give the words of the command that shows it."""
    from daq.control.address import control_address, is_running

    code = f"from tests.benchmarks.terminal import publish; publish({folder!r})"
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        while not is_running(control_address(Path(folder))):
            time.sleep(0.05)
        time.sleep(1.0)
        yield ["-m", "tui", "tui", "--out", folder, "--operator", "MK", "--glyphs", "braille"]
    finally:
        process.kill()
        process.wait()


def starts(command: Sequence[str]) -> str:
    """Return median seconds and CPU seconds of several starts, as words."""
    times = []
    for _ in range(STARTS):
        terminal = Terminal(command)
        times.append(terminal.until(ARMED))
        terminal.kill()
    wall_s, cpu_s = (statistics.median(column) for column in zip(*times, strict=True))
    return f"{wall_s:.2f} s ({cpu_s:.2f} s of CPU)"


def main() -> None:
    """Print the figures of each size."""
    print("operator's terminal on a recorder that publishes at 10 Hz")
    print("  an empty Textual app:", starts(["-c", f"from {__spec__.name} import empty; empty()"]))
    with TemporaryDirectory() as folder, recorder(folder) as command:
        print("  first screen of the command:", starts(command))
        before = Terminal(command)
        before.until(IN_CONTROL)
        before.watch(1.0)
        before.kill()
        time.sleep(1.0)
        after = Terminal(command)
        print(f"  in control after a kill: {after.until(IN_CONTROL)[0]:.2f} s")
        after.kill()
        for columns, rows in SIZES:
            time.sleep(1.5)
            terminal = Terminal(command, columns, rows)
            terminal.watch(SETTLED_S)
            cpu_s, count, begun_s = terminal.cpu_s, terminal.count, time.monotonic()
            terminal.watch(SECONDS)
            passed_s = time.monotonic() - begun_s
            share = (terminal.cpu_s - cpu_s) / passed_s
            rate = (terminal.count - count) / passed_s / 1e3
            print(f"  {columns}x{rows}: {share:5.1%} of a core, {rate:5.0f} kB/s")
            terminal.kill()


if __name__ == "__main__":
    main()
