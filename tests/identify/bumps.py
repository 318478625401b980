"""Records of simulated bumps for the tests of the estimation: the paper's runs, with noise."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from daq.channels import paper_channels
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import FORD_GRANADA, AddedMass, MassState
from identify.decay import Clock, Record, Recording
from identify.model import delta_mass, physical_model
from identify.simulate import Bump, exact_response

PAPER_DELTA_MASS = np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0])
MASS_STATES = (MassState(BASELINE), MassState(ADDED, AddedMass(matrix=PAPER_DELTA_MASS)))
CLOCK = Clock("acceleration", paper_channels())
CASES = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
TRUTH = FORD_GRANADA.to_array()


def paper_records(
    rate_hz: float,
    noise_db: float,
    seed: int,
    cases: Iterable[Excitation] = CASES,
    mass_states: tuple[MassState, ...] = MASS_STATES,
    bump_s: float = 0.2,
) -> list[Record]:
    """Return one record for each case and mass state, 3 s with the bump at 0.1..0.3 s.

    Noise as METHOD section 5 defines it: white, on each acceleration, `noise_db` below that
    channel's rms over the records of its mass state.  `bump_s` is what the records state.
    """
    rng = np.random.default_rng(seed)
    records = []
    for state in mass_states:
        model = physical_model(FORD_GRANADA).with_mass(delta_mass(state.added, FORD_GRANADA.a).real)
        runs = {case: exact_response(model, case, Bump(), rate_hz, 3.0) for case in cases}
        power = np.mean([np.mean(r.acceleration**2, axis=0) for r in runs.values()], axis=0)
        sigma = np.sqrt(power) * 10 ** (-noise_db / 20)
        for case, run in runs.items():
            noisy = run.acceleration + sigma * rng.standard_normal(run.acceleration.shape)
            recording = Recording(CLOCK, run.time_s, noisy)
            records.append(Record(f"{state.name}_{case}_1", state.name, bump_s, (recording,)))
    return records


def noise_of(records: list[Record], rate_hz: float) -> dict[str, float]:
    """Return the noise levels that `paper_records` drew, by its difference from seed to seed."""
    other = paper_records(rate_hz, np.inf, 0)
    spread = [
        np.std(a.recordings[0].values - b.recordings[0].values, axis=0)
        for a, b in zip(records, other, strict=True)
    ]
    mean = np.sqrt(np.mean(np.square(spread), axis=0))
    return dict(zip([c.name for c in CLOCK.channels], mean.tolist(), strict=True))
