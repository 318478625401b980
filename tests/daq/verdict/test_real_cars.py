"""Runs of the real car whose friction holds most, as the bench judges them."""

from __future__ import annotations

from daq.bench.campaign import Step
from daq.bench.config import load_bench
from daq.verdict import RunMeasure, RunWindow, judge
from tests.simulated.cars import named_car

from ...flow.coverage import simulated_session


def test_runs_of_a_car_with_leaf_springs_are_accepted_although_friction_holds_it() -> None:
    """After a roll it rests a sixth of the peak from where it was; nothing else is unusual."""
    bench = load_bench(None)
    session = simulated_session(bench, 1, named_car("cherokee").simulated())
    held = []
    accepted: dict[Step, list[RunMeasure]] = {}
    for run in session.runs:
        step = Step(run.mass_state, run.excitation, 1)
        samples = {
            name: (run.t0_ns + (group.time_s * 1e9).astype("i8"), value)
            for group in run.groups
            for name, value in group.values.items()
        }
        window = RunWindow(run.t0_ns + round(bench.trigger.pre_s * 1e9), samples)
        findings, measure = judge(bench, step, window, accepted.setdefault(step, []))
        assert [f.text for f in findings if not f.passed] == []
        accepted[step].append(measure)
        held += [f.value / f.limit for f in findings if f.code == "rest_changed"]
    assert 0.75 < max(held) < 1.0
    assert len(held) == 12
