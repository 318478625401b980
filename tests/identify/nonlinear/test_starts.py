"""Where the search begins: a second start is tried where the first leads nowhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.sim import true_parameters
from daq.vehicle import Structure
from identify.decays.decay import Recording
from identify.decays.onset import decay_start_s
from identify.fit.grey_box import GreyBox
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.problem import run_of
from identify.nonlinear.release import Attempt, release
from identify.pipeline import identify
from identify.trust.finding import Verdict
from tests.simulated.fleet import fleet_car

from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records

BOX = GreyBox((GROUP,), MASS_STATES, None, Structure())
_LOW = 0.25
"""Share of the paper's bump: its own lifts the wheels."""


@pytest.fixture(scope="module")
def model() -> Model:
    return Model(BOX, KNOTS["K3"])


def attempt(model: Model, lost: bool, late_s: float = 0.0, disturbed: int = 0) -> Attempt:
    """Return a start, led astray or near; the first runs given have a knock at 0.05 s."""
    records = paper_records(200.0, 30.0, 3)
    sigma = {name: _LOW * level for name, level in noise_of(records, 200.0).items()}
    decays = []
    for i, record in enumerate(records):
        decay = record.decay(decay_start_s(record) + late_s)
        short = [r.between(0.0, 0.6) for r in decay.recordings]
        knock = [30.0 * (i < disturbed) * (abs(r.time_s + late_s - 0.05) < 0.02) for r in short]
        low = tuple(
            replace(r, values=_LOW * r.values + added[:, None] * _noise(r, sigma))
            for r, added in zip(short, knock, strict=True)
        )
        decays.append(replace(decay, recordings=low))
    runs = tuple(run_of(model, decay, sigma) for decay in decays)
    theta = TRUTH.copy()
    theta[[0, 2, 6, 8]] *= (6.0, 7.0, 20.0, 30.0) if lost else 1.1
    return Attempt(runs, runs, model.unknowns(BOX.unknowns(theta)), sigma, late_s)


def _noise(recording: Recording, sigma: Mapping[str, float]) -> NDArray[np.float64]:
    return np.array([sigma[channel.name] for channel in recording.group.channels])


@pytest.mark.parametrize(("astray", "asked"), [((True, False), 2), ((False, True), 1)])
def test_the_next_start_is_asked_for_where_one_leads_nowhere(
    model: Model, astray: tuple[bool, bool], asked: int
) -> None:
    given = []

    def attempts() -> Iterator[Attempt]:
        for lost in astray:
            given.append(lost)
            yield attempt(model, lost)

    found = release(model, attempts(), lambda _: False, lambda _: None)
    assert found is not None
    best, chosen = found
    assert chosen == ()
    assert len(given) == asked
    assert np.max(np.abs(np.exp(best.eta[:15]) / TRUTH - 1.0)) < 0.05


@pytest.mark.parametrize("disturbed", [0, 2])
def test_beginnings_that_were_left_out_come_back_where_the_car_explains_them(
    model: Model, disturbed: int
) -> None:
    first, late = attempt(model, True, 0.0, disturbed), attempt(model, False, 0.1)
    lines: list[str] = []
    found = release(model, iter((first, late)), lambda _: False, lines.append)
    assert found is not None
    fitted = found[0].point.problem.runs
    assert fitted == (*late.runs[:disturbed], *first.runs[disturbed:])
    assert np.max(np.abs(np.exp(found[0].eta[:15]) / TRUTH - 1.0)) < 0.05
    assert any(f"beginnings of {len(fitted) - disturbed} of" in line for line in lines)


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "seed", "weighed", "verdict"),
    [
        (8, 1, True, Verdict.OK),
        (8, 3, True, Verdict.OK),
        (12, 2, True, Verdict.OK),
        (10, 2, True, Verdict.OK),  # steps that made a damper's curve fall found no path
        (23, 2, True, Verdict.DOUBTFUL),  # some runs only from 0.15 s on
        (0, 3, False, Verdict.OK),  # a linear fit with the CG at the front axle
        (61, 3, False, Verdict.OK),  # the first start ends at chi2/n 3
        (36, 3, False, Verdict.OK),  # the start that ends lower leaves the beginnings out
        (3, 3, False, Verdict.OK),  # a mount would join too early
        (6, 2, False, Verdict.OK),  # a linear fit of 22 t
        (13, 3, False, Verdict.OK),
        (45, 1, False, Verdict.OK),  # mounts that join before the stops lead astray
        (56, 3, False, Verdict.OK),
        (65, 3, False, Verdict.OK),
        (53, 2, False, Verdict.OK),  # mounts that shrink to nothing and hold up the rest
        (3, 2, False, Verdict.OK),  # a step that moved the gap of a stop too far found no path
        (30, 3, False, Verdict.OK),
    ],
)
def test_cars_whose_linear_start_or_first_stage_is_far_off_are_found(
    number: int, seed: int, weighed: bool, verdict: Verdict
) -> None:
    """Light ones that leave the ground; a van and a small car with mounts and a stop."""
    drawn = fleet_car(number, seed, facts=weighed)
    found = identify(drawn.simulate().session)
    assert found.quality.verdict is verdict
    truth = true_parameters(drawn.car)
    for name in ("m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "a", "b"):
        assert found.parameters[name].value == pytest.approx(truth[name], rel=0.03), name
