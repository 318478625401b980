"""How long the likelihood fit takes, and how its errors compare with the Cramer-Rao bound."""

from __future__ import annotations

import time

import numpy as np

from identify.estimation import generic_vehicles
from identify.greybox import GreyBox
from identify.likelihood import fit

from ..identify.bumps import CLOCK, MASS_STATES, TRUTH, noise_of, paper_records

CAMPAIGNS = 20


def main() -> None:
    """Print time and accuracy of the fit on the paper's six runs at 30 dB."""
    box = GreyBox((CLOCK,), MASS_STATES, None)
    start = box.unknowns(generic_vehicles()[0])
    for rate_hz in (200.0, 1000.0):
        errors, bounds, seconds = [], [], []
        for seed in range(CAMPAIGNS):
            records = paper_records(rate_hz, 30.0, seed)
            decays = tuple(record.decay(0.3 + 1e-9) for record in records)
            sigma = noise_of(records, rate_hz)
            began = time.process_time()
            best = fit(box, decays, sigma, start)
            seconds.append(time.process_time() - began)
            errors.append(np.exp(best.eta) / TRUTH - 1)
            bounds.append(np.sqrt(np.diag(best.covariance)))
        rms = np.sqrt(np.mean(np.square(errors), axis=0))
        ratio = rms / np.mean(bounds, axis=0)
        print(f"likelihood, 6 runs x 7 channels x 3 s at {rate_hz:.0f} Hz, 30 dB, generic start")
        print(f"  CPU {np.median(seconds):.2f} s a fit, covariance included")
        print(f"  rms error {rms.min() * 100:.2f} .. {rms.max() * 100:.2f} %")
        print(f"  rms error / Cramer-Rao bound {ratio.min():.2f} .. {ratio.max():.2f}")


if __name__ == "__main__":
    main()
