"""Lanes of one quantity at the wheels share a scale; a lane of the body has its own."""

from __future__ import annotations

from pathlib import Path

from daq.bench.config import default_bench_text, parse_bench
from tui.terminal.state.lane_view import lane_specs
from tui.terminal.state.lanes import Lanes


def test_one_scale_for_each_quantity_at_the_wheels() -> None:
    bench = parse_bench(default_bench_text(), "bench.toml", Path(), dbc_text="")
    specs = {spec.channel: spec.scale for spec in lane_specs(bench, Lanes(), 0, 40)}
    hubs = {specs[f"hub_acc_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    travels = {specs[f"travel_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    assert len(hubs) == len(travels) == 1
    assert hubs.isdisjoint(travels)
    assert specs["body_acc_z"] == "body_acc_z"
    assert specs["roll_rate"] != specs["pitch_rate"]
