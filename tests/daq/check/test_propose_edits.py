"""The proposal for three makers' sensors is complete after a few edits, and passes the check."""

from __future__ import annotations

from datetime import date

from daq.bench.config import bench_codec
from daq.check.check import check_bench
from dbc import Severity
from tests.flow.first_campaign import bench_of, completed, proposed

from ..wild_bench import rest_and_pushes, wild_bench


def test_eight_edits_complete_the_proposal() -> None:
    text, edits = completed(proposed().text)
    assert len(edits) <= 8
    assert not [line for line in text.splitlines() if " FILL IN" in line and line[0] != "#"]
    bench, truth = bench_of(text), wild_bench()
    assert bench.mass_states[1].added.weights == truth.mass_states[1].added.weights
    places = {(c.x_m, c.y_m) for c in bench.channels if c.quantity == "body_acceleration"}
    assert places == {(c.x_m, c.y_m) for c in truth.channels if c.quantity == "body_acceleration"}
    report = check_bench(bench, bench_codec(bench), rest_and_pushes()[0], date(2026, 6, 1))
    assert [line for line in report.lines if line.severity > Severity.WARNING] == []
