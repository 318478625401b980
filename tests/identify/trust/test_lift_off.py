from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import ADDED, Excitation
from daq.sim.engine import Plant
from daq.sim.motion import Bump, drive
from daq.sim.plant import GRAVITY_M_S2, contact, load_car, static_pose
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight
from dbc.finding import Severity
from identify.fit.estimation import Estimation
from identify.fit.varpro import evaluate, linear_part
from identify.model.matrices import SYMMETRIC, loaded_model
from identify.trust.motion import least_loads_n, lift_off_findings, static_loads_n

from ..stress import BUMP_S, REST_S
from .campaigns import SEEDS, campaign, estimated

Array = NDArray[np.float64]
FULL = SYMMETRIC @ FORD_GRANADA.to_array()
TYRES = FULL[11:15]
CORNER_WEIGHT = (
    BodyWeight(60.0, 0.2, 0.5, height_m=0.4),
    BodyWeight(40.0, -2.9, -0.3),
    HubWeight(6.0, Corner.REAR_RIGHT),
)


def tyre_loads(plant: Plant, pose: Array, velocity: Array) -> Array:
    return contact(plant, pose, velocity, np.zeros((4, pose.shape[1]))).tyre_n


@pytest.mark.parametrize("weights", [(), CORNER_WEIGHT])
def test_static_loads_are_those_of_the_balance_of_forces(
    weights: tuple[BodyWeight | HubWeight, ...],
) -> None:
    plant = load_car(FORD_GRANADA, AddedMass(weights))
    pose = static_pose(plant)
    found = static_loads_n(loaded_model(FULL, AddedMass(weights)), TYRES)
    np.testing.assert_allclose(found, tyre_loads(plant, pose, np.zeros_like(pose))[:, 0], rtol=1e-9)
    carried = 1380.0 + 2 * 40.5 + 2 * 45.4 + sum(weight.mass_kg for weight in weights)
    assert found.sum() == pytest.approx(carried * GRAVITY_M_S2)


@pytest.mark.parametrize("label", ["baseline_bounce_1", "added_roll_2"])
def test_least_loads_are_those_of_the_simulated_car(label: str) -> None:
    """Tyre by tyre from the forces of the simulation; it is the control, so nothing lifts."""
    estimation, session = estimated("linear", 1), campaign("linear", 1)
    state, excitation, _ = label.split("_")
    (decay,) = (d for d in estimation.decays if d.label == label)
    added = session.mass_states[state == ADDED].added
    at = evaluate(estimation.box, estimation.fit.eta, state, estimation.noise)
    static = static_loads_n(loaded_model(FULL, added), TYRES)
    found, sigma = least_loads_n(at, decay, linear_part(at, decay), static, TYRES)

    plant = load_car(FORD_GRANADA, added)
    motion = drive(plant, Bump(Excitation(excitation), 0.05, REST_S, BUMP_S), REST_S + 1.5)
    assert decay.start_s == pytest.approx(REST_S + BUMP_S, abs=1e-6)
    seen = motion.at(REST_S + BUMP_S + 1e-6 + np.arange(0.0, 1.0, 1e-3))
    true = tyre_loads(plant, seen.pose, seen.velocity).min(axis=1)
    assert true.min() > 1000.0
    # Half a per cent of the 2,000 to 3,000 N by which the tyres were relieved or loaded, and noise.
    np.testing.assert_allclose(found, true, atol=30.0)
    assert (sigma < 10.0).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bump_of_50_mm_lifts_nothing(seed: int) -> None:
    assert lift_off_findings(estimated("linear", seed)) == ()


def test_a_bump_of_130_mm_is_doubtful() -> None:
    """The last wheel comes down 23 ms after the bump, and the onset is seen 2 ms late."""
    (finding,) = lift_off_findings(estimated("lift_off_high", 1))
    assert (finding.code, finding.severity) == ("lift_off", Severity.WARNING)
    assert "use a lower bump" in finding.text
    assert " more;" in finding.text  # more than three wheels
    waited_ms = float(finding.text.split("once they are down, ")[1].split(" ms")[0])
    assert 15.0 < waited_ms < 25.0


def misstated(estimation: Estimation) -> Estimation:
    """Let the decays start 20 ms later than the session says that the bump ends."""
    records = tuple(replace(r, bump_s=r.bump_s - 0.02) for r in estimation.records)
    return replace(estimation, records=records)


def test_a_late_decay_is_a_lift_off_only_if_a_tyre_has_hardly_any_load() -> None:
    assert lift_off_findings(misstated(estimated("linear", 1))) == ()
    (finding,) = lift_off_findings(misstated(estimated("lift_off", 1)))
    assert finding.severity is Severity.WARNING
