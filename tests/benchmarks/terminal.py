"""What the operator's terminal costs: lanes at 10 Hz in a real pseudo terminal.

Bars: 20 % of a core and 200 kB/s at 140x40, first screen within 1 s of the start of its process.
"""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import sys
import termios
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

RATE_HZ = 10.0
SECONDS = 8.0
SETTLED_S = 5.0
SIZES = ((80, 24), (140, 40), (200, 50))


class _Feed:
    """A recorder that says the same things as a real one, as JSON, ten times a second."""

    def __init__(self) -> None:
        from daq.control.messages import Phase
        from tests.tui.terminal.fake_recorder import FakeRecorder

        self._recorder = FakeRecorder()
        self._recorder.mark("vehicle", "check")
        for _ in range(5):
            self._recorder.bump()
            self._recorder.judge()
        self._recorder.phase = Phase.ARMED
        self._stop = threading.Event()
        self.ask = self._recorder.ask

    def start(self, post: Callable[[object], None]) -> None:
        self._recorder.start(post)
        threading.Thread(target=self._tell, args=(post,), daemon=True).start()

    def stop(self) -> None:
        self._stop.set()

    def _tell(self, post: Callable[[object], None]) -> None:
        from daq.control.messages import LIVE, STATUS, Lane, Live

        status = self._recorder.status
        rng = np.random.default_rng(1)
        first = self._recorder.live().first_bin + 500
        names = [channel.name for channel in self._recorder.bench.channels]
        while not self._stop.wait(1.0 / RATE_HZ):
            t_s = (first + np.arange(5)) * 0.02
            lanes = []
            for k, name in enumerate(names):
                value = 4.0 * np.sin(9.0 * t_s + k) * np.abs(np.sin(0.7 * t_s))
                value += rng.normal(0.0, 0.1, 5)
                lanes.append(Lane(name, tuple(value - 0.1), tuple(value + 0.1)))
            reported = replace(status, t_ns=round(first * 2e7), phase_s=first * 0.02 % 60)
            post(STATUS.validate_json(STATUS.dump_json(reported)))
            post(LIVE.validate_json(LIVE.dump_json(Live(first, 0.02, tuple(lanes)))))
            first += 5


def child() -> None:
    """Run the terminal until killed."""
    from tui.terminal.app import BenchApp
    from tui.terminal.state.glyphs import GlyphSet, choose_glyphs

    glyphs = choose_glyphs(GlyphSet.BRAILLE, {}, "utf-8")
    BenchApp(_Feed(), Path(), glyphs, "MK").run()  # type: ignore[arg-type]


def measure(columns: int, rows: int) -> tuple[float, float, float, float]:
    """Return CPU share, kB/s to the terminal; seconds and CPU seconds to the first screen."""
    begun_s = time.monotonic()
    pid, master = pty.fork()
    if pid == 0:
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        os.environ.update(TERM="xterm-256color", COLORTERM="truecolor", OPENBLAS_NUM_THREADS="1")
        command = "from tests.benchmarks.terminal import child; child()"
        os.execv(sys.executable, [sys.executable, "-c", command])
    first_s = first_cpu_s = float("nan")
    seen, counted = b"", 0
    cpu_s, settled_s = 0.0, float("inf")
    end_s = begun_s + SETTLED_S + SECONDS
    while (now_s := time.monotonic()) < end_s:
        if now_s - begun_s >= SETTLED_S and settled_s == float("inf"):
            settled_s, cpu_s, counted = now_s, _cpu_s(pid), 0
        if select.select([master], [], [], 0.05)[0]:
            piece = os.read(master, 1 << 16)
            counted += len(piece)
            if first_s != first_s:
                seen += piece
                if b"ARMED" in seen:
                    first_s, first_cpu_s = time.monotonic() - begun_s, _cpu_s(pid)
    passed_s = time.monotonic() - settled_s
    share = (_cpu_s(pid) - cpu_s) / passed_s
    os.kill(pid, 9)
    os.waitpid(pid, 0)
    os.close(master)
    return share, counted / passed_s / 1e3, first_s, first_cpu_s


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Print the figures of each size."""
    print("operator's terminal, run screen, all lanes that fit at 10 Hz")
    for columns, rows in SIZES:
        share, kilobytes, first_s, first_cpu_s = measure(columns, rows)
        print(
            f"  {columns}x{rows}: {share:5.1%} of a core, {kilobytes:5.0f} kB/s,"
            f" first screen after {first_s:.2f} s ({first_cpu_s:.2f} s of CPU)"
        )


if __name__ == "__main__":
    main()
