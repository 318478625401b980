"""Counts how often intervals hold the truth.  `python -m tests.flow.coverage 50 granada-rough`.

The whole path from the simulated sensors on: encoded frames with jitter, runs cut, clocks
recovered, parameters identified.  Only the bus itself is left out, which changes no byte.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import Bench, load_bench
from daq.journal.reader import HopCounts
from daq.runs import Event
from daq.session.build import build_session
from daq.sessions import Session
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch, parse_codec
from identify.pipeline import identify_parameters
from identify.trust.finding import Judgement, Verdict
from tests.simulated.elements import named_car

START_NS = 1_760_000_000_000_000_000
CAR = SimulatedCar()


@dataclass(frozen=True, slots=True)
class Outcome:
    """One campaign identified."""

    errors: NDArray[np.float64]
    stds: NDArray[np.float64]
    """`errors`, `stds`: relative error and stated relative standard deviation of the 15 parameters,
    then of what else was identified."""
    names: tuple[str, ...]
    """Of all of them."""
    quality: Judgement
    """Judgement of the identification on itself."""

    @property
    def covered(self) -> NDArray[np.bool_]:
        """True for each 95 % interval that holds the truth."""
        return np.asarray(np.abs(self.errors) < 1.96 * self.stds)


def simulated_session(bench: Bench, seed: int, car: SimulatedCar = CAR) -> Session:
    """Return the session that a recorder makes of a simulated campaign."""
    codec = parse_codec(bench.dbc_text, bench.dbc_name)
    batches = list(campaign_frames(bench, codec, car, seed, START_NS))
    bumps = [
        Event(START_NS + round((i * car.run_s + car.lead_s) * 1e9), "bump", text=step.label)
        for i, step in enumerate(bench.campaign.steps)
    ]
    no_losses = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    return build_session(bench, codec, FrameBatch.concatenate(batches), bumps, no_losses, {})


def outcome(bench: Bench, seed: int, car: SimulatedCar = CAR) -> Outcome:
    """Simulate a campaign and identify it."""
    found = identify_parameters(simulated_session(bench, seed, car))
    truth = asdict(car.parameters)
    known = {name: e for name, e in found.parameters.items() if name in truth}
    return Outcome(
        np.array([e.value / truth[name] - 1 for name, e in known.items()]),
        np.array([e.std / abs(truth[name]) for name, e in known.items()]),
        tuple(known),
        found.quality,
    )


def main(campaigns: int, name: str = "granada") -> None:
    """Print what so many campaigns with a named car give."""
    bench, car = load_bench(None), named_car(name)
    outcomes = [outcome(bench, seed, car) for seed in range(campaigns)]
    names = outcomes[0].names
    errors = np.array([o.errors for o in outcomes])
    stds = np.array([o.stds for o in outcomes])
    z = errors / stds
    chi2 = np.array([o.quality.chi2_per_n for o in outcomes])
    height_mm = bench.campaign.bump_height_m * 1e3
    print(f"{campaigns} campaigns of {name}, shipped bench, {height_mm:.0f} mm bump")
    print(f"{'':6} rms error %  stated %  covered %  rms z")
    for i, parameter in enumerate(names):
        rms = np.sqrt(np.mean(errors[:, i] ** 2)) * 100
        covered = np.mean(np.abs(z[:, i]) < 1.96) * 100
        rms_z = np.sqrt(np.mean(z[:, i] ** 2))
        stated = stds[:, i].mean() * 100
        print(f"{parameter:6} {rms:11.3f} {stated:9.3f} {covered:10.1f} {rms_z:6.2f}")
    covered_in_all = np.mean([o.covered for o in outcomes]) * 100
    print(f"covered in all: {covered_in_all:.1f} %, rms z {np.sqrt(np.mean(z**2)):.2f}")
    print(f"largest error: {np.abs(errors).max() * 100:.2f} %")
    print(f"chi2/n: {chi2.min():.4f} .. {chi2.max():.4f}")
    for verdict in Verdict:
        print(f"{verdict}: {sum(o.quality.verdict is verdict for o in outcomes)}")


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
