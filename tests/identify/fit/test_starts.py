"""From wherever the search begins, it ends at the optimum."""

from __future__ import annotations

import numpy as np

from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import HOLD, fit

from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records

STARTS = 30
"""Of the 200 that `tests.benchmarks.identify` tries."""
FACTOR = 3.0
BOX = GreyBox((GROUP,), MASS_STATES, None)


def test_any_start_within_a_factor_three_on_all_parameters_leads_to_the_optimum() -> None:
    records = paper_records(200.0, 30.0, 11)
    decays = tuple(r.decay(0.3 + 1e-9) for r in records)
    sigma = noise_of(records, 200.0)
    best = fit(BOX, decays, sigma, BOX.unknowns(TRUTH))
    std = np.sqrt(np.diag(best.covariance))
    assert np.max(np.abs(best.eta - np.log(TRUTH)) / std) < 4.0
    rng = np.random.default_rng(7)
    for _ in range(STARTS):
        start = TRUTH * FACTOR ** rng.uniform(-1.0, 1.0, len(TRUTH))
        found = fit(BOX, decays, sigma, BOX.unknowns(start), hold=HOLD)
        assert found.converged
        assert np.max(np.abs(found.eta - best.eta) / std) < 0.01
