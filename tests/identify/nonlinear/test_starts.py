"""Where the search begins: a second start is tried where the first leads nowhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from daq.sim import fleet_car, true_parameters
from daq.vehicle import Structure
from identify.decays.onset import decay_start_s
from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import owns_of
from identify.nonlinear.car import Model
from identify.nonlinear.release import Attempt, release
from identify.nonlinear.run import run_of
from identify.nonlinear.unknowns import KNOTS
from identify.pipeline import identify
from identify.trust.finding import Verdict

from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records

BOX = GreyBox((GROUP,), MASS_STATES, None, Structure())
_LOW = 0.25
"""Share of the paper's bump: its own lifts the wheels."""


@pytest.mark.parametrize(("astray", "asked"), [((True, False), 2), ((False, True), 1)])
def test_the_next_start_is_asked_for_where_one_leads_nowhere(
    astray: tuple[bool, bool], asked: int
) -> None:
    records = paper_records(200.0, 30.0, 3)
    sigma = {name: _LOW * level for name, level in noise_of(records, 200.0).items()}
    decays = []
    for record in records:
        short = [r.between(0.0, 0.6) for r in record.decay(decay_start_s(record)).recordings]
        low = tuple(replace(r, values=_LOW * r.values) for r in short)
        decays.append(replace(record.decay(decay_start_s(record)), recordings=low))
    model = Model(BOX, KNOTS["K3"])
    given = []
    runs = tuple(run_of(model, decay, sigma) for decay in decays)

    def attempts() -> Iterator[Attempt]:
        for lost in astray:
            theta = TRUTH.copy()
            theta[[0, 2, 6, 8]] *= (6.0, 7.0, 20.0, 30.0) if lost else 1.1
            eta = model.unknowns(BOX.unknowns(theta))
            given.append(lost)
            yield Attempt(runs, runs, eta, owns_of(model, eta, tuple(decays), sigma))

    found = release(model, attempts(), lambda _: False, lambda _: None)
    assert found is not None
    best, chosen = found
    assert chosen == ()
    assert len(given) == asked
    assert np.max(np.abs(np.exp(best.eta[:15]) / TRUTH - 1.0)) < 0.05


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "seed", "verdict"),
    [
        (8, 1, Verdict.OK),
        (8, 3, Verdict.OK),
        (12, 2, Verdict.OK),
        (23, 2, Verdict.DOUBTFUL),  # only from 0.15 s on
    ],
)
def test_cars_whose_linear_start_or_first_stage_is_far_off_are_found(
    number: int, seed: int, verdict: Verdict
) -> None:
    """Light ones that leave the ground; a van with mounts and a stop; all weighed on scales."""
    drawn = fleet_car(number, seed, facts=True)
    found = identify(drawn.simulate().session)
    assert found.quality.verdict is verdict
    truth = true_parameters(drawn.car)
    for name in ("m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "a", "b"):
        assert found.parameters[name].value == pytest.approx(truth[name], rel=0.03), name
