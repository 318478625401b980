"""From strange sensors to a first campaign: ``python -m tests.flow.first_campaign``.

Two like IMUs on two buses, an IMU and four hub sensors of another maker, four string pots of a
third: proposed from rest and pushes, completed by hand, checked, simulated and identified.  Prints
the edits by hand and the time that the machine takes.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import date
from pathlib import Path

import numpy as np

import identify
from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.databases import stored_text
from daq.check.check import check_bench
from daq.check.propose import Proposal, propose_sensors
from daq.derive.build_samples import build_session
from daq.journal.contents import HopCounts
from daq.runs import Event
from daq.sessions import Session
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch

from ..daq.wild_bench import DATABASES, POSITIONS, TRUTH, rest_and_pushes, wild_bench
from .coverage import CAR, START_NS

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


def recorded(bench: Bench, seed: int) -> Session:
    """Return what a bench makes of the frames that the sensors send in truth."""
    truth = wild_bench()
    frames = FrameBatch.concatenate(
        list(campaign_frames(truth, bench_codec(truth), CAR, seed, START_NS))
    )
    bumps = [
        Event(START_NS + round((i * CAR.run_s + CAR.lead_s) * 1e9), "bump", text=step.label)
        for i, step in enumerate(truth.campaign.steps)
    ]
    no_losses = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    return build_session(bench, bench_codec(bench), frames, bumps, no_losses, {})


@contextmanager
def _timed(what: str) -> Iterator[None]:
    began = time.process_time()
    yield
    sys.stdout.write(f"{what}: {time.process_time() - began:.1f} CPU s\n")


def main() -> int:
    """Go the whole way once and print edits, times and errors."""
    with _timed("proposed"):
        proposal = proposed()
    text, edits = completed(proposal.text)
    sys.stdout.write(f"{len(edits)} edits by hand:\n" + "".join(f"  {edit}\n" for edit in edits))
    bench = bench_of(text)
    with _timed("checked"):
        report = check_bench(bench, bench_codec(bench), rest_and_pushes()[0], date.today())
    sys.stdout.write(f"check: {report.word}\n")
    with _timed("simulated and decoded"):
        session = recorded(bench, 1)
    with _timed("identified"):
        result = identify.identify(session)
    truth = asdict(CAR.parameters)
    inside = 0
    for name, value in truth.items():
        found = result.parameters[name]
        inside += found.low <= value <= found.high
        sys.stdout.write(
            f"{name:5} {found.value:12.5g} {100 * (found.value / value - 1):+6.2f} %\n"
        )
    sys.stdout.write(f"{result.quality.verdict}: {inside} of {len(truth)} in their intervals\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
