"""A recording in ten lines: `python recording.py FOLDER [BENCH.TOML]`, on python-can's virtual bus.

The recorder is the one of `bumpbench record`: every frame goes to a journal first, bumps are found
and judged, and a process of its own builds the session file.  The simulated car plays the campaign
of the bench as fast as the bus takes it; with hardware, name its interface in bench.toml and leave
the car out.
"""

import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

from daq import read_session
from daq.bench.config import Bench, bench_codec, load_bench
from daq.bus.interfaces import open_bus, open_source
from daq.control.messages import Arm, Status, Stop, Until
from daq.recorder.recorder import Recorder
from daq.replay import play
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames


def main(folder: Path, bench_toml: Path | None = None) -> Path:
    """Record a campaign of the simulated car, and return its session file."""
    bench = load_bench(bench_toml)
    # No operator can reject a run here: the next bump may come at once.
    bench = replace(bench, campaign=replace(bench.campaign, accept_after_s=0.0))
    # Ten lines ...
    stop, news = threading.Event(), News()
    bus = open_source(bench.buses[0], 0)  # before the first frame
    recorder = Recorder(bench, folder, lambda *_: bus, software="recording.py")
    writer = threading.Thread(target=recorder.run, args=(stop, news.hear))
    writer.start()
    recorder.submit(Arm(Until.COMPLETE), by="me").result()
    bump_the_car(bench)
    news.complete.wait(60.0)
    recorder.submit(Stop(), by="me").result()
    news.built.wait(60.0)
    # ... and the end.
    stop.set()
    writer.join()
    return Path(news.session)


class News:
    """Receives the recorder's reports, ten a second; `hear` must not block."""

    def __init__(self) -> None:
        self.complete, self.built = threading.Event(), threading.Event()
        self.session = ""

    def hear(self, status: Status, live: object) -> None:
        """Note that the campaign is complete, and that its session file is there."""
        if status.phase == "complete":
            self.complete.set()
        if self.complete.is_set() and status.session.state in ("ready", "failed"):
            self.session = status.session.path
            self.built.set()


def bump_the_car(bench: Bench) -> None:
    """Play the campaign of the simulated car on the bench's bus."""
    codec = bench_codec(bench)
    frames = campaign_frames(bench, codec, SimulatedCar(), seed=1, start_ns=time.time_ns())
    with open_bus(bench.buses[0]) as bus:
        for _ in play(frames, bus, speed=None):
            pass


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    path = main(*map(Path, sys.argv[1:]))
    session = read_session(path)
    print(path, f"{len(session.runs)} runs", *[run.label for run in session.runs], sep="\n  ")
