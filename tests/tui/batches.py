"""Small session files and synthetic rows for batches, and a progress bar that interferes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from daq import Session, session_from_arrays, write_session
from daq.runs import Excitation
from daq.vehicle import DOF, Vehicle
from identify.batch import Row
from tests.identify.bumps import PAPER_DELTA_MASS, paper_records


def paper_session(seed: int) -> Session:
    """Return the paper's six runs at 30 dB."""
    runs = []
    for record in paper_records(
        100.0, 30.0, seed, (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    ):
        recording = record.recordings[0]
        samples = {
            name: (recording.time_s, column)
            for name, column in zip(DOF, recording.values.T, strict=True)
        }
        runs.append((record.mass_state, record.label.split("_")[1], samples))
    session = session_from_arrays(
        runs, delta_mass=PAPER_DELTA_MASS, bump_s=0.2, vehicle=Vehicle("Ford Granada")
    )
    return replace(session, provenance={"uuid": f"paper-{seed}"})


def refused_session(seed: int) -> Session:
    """Return half a campaign: refused within a moment."""
    t = np.arange(200) / 200.0
    noise = np.random.default_rng(seed).standard_normal((3, 200))
    swings = 100.0 * np.exp(-t) * np.cos(8.0 * t) + noise
    records = {name: (t, x) for name, x in zip(("z_s", "theta", "phi"), swings, strict=True)}
    return session_from_arrays([("baseline", "bounce", records)])


def write_all(folder: Path, make: Callable[[int], Session], count: int) -> list[Path]:
    """Write so many sessions to a folder and return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"car{seed:03}.h5" for seed in range(count)]
    for seed, file in enumerate(files):
        write_session(file, make(seed))
    return files


def progress_that(does: Callable[[], None], rows: int) -> Callable[[str], object]:
    """Return a replacement of `tui.output.progress` that does something after so many rows."""
    reported = 0

    @contextmanager
    def progress(title: str) -> Iterator[Callable[..., None]]:
        def stage(done: float, text: str = "") -> None:
            nonlocal reported
            reported += 1
            if reported == rows:
                does()

        yield stage

    return progress


def synthetic_rows(count: int, vehicles: tuple[str, ...] = ("Golf", "Transit")) -> list[Row]:
    """Return rows of identified sessions: m_s scatters by 5 kg about 1,500, its std is 3."""
    scatter = np.random.default_rng(1).standard_normal(count)
    return [
        {
            "file": f"/bench/car{i:05}.h5",
            "sha256": f"{i:064x}",
            "vehicle": vehicles[i % len(vehicles)],
            "created": f"2026-03-{1 + i % 28:02}T08:00:00+00:00",
            "origin": "real",
            "verdict": "ok",
            "reasons": "",
            "chi2_per_n": 1.0,
            "m_s": 1500.0 + 5.0 * float(scatter[i]),
            "m_s_std": 3.0,
            "baseline_1_hz": 1.2,
            "baseline_1_hz_std": 0.01,
            "seconds": 1.0,
            "software": "bumpbench",
            "libraries": "",
        }
        for i in range(count)
    ]
