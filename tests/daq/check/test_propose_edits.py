"""The proposal for three makers' sensors is complete after a few edits, and passes the check."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

from daq.bench.config import bench_codec, parse_bench
from daq.bench.databases import stored_text
from daq.check.check import check_bench
from daq.check.propose import propose_sensors
from dbc import Severity

from ..wild_bench import DATABASES, POSITIONS, TRUTH, rest_and_pushes, wild_bench

PLACES = {"imu_a_1": "imu_front", "imu_a_2": "imu_rear", "imu_b": "imu_mid"}
"""Sensors as they are proposed, and as they are called in truth."""
_POSITION = re.compile(r"x_m = .*\ny_m = .*\nposition_sigma_m = .*\n")
_WEIGHTS = re.compile(r"# \[\[weight\]\]  # FILL IN.*?(?=\n# With scales)", re.DOTALL)


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


def test_eight_edits_complete_the_proposal() -> None:
    proposal = propose_sensors(DATABASES, wild_bench().buses, *rest_and_pushes())
    text, edits = completed(proposal.text)
    assert len(edits) <= 8
    assert not [line for line in text.splitlines() if " FILL IN" in line and line[0] != "#"]
    bench = parse_bench(text, "bench.toml", Path(), stored_text(DATABASES))
    truth = wild_bench()
    assert bench.mass_states[1].added.weights == truth.mass_states[1].added.weights
    places = {(c.x_m, c.y_m) for c in bench.channels if c.quantity == "body_acceleration"}
    assert places == {(c.x_m, c.y_m) for c in truth.channels if c.quantity == "body_acceleration"}
    report = check_bench(bench, bench_codec(bench), rest_and_pushes()[0], date(2026, 6, 1))
    assert [line for line in report.lines if line.severity > Severity.WARNING] == []
