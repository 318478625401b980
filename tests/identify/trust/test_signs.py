"""Channels whose sign is wrong are the first finding of an identification."""

from __future__ import annotations

from dataclasses import replace

from daq.bench.config import load_bench
from identify.pipeline import identify_parameters

from ...flow.coverage import simulated_session
from .campaigns import with_runs

WRONG = ("travel_fl", "travel_fr")


def test_wrong_signs_are_named_first_and_no_other_cause_is_sought() -> None:
    session = with_runs(
        simulated_session(load_bench(None), 1),
        lambda run: replace(
            run,
            groups=tuple(
                replace(g, values={k: -v if k in WRONG else v for k, v in g.values.items()})
                for g in run.groups
            ),
        ),
    )
    found = identify_parameters(session).quality
    assert found.verdict == "refused"
    assert found.findings[0].text == (
        "likely cause: wrong signs, travel_fl, travel_fr move against the hub accelerometers:"
        " change the sign of these channels"
    )
    assert len([f for f in found.findings if "likely cause" in f.text]) == 1
