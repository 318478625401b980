"""An outcome made by hand: round numbers, so that a screen can be judged by reading it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dbc.finding import Finding, Severity
from identify import Estimate, Identification, Judgement, PhysicalModel
from identify.fit.uncertainty import ModeEstimate
from identify.trust.finding import Loss, Survival
from tui.jobs.worker import Outcome, RunOutcome

_PARAMETERS = (
    ("m_s", "sprung mass", 1380.0, 22.0, "kg"),
    ("I_yy", "pitch inertia", 2440.0, 81.0, "kg m2"),
    ("I_xx", "roll inertia", 380.0, 16.0, "kg m2"),
    ("m_uf", "wheel mass, front", 40.8, 0.9, "kg"),
    ("m_ur", "wheel mass, rear", 45.4, 1.1, "kg"),
    ("k_sf", "suspension spring, front", 17000.0, 370.0, "N/m"),
    ("k_sr", "suspension spring, rear", 22000.0, 520.0, "N/m"),
    ("k_tf", "tyre spring, front", 192000.0, 3900.0, "N/m"),
    ("k_tr", "tyre spring, rear", 192000.0, 4500.0, "N/m"),
    ("c_sf", "damper, front", 1500.0, 31.0, "N s/m"),
    ("c_sr", "damper, rear", 1500.0, 35.0, "N s/m"),
    ("a", "CG to front axle", 1.25, 0.026, "m"),
    ("b", "CG to rear axle", 1.51, 0.031, "m"),
    ("t_f", "half width, front", 0.74, 0.0, "m"),
    ("t_r", "half width, rear", 0.74, 0.0, "m"),
)
_MODES = (
    ("body bounce", 1.05, 0.26), ("body pitch", 1.31, 0.25), ("body roll", 1.65, 0.36),
    ("rear wheels symmetric", 10.78, 0.25), ("rear wheels antisymmetric", 10.79, 0.25),
    ("front wheels antisymmetric", 11.28, 0.26), ("front wheels symmetric", 11.29, 0.26),
)  # fmt: skip
_LABELS = [
    f"{state}_{kind}_{repeat}"
    for state in ("baseline", "added")
    for kind in ("bounce", "pitch", "roll")
    for repeat in (1, 2)
]
DOUBTS = (
    Finding(
        "odd_run", Severity.WARNING,
        "run baseline_bounce_2 differs from its repeat by 7.1 sigma (limit 5): somebody leaned on "
        "the car, or a damper warmed up; exclude it, or record bounce again",
    ),
    Finding(
        "late_start", Severity.NOTE, "the decays begin 0.05 s after the stated end of the bump"
    ),
)  # fmt: skip


def estimate(value: float, half: float, unit: str) -> Estimate:
    return Estimate(value, half / 1.96, value - half, value + half, unit)


def judged(outcome: Outcome, quality: Judgement) -> Outcome:
    """Return an outcome with another judgement."""
    return replace(outcome, result=replace(outcome.result, quality=quality))


def outcome(session: str = "/bench/session_0001.h5") -> Outcome:
    """Return the outcome of twelve good runs."""
    chi2 = {label: {"body_acc_z": 1.02} for label in _LABELS}
    whole = {"baseline": 1.0, "added": 0.96}
    result = Identification(
        Judgement((), 1.016, chi2),
        {},
        parameters={
            name: estimate(value, half, unit) for name, _, value, half, unit in _PARAMETERS
        },
        derived={"total_mass": estimate(1552.0, 25.0, "kg")},
        drivers={name: {"baseline_bounce_1": 0.4} for name, *_ in _PARAMETERS},
        modes={
            state: tuple(
                ModeEstimate(estimate(share * f, 0.002 * f, "Hz"), estimate(z, 0.0016, "1"))
                for _, f, z in _MODES
            )
            for state, share in whole.items()
        },
        mode_names={state: tuple(name for name, *_ in _MODES) for state in whole},
        physical={
            state: PhysicalModel(_matrix(1380.0), _matrix(5986.0), _matrix(78043.0))
            for state in whole
        },
    )
    runs = tuple(RunOutcome(label, "accepted", ()) for label in _LABELS)
    return Outcome(session, result, ("noise wheel_rr: lift in the next bay runs (MK)",), runs)


def doubtful() -> Outcome:
    """Return one with a doubt, a note, and a run that was not used."""
    lost = {
        name: Loss("run baseline_bounce_2", shift)
        for name, shift in (("m_s", 0.04), ("k_sf", -0.03))
    }
    survival = Survival(("I_xx", "k_tf", "k_tr", "t_f", "t_r"), lost)
    whole = outcome()
    quality = replace(whole.result.quality, findings=DOUBTS, survival=survival)
    run = RunOutcome(whole.runs[1].label, "rejected", ("second bump at +0.84 s",))
    return judged(replace(whole, runs=(whole.runs[0], run, *whole.runs[2:])), quality)


def refused() -> Outcome:
    """Return one without numbers."""
    text = "no accepted run: record bounce, pitch and roll in both mass states"
    quality = Judgement((Finding("no_runs", Severity.ERROR, text),), math.nan)
    return replace(outcome(), result=Identification(quality, {}), runs=())


def _matrix(diagonal: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.where(np.eye(7, dtype=bool), diagonal, -0.25 * diagonal)
