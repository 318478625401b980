"""Bump stops of a simulated car, which is written from forces: those that few runs touch, too."""

from __future__ import annotations

from pathlib import Path

from daq.bench.config import default_bench_text, parse_bench
from identify.pipeline import identify_parameters
from tests.simulated.cars import named_car

from ...flow.coverage import simulated_session


def test_a_stop_that_two_runs_touch_by_3_mm_is_found() -> None:
    """The Escort's rear stop has 40 N/mm from 40 mm on; in rolls with the weights it is touched.

    When it was missed, a soft negative stop took its place and the rear hub's residuals were not
    white.  The front stop, at 30 mm, is touched in each run.
    """
    text = default_bench_text().replace('["bounce", "pitch", "roll"]', '["bounce", "roll"]')
    bench = parse_bench(text.replace("repeats = 2", "repeats = 1"), "bench.toml", Path())
    found = identify_parameters(simulated_session(bench, 1, named_car("escort").simulated()))
    assert "whiteness" not in {finding.code for finding in found.quality.findings}
    assert found.forces is not None
    for axle, gap_m, most_n_m in zip(
        found.forces.axles, (0.03, 0.04), (400.0, 4000.0), strict=True
    ):
        gap, rate = axle.values["bump_stop_gap"], axle.values["bump_stop"]
        assert abs(gap.value - gap_m) < 3.0 * gap.std < 0.5e-3
        assert abs(rate.value - 4e4) < 3.0 * rate.std
        assert rate.std < most_n_m
