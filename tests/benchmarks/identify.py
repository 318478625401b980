"""Measures the likelihood fit: its time, its errors against the bound, where it converges."""

from __future__ import annotations

import time

import numpy as np

from identify.decays.decay import FreeDecay
from identify.fit.estimation import generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import HOLD, fit

from ..identify.bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records

CAMPAIGNS = 20
STARTS = 200
FACTOR = 3.0
LIMIT_S = {200.0: 1.0, 1000.0: 5.0}
BOX = GreyBox((GROUP,), MASS_STATES, None)


def main() -> None:
    """Print time, accuracy and convergence of the fit on the paper's six runs at 30 dB."""
    slow, fast = (_accuracy(rate_hz) for rate_hz in LIMIT_S)
    print(f"CPU at 1000 Hz / at 200 Hz: {fast / slow:.1f} (linear in samples: at most 5)")
    _starts()


def _campaign(rate_hz: float, seed: int) -> tuple[tuple[FreeDecay, ...], dict[str, float]]:
    records = paper_records(rate_hz, 30.0, seed)
    decays = tuple(record.decay(0.3 + 1e-9) for record in records)
    return decays, noise_of(records, rate_hz)


def _accuracy(rate_hz: float) -> float:
    """Print errors and time at one rate; return the CPU time of a fit, s."""
    start = BOX.unknowns(generic_vehicles()[0])
    errors, bounds, seconds = [], [], []
    for seed in range(CAMPAIGNS):
        decays, sigma = _campaign(rate_hz, seed)
        began = time.process_time()
        best = fit(BOX, decays, sigma, start)
        seconds.append(time.process_time() - began)
        errors.append(np.exp(best.eta) / TRUTH - 1)
        bounds.append(np.sqrt(np.diag(best.covariance)))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    ratio = rms / np.mean(bounds, axis=0)
    cpu_s = float(np.median(seconds))
    print(f"likelihood, 6 runs x 7 channels x 3 s at {rate_hz:.0f} Hz, 30 dB, generic start")
    print(f"  CPU {cpu_s:.2f} s a fit, covariance included (limit {LIMIT_S[rate_hz]:.0f} s)")
    print(f"  rms error {rms.min() * 100:.2f} .. {rms.max() * 100:.2f} %")
    print(
        f"  rms error / Cramer-Rao bound {ratio.min():.2f} .. {ratio.max():.2f} ({CAMPAIGNS} fits)"
    )
    return cpu_s


def _starts() -> None:
    decays, sigma = _campaign(200.0, 0)
    best = fit(BOX, decays, sigma, BOX.unknowns(TRUTH))
    std = np.sqrt(np.diag(best.covariance))
    rng = np.random.default_rng(1)
    there, steps = 0, []
    for _ in range(STARTS):
        start = TRUTH * FACTOR ** rng.uniform(-1.0, 1.0, len(TRUTH))
        found = fit(BOX, decays, sigma, BOX.unknowns(start), hold=HOLD)
        there += bool(found.converged and np.max(np.abs(found.eta - best.eta) / std) < 0.01)
        steps.append(found.iterations)
    print(f"starts within a factor {FACTOR:g} on all 15 parameters: {there} of {STARTS} led to")
    print(f"  the optimum, in {np.median(steps):.0f} steps, at most {max(steps)}")


if __name__ == "__main__":
    main()
