"""Records of simulated bumps for the tests of the estimation: the paper's runs, with noise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, MassState
from identify.decays.decay import Record
from identify.study.campaign import (
    PAPER_CASES,
    PAPER_MASS_STATES,
    SENSOR_SETS,
    Campaign,
    records_of,
)

MASS_STATES = PAPER_MASS_STATES
PAPER_DELTA_MASS = MASS_STATES[1].added.matrix
(GROUP,) = SENSOR_SETS["paper"]
CASES = PAPER_CASES
TRUTH = FORD_GRANADA.to_array()


def paper_records(
    rate_hz: float,
    noise_db: float,
    seed: int,
    cases: Iterable[Excitation] = CASES,
    mass_states: tuple[MassState, ...] = MASS_STATES,
    bump_s: float = 0.2,
) -> list[Record]:
    """Return one record for each case and mass state; `bump_s` is what the records state."""
    campaign = Campaign(rate_hz, noise_db, tuple(cases), mass_states=mass_states)
    return [replace(record, bump_s=bump_s) for record in records_of(campaign, seed)]


def noise_of(records: list[Record], rate_hz: float) -> dict[str, float]:
    """Return the noise levels that `paper_records` drew, by its difference from seed to seed."""
    other = paper_records(rate_hz, np.inf, 0)
    spread = [
        np.std(a.recordings[0].values - b.recordings[0].values, axis=0)
        for a, b in zip(records, other, strict=True)
    ]
    mean = np.sqrt(np.mean(np.square(spread), axis=0))
    return dict(zip([c.name for c in GROUP.channels], mean.tolist(), strict=True))
