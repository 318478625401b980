"""Does the truth lie in the intervals as often as they say?  `python -m tests.flow.coverage 100`.

The whole path from the simulated sensors on: encoded frames with jitter, runs cut, clocks
recovered, parameters identified.  Only the bus itself is left out, which changes no byte.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import Bench, load_bench
from daq.derive.build_samples import build_session
from daq.journal.contents import HopCounts
from daq.runs import Event
from daq.sessions import Session
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch, parse_codec
from identify.fit.estimation import estimate, generic_vehicles
from identify.fit.uncertainty import estimates
from identify.pipeline import grey_box, usable_records
from identify.trust.finding import Quality, Verdict
from identify.trust.judge import judge

START_NS = 1_760_000_000_000_000_000
CAR = SimulatedCar()


@dataclass(frozen=True, slots=True)
class Outcome:
    """One campaign identified."""

    errors: NDArray[np.float64]
    stds: NDArray[np.float64]
    """`errors`, `stds`: relative error and stated relative standard deviation of each parameter,
    shape (15,)."""
    quality: Quality
    """What the identification says of itself."""

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Which 95 % intervals hold the truth, (15,)."""
        return np.asarray(np.abs(self.errors) < 1.96 * self.stds)


def simulated_session(bench: Bench, seed: int) -> Session:
    """Return the session that a recorder makes of a simulated campaign."""
    codec = parse_codec(bench.dbc_text, bench.dbc_name)
    batches = list(campaign_frames(bench, codec, CAR, seed, START_NS))
    bumps = [
        Event(START_NS + round((i * CAR.run_s + CAR.lead_s) * 1e9), "bump", text=step.label)
        for i, step in enumerate(bench.campaign.steps)
    ]
    no_losses = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    return build_session(bench, codec, FrameBatch.concatenate(batches), bumps, no_losses, {})


def outcome(bench: Bench, seed: int) -> Outcome:
    """Simulate a campaign and identify it."""
    session = simulated_session(bench, seed)
    records = usable_records(session)
    box = grey_box(session, records)
    estimation = estimate(box, records, generic_vehicles())
    parameters = estimates(box, estimation.fit)
    truth = asdict(CAR.parameters)
    return Outcome(
        np.array([e.value / truth[name] - 1 for name, e in parameters.items()]),
        np.array([e.std / truth[name] for name, e in parameters.items()]),
        judge(session, estimation),
    )


def main(campaigns: int) -> None:
    """Print what so many campaigns give."""
    bench = load_bench(None)
    outcomes = [outcome(bench, seed) for seed in range(campaigns)]
    errors = np.array([o.errors for o in outcomes])
    stds = np.array([o.stds for o in outcomes])
    chi2 = np.array([o.quality.chi2_per_n for o in outcomes])
    names = list(asdict(CAR.parameters))
    print(f"{campaigns} campaigns, shipped bench, {CAR.bump_height_m * 1e3:.0f} mm bump")
    print(f"{'':6} rms error %  stated %  covered %")
    for i, name in enumerate(names):
        rms = np.sqrt(np.mean(errors[:, i] ** 2)) * 100
        covered = np.mean(np.abs(errors[:, i]) < 1.96 * stds[:, i]) * 100
        print(f"{name:6} {rms:11.3f} {stds[:, i].mean() * 100:9.3f} {covered:10.1f}")
    print(f"covered in all: {np.mean([o.covered for o in outcomes]) * 100:.1f} %")
    print(f"largest error: {np.abs(errors).max() * 100:.2f} %")
    print(f"chi2/n: {chi2.min():.4f} .. {chi2.max():.4f}")
    for verdict in Verdict:
        print(f"{verdict}: {sum(o.quality.verdict is verdict for o in outcomes)}")


if __name__ == "__main__":
    main(int(sys.argv[1]))
