"""Vehicles beyond the 15 parameters, identified with the structure that they have.

The truth is that of `daq.sim.plant`, which is built of forces, corner by corner.
"""

from __future__ import annotations

import numpy as np
import pytest

from daq.runs import Excitation
from daq.sessions import Session
from daq.vehicle import Structure, Vehicle
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.uncertainty import estimates
from identify.pipeline import grey_box
from identify.trust.finding import Verdict
from identify.trust.judge import judge

from ..stress import stress_session, true_value
from ..trust.campaigns import doubtful

EVERYTHING = Structure(symmetric=False, anti_roll_bars=True, tyre_damping=True, cg_offset=True)


def _identified(
    name: str,
    seed: int,
    structure: Structure,
    extra: tuple[Excitation, ...] = (),
    repeats: int = 1,
) -> tuple[Session, Estimation]:
    vehicle = Vehicle("x", structure=structure)
    session = stress_session(name, seed, vehicle=vehicle, extra=extra, repeats=repeats)
    records = usable(session).records
    return session, estimate(grey_box(session, records), records, generic_vehicles())


@pytest.mark.parametrize(
    ("name", "structure", "n"),
    [
        ("bars", Structure(anti_roll_bars=True), 17),
        ("tyre_damping", Structure(tyre_damping=True), 17),
        ("cg_offset", Structure(cg_offset=True), 16),
        ("sides", Structure(symmetric=False), 23),
    ],
)
def test_the_right_structure_explains_the_car(name: str, structure: Structure, n: int) -> None:
    # Damping in the tyres leaves c_s wide after one run of each kind.
    repeats = 2 if name == "tyre_damping" else 1
    session, result = _identified(name, 3, structure, repeats=repeats)
    quality = judge(session, result)
    assert quality.verdict is Verdict.OK
    assert not doubtful(quality.findings)
    assert 0.93 < result.chi2_per_n <= result.chi2_limit
    found = estimates(result.box, result.fit)
    assert len(found) == n
    for parameter, e in found.items():
        truth = true_value(name, parameter)
        assert abs(e.value - truth) < 4.0 * e.std, parameter
        # What is distinguished from zero here is so by more than three standard deviations.
        assert e.std < 0.3 * abs(truth), parameter


def test_everything_free_and_a_warp_run() -> None:
    session, result = _identified("linear", 3, EVERYTHING, (Excitation.WARP,))
    assert len(result.box.parameters) == 28
    assert judge(session, result).verdict is Verdict.OK
    pulls = []
    for parameter, e in estimates(result.box, result.fit).items():
        pulls.append((e.value - true_value("linear", parameter)) / e.std)
    assert np.max(np.abs(pulls)) < 4.0
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.5
    # What the car does not have is found to be nothing, to a few per cent of what cars have.
    found = estimates(result.box, result.fit)
    assert found["k_af"].std < 300.0
    assert found["c_tf"].std < 50.0
    assert found["y_s"].std < 0.003
