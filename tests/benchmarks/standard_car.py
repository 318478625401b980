"""The standard car of the nonlinear method, with one element more in each row, by forces.

`python -m tests.benchmarks.standard_car [SEEDS [ROW ...]]`: 2 by default, each 5 to 20 CPU s;
rows are those of `ROWS`.  Bars: the worst of the 13 masses, inertias, stiffnesses and lengths
within 1.2 % of the truth as root mean square (0.6 % at 1 kHz, 2 % without travels, 1.5 % with
everything, 1.8 % with a mount); standardised errors of 1.1 as root mean square; intervals that
hold 92 to 98 %; chi2/n of 0.985 to 1.015; the friction within 1 N, the damper's curve within 1.5
%.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from daq.channels import Channel
from daq.sessions import Session, session_from_arrays
from daq.vehicle import Vehicle
from identify.nonlinear.release import BY_NAME
from identify.pipeline import identify
from identify.result import Identification

from ..identify.nonlinear.truth import (
    BUMP_S,
    SPEEDS,
    WEIGHTS,
    Motions,
    Truth,
    campaign,
    channels,
    drive,
    records,
)

END_S = 2.5
STEP_S = 1e-4
CURVE_M_S = np.linspace(-0.4, 0.4, 81)
USUAL = {"friction", "one_sided_dampers", "damper_knees", "anti_roll_bars"}
"""Elements of the standard car."""


@dataclass(frozen=True)
class Row:
    """One truth, and how it is measured."""

    car: Truth = field(default_factory=Truth)
    heights: Sequence[float] = (0.03, 0.05)
    rate_hz: float = 200.0
    travels: bool = True
    more: frozenset[str] = frozenset()
    """Elements that the car has beside those of the standard car."""
    known: bool = False
    """True if `[vehicle.structure]` says which elements the car has: all others are forbidden."""


ROWS: Mapping[str, Row] = {
    "standard": Row(),
    "standard, its elements known": Row(known=True),
    "IMU and hubs, its elements known": Row(travels=False, known=True),
    "1 kHz": Row(rate_hz=1000.0),
    "IMU and hubs": Row(travels=False),
    "mount 3e5": Row(Truth(k_m=(3e5, 3e5)), more=frozenset({"damper_mounts"})),
    "mount 1e6": Row(Truth(k_m=(1e6, 1e6)), more=frozenset({"damper_mounts"})),
    "mount 3e6": Row(Truth(k_m=(3e6, 3e6)), more=frozenset({"damper_mounts"})),
    "sides": Row(
        Truth(friction=(70.0, 30.0, 50.0, 50.0), ratio=(4 / 3, 2 / 3, 1.0, 1.0)),
        more=frozenset({"friction_left_right", "dampers_left_right"}),
    ),
    "springs and tyres": Row(
        Truth(k_2=(4e4, 4e4), beta=(6.0, 6.0)),
        more=frozenset({"progressive_springs", "progressive_tyres"}),
    ),
    "stop": Row(Truth(k_b=(1e5, 1e5), gap=(0.015, 0.015)), more=frozenset({"bump_stops"})),
    "lift-off 60 and 90 mm": Row(heights=(0.06, 0.09)),
    "lift-off 90 and 120 mm": Row(heights=(0.09, 0.12)),
    "smooth dampers": Row(Truth(smooth=True)),
    "LuGre": Row(Truth(static=1.4), more=frozenset({"static_friction"})),
    "everything": Row(
        Truth(
            k_m=(1e6, 1e6), friction=(65.0, 35.0, 65.0, 35.0), ratio=(0.75, 1.25, 1.0, 1.0),
            k_2=(4e4, 4e4), k_3=(8e5, 8e5), beta=(6.0, 6.0), c_t=(100.0, 100.0),
        ),
        more=frozenset(
            {"damper_mounts", "friction_left_right", "dampers_left_right", "progressive_springs",
             "progressive_tyres", "tyre_damping"}
        ),
    ),
}  # fmt: skip


def true_parameters(car: Truth) -> dict[str, float]:
    """Return the 13 parameters that the bars are of."""
    return {
        "m_s": car.m_s, "I_yy": car.I_yy, "I_xx": car.I_xx, "m_uf": car.m_u[0], "m_ur": car.m_u[2],
        "k_sf": car.k_s[0], "k_sr": car.k_s[2], "k_tf": car.k_t[0], "k_tr": car.k_t[2],
        "a": car.a, "b": car.b, "t_f": car.t_f, "t_r": car.t_r,
    }  # fmt: skip


def session_of(row: Row, motions: Motions, seed: int) -> Session:
    """Return the session of a row's campaign, with noise."""
    bumps = campaign(row.heights)
    found = records(row.car, bumps, motions, seed, row.rate_hz, channels(row.travels))
    known: dict[str, Channel] = {}
    runs: list[tuple[str, str, Any]] = []
    for record in found:
        parts = {}
        for recording in record.recordings:
            for i, channel in enumerate(recording.group.channels):
                known[channel.name] = channel
                parts[channel.name] = (recording.time_s, recording.values[:, i])
        runs.append((record.mass_state, record.label.split("_")[1], parts))
    there = USUAL | row.more
    elements = {name: name in there for name in BY_NAME} if row.known else {}
    vehicle = Vehicle("standard", elements=elements)
    return session_from_arrays(runs, known.values(), WEIGHTS, vehicle, bump_s=BUMP_S)


def _curve_error(found: Identification, car: Truth) -> float:
    """Return the largest error of the dampers' curves over their largest force, both axles."""
    assert found.forces is not None
    worst = 0.0
    for axle, forces in enumerate(found.forces.axles):
        curve = forces.damper
        shown = CURVE_M_S[(curve.speed_m_s[0] <= CURVE_M_S) & (curve.speed_m_s[-1] >= CURVE_M_S)]
        true = np.interp(shown, SPEEDS, car.damper(axle))
        mine = np.interp(shown, curve.speed_m_s, curve.force_n)
        worst = max(worst, float(np.max(np.abs(mine - true)) / np.max(np.abs(true))))
    return worst


def measure(name: str, row: Row, seeds: int) -> str:
    """Identify a row with several noises; return its figures in words."""
    motions = drive(row.car, campaign(row.heights), END_S, STEP_S)
    truth = true_parameters(row.car)
    errors, scores, friction, curves, chi2, cpu = [], [], [], [], [], []
    verdicts: dict[str, int] = {}
    missed: set[str] = set()
    false: set[str] = set()
    for seed in range(seeds):
        session = session_of(row, motions, seed + 1)
        began = time.process_time()
        found = identify(session)
        cpu.append(time.process_time() - began)
        verdict = found.quality.verdict.value
        verdicts[verdict] = verdicts.get(verdict, 0) + 1
        if verdict == "refused" or found.forces is None:
            continue
        estimates = [found.parameters[p] for p in truth]
        off = np.array([e.value for e in estimates]) - list(truth.values())
        errors.append(off / list(truth.values()))
        scores.append(off / [e.std for e in estimates])
        for axle, mean in zip(found.forces.axles, (0, 2), strict=True):
            true = float(np.mean(row.car.friction[mean : mean + 2]))
            friction.append(axle.values["friction"].value - true)
        curves.append(_curve_error(found, row.car))
        chi2.append(found.quality.chi2_per_n)
        kept = {choice.name for choice in found.forces.choices if choice.kept}
        missed |= (USUAL | row.more) - kept
        false |= kept - USUAL - row.more
    if not errors:
        return f"{name}: {verdicts}"
    z = np.array(scores)
    return (
        f"{name}: {verdicts}, worst of 13 {100 * _rms(np.array(errors)).max():.2f} %,"
        f" rms z {np.sqrt(np.mean(z**2)):.2f}, intervals hold {np.mean(np.abs(z) < 1.96):.1%},"
        f" chi2/n {min(chi2):.3f} to {max(chi2):.3f}, friction {_rms(np.array(friction)):.2f} N,"
        f" curve {np.median(curves):.1%}, {np.median(cpu):.1f} CPU s;"
        f" not named: {', '.join(sorted(missed)) or 'none'};"
        f" wrongly named: {', '.join(sorted(false)) or 'none'}"
    )


def _rms(values: np.ndarray[Any, np.dtype[np.float64]]) -> Any:
    return np.sqrt(np.mean(np.square(values), axis=0))


def main(seeds: int = 2, names: Sequence[str] = ()) -> None:
    """Print a line for each row, or for the named ones."""
    for name in names or tuple(ROWS):
        print(measure(name, ROWS[name], seeds), flush=True)


if __name__ == "__main__":
    main(int((sys.argv[1:2] or ["2"])[0]), sys.argv[2:])
