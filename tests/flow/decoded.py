"""The demo's channels through files of other tools and back: `python -m tests.flow.decoded`.

Prints, for each format, the largest relative difference among the 15 parameters.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.sessions import Session
from identify.decays.usable import usable
from identify.fit.estimation import estimate, generic_vehicles
from identify.fit.uncertainty import estimates
from identify.pipeline import grey_box

from ..daq.formats.channel_files import WRITERS, again
from .coverage import simulated_session


def parameters(session: Session) -> NDArray[np.float64]:
    """Return the 15 parameters that a session gives."""
    records = usable(session).records
    box = grey_box(session, records)
    found = estimates(box, estimate(box, records, generic_vehicles()).fit)
    return np.array([each.value for each in found.values()])


def main() -> None:
    """Identify the session of the shipped bench, and what comes back from each format."""
    bench = load_bench(None)
    session = simulated_session(bench, 1)
    tables = bench.text.split("[vehicle]")[1].split("# The IMU lies")[0]
    tables = f"[vehicle]{tables}"
    recorder = tables.index("[recorder]")
    tables = tables[:recorder] + tables[tables.index("# The added masses") :]
    expected = parameters(session)
    with tempfile.TemporaryDirectory() as folder:
        for suffix in WRITERS:
            found = parameters(again(session, tables, Path(folder) / f"car{suffix}"))
            worst = np.max(np.abs(found / expected - 1.0))
            sys.stdout.write(f"{suffix:9} {worst:.1e}\n")


if __name__ == "__main__":
    main()
