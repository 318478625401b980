"""From strange sensors to a first campaign: ``python -m tests.flow.first_campaign``.

Two like IMUs on two buses, an IMU and four hub sensors of another maker, four string pots of a
third: proposed from a log of rest and pushes, completed by hand, checked, played by `simulate` as
the sensors are in truth, recorded with what was proposed, identified; each by its command, in a
folder of its own.  Prints the edits by hand, the times, and what is identified beside the truth.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from daq.bench.config import Bench, parse_bench
from daq.bench.databases import stored_text
from daq.check.propose import Proposal, propose_sensors
from daq.sim.car import SimulatedCar
from dbc import FrameBatch, FrameFlag

from ..daq.wild_bench import DATABASES, POSITIONS, TRUTH, rest_and_pushes, wild_bench

PLACES = {"imu_a_1": "imu_front", "imu_a_2": "imu_rear", "imu_b": "imu_mid"}
"""Sensors as they are proposed, and as they are called in truth."""
_POSITION = re.compile(r"x_m = .*\ny_m = .*\nposition_sigma_m = .*\n")
_WEIGHTS = re.compile(r"# \[\[weight\]\]  # FILL IN.*?(?=\n# With scales)", re.DOTALL)


def proposed() -> Proposal:
    """Return the bench that rest and a push on each corner give."""
    return propose_sensors(DATABASES, wild_bench().buses, *rest_and_pushes())


def completed(text: str) -> tuple[str, list[str]]:
    """Return a proposal as somebody with a tape measure completes it, and the edits.

    An edit is a place in the file: a mark that is deleted, the three lines of a position.
    """
    edits = []
    for sensor, name in PLACES.items():
        x_m, y_m = POSITIONS[name]
        lines = f"x_m = {x_m}\ny_m = {y_m}\nposition_sigma_m = 0.01\n"
        channel = text.index(f'signal = "{sensor}.', text.index(f'name = "{sensor}_Acc'))
        while not text.startswith('quantity = "body_', text.index("quantity", channel)):
            channel = text.index(f'signal = "{sensor}.', channel + 1)
        text = text[:channel] + _POSITION.sub(lines, text[channel:], count=1)
        edits.append(f"position of {sensor}")
    marks = re.findall(r"  # ASK: (.*)", text)
    text = re.sub(r"  # ASK: .*", "", text)
    edits += [f"answer: {mark}" for mark in marks]
    weights = TRUTH[TRUTH.index("[[weight]]") :].rstrip()
    text = _WEIGHTS.sub(weights, text)
    edits.append("weights")
    text = text.replace('name = "vehicle"  # FILL IN', 'name = "Granada"')
    edits.append("name of the vehicle")
    return text, edits


def bench_of(text: str) -> Bench:
    """Return a completed proposal as a bench."""
    return parse_bench(text, "bench.toml", Path(), stored_text(DATABASES))


def written_log(frames: FrameBatch, path: Path) -> None:
    """Write frames as a log of candump, whole microseconds."""
    rows = zip(frames.t_ns.tolist(), frames.bus.tolist(), frames.can_id.tolist(), strict=True)
    lines = []
    for i, (t_ns, bus, can_id) in enumerate(rows):
        name = f"{can_id:08X}" if frames.flags[i] & FrameFlag.EXTENDED else f"{can_id:03X}"
        data = frames.data[i, : frames.length[i]].tobytes().hex().upper()
        us = t_ns // 1000
        lines.append(f"({us // 1_000_000}.{us % 1_000_000:06d}) can{bus} {name}#{data}\n")
    path.write_text("".join(lines))


class Walk:
    """The way through the commands in one folder, and what each takes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command."""
        return subprocess.Popen(
            [sys.executable, "-m", "tui", *arguments],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, *arguments: str, allowed: tuple[int, ...] = (0,)) -> str:
        """Run a command to its end, say how long it took, and return what it printed."""
        began_s = time.monotonic()
        out = self.end(self.start(*arguments), arguments[0], allowed)
        sys.stdout.write(f"{arguments[0]}: {time.monotonic() - began_s:.1f} s\n")
        return out

    @staticmethod
    def end(process: subprocess.Popen[str], name: str, allowed: tuple[int, ...]) -> str:
        """Wait for a command; exits with what it said if it failed."""
        out, err = process.communicate(timeout=600)
        if process.returncode not in allowed:
            raise SystemExit(f"{name} ended with {process.returncode}: {err or out}")
        return out


def main() -> int:
    """Go the whole way once and print edits, times and errors."""
    with TemporaryDirectory() as name:
        return _walk(Walk(Path(name)))


def _walk(walk: Walk) -> int:
    folder = walk.folder
    for database in DATABASES:
        (folder / database.name).write_text(database.text)
    rest, pushes = rest_and_pushes()
    written_log(FrameBatch.concatenate([rest, pushes]), folder / "rest_and_pushes.log")
    written_log(rest, folder / "rest.log")
    (folder / "truth.toml").write_text(TRUTH)
    channels = ",".join(bus.channel for bus in wild_bench().buses)
    named = [word for database in DATABASES for word in ("--dbc", database.name)]
    where = ["--interface", "udp_multicast", "--channel", channels]
    log = ["rest_and_pushes.log", "--propose", "bench.toml", "--seconds", "3", "--push", "60"]
    walk.run("check", *log, *named, *where, allowed=(0, 1))
    text, edits = completed((folder / "bench.toml").read_text())
    (folder / "bench.toml").write_text(text)
    sys.stdout.write(f"{len(edits)} edits by hand:\n" + "".join(f"  {edit}\n" for edit in edits))
    report = json.loads(walk.run("check", "bench.toml", "rest.log", "--json", allowed=(0, 1)))
    sys.stdout.write(f"check: {report['verdict']}\n")
    began_s = time.monotonic()
    recorder = walk.start("record", "bench.toml", "--out", "today", "--json")
    time.sleep(5.0)  # until it listens
    if recorder.poll() is None:
        walk.end(walk.start("simulate", "truth.toml"), "simulate", (0,))
    recorded = json.loads(walk.end(recorder, "record", (0, 3)))
    sys.stdout.write(f"record and simulate: {time.monotonic() - began_s:.1f} s\n")
    states = [run["status"] for run in recorded["runs"]]
    lost = sum(sum(run["losses"].values()) for run in recorded["runs"])
    sys.stdout.write(
        f"{len(states)} runs, {states.count('accepted')} accepted, {lost} lost frames\n"
    )
    (session,) = sorted((folder / "today").glob("session_*.h5"))
    found = json.loads(walk.run("identify", str(session), "--json", allowed=(0, 1)))
    truth = asdict(SimulatedCar().parameters)
    inside = 0
    for name, value in truth.items():
        parameter = found["parameters"][name]
        inside += parameter["low"] <= value <= parameter["high"]
        error = 100 * (parameter["value"] / value - 1)
        sys.stdout.write(f"{name:5} {parameter['value']:12.5g} {error:+6.2f} %\n")
    sys.stdout.write(f"{found['verdict']}: {inside} of {len(truth)} in their intervals\n")
    sys.stdout.writelines(f"  {reason}\n" for reason in found["reasons"])
    return 0 if len(edits) <= 8 and found["verdict"] != "refused" else 1


if __name__ == "__main__":
    sys.exit(main())
