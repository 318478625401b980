"""An outcome made by hand: round numbers, so that a screen can be judged by reading it."""

from __future__ import annotations

import math
from dataclasses import replace

from identify.numbers import half_width_percent, interval, rounded
from tui.jobs.outcome import (
    Curve,
    Estimated,
    FindingRow,
    ModeRow,
    Outcome,
    Row,
    RunOutcome,
    StateOutcome,
)

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
    FindingRow(
        "odd_run", "doubtful",
        "run baseline_bounce_2 differs from its repeat by 7.1 sigma (limit 5): somebody leaned on "
        "the car, or a damper warmed up; exclude it, or record bounce again",
    ),
    FindingRow("late_start", "ok", "the decays begin 0.05 s after the stated end of the bump"),
)  # fmt: skip


def _estimated(
    name: str, words: str, value: float, half: float, unit: str, rests_on: str = ""
) -> Estimated:
    text, *_ = rounded(value, value - half, value + half)
    ends = interval(value, value - half, value + half)
    share = half / value * 100.0 if half else None
    percent = half_width_percent(value, value - half, value + half)
    return Estimated(name, words, text, ends, share, percent, unit, rests_on)


def outcome(session: str = "/bench/session_0001.h5") -> Outcome:
    """Return the outcome of twelve good runs."""
    return Outcome(
        session,
        "T5-ABC123",
        "2026-11-21T10:42:00Z",
        (),
        "ok",
        "The parameters may be used.",
        "The model of the car explains the decays down to the noise of the "
        "sensors, and the intervals hold.",
        1.016,
        (),
        (),
        ("noise wheel_rr: lift in the next bay runs (MK)",),
        tuple(
            _estimated(name, words, value, half, unit, "baseline_bounce 40 %")
            for name, words, value, half, unit in _PARAMETERS
        ),
        (_estimated("total_mass", "total mass", 1552.0, 25.0, "kg"),),
        tuple(
            StateOutcome(
                state,
                tuple(
                    ModeRow(n, f"{share * f:.4f}", f"{0.002 * f:.4f}", f"{z:.4f}", "0.0016")
                    for n, f, z in _MODES
                ),
                _matrix(1380.0),
                _matrix(5986.0),
                _matrix(78043.0),
            )
            for state, share in (("baseline", 1.0), ("added", 0.96))
        ),
        tuple(RunOutcome(label, "accepted", (), 1.02, (_curve(),)) for label in _LABELS),
    )


def doubtful() -> Outcome:
    """Return one with a doubt, a note, and a run that was not used."""
    whole = outcome()
    run = replace(whole.runs[1], status="rejected", reasons=("second bump at +0.84 s",), curves=())
    return replace(
        whole,
        verdict="doubtful",
        headline="Use the parameters with care.",
        findings=DOUBTS,
        survival=(
            "usable, moved by no cause that was sized: I_xx, k_tf, k_tr, t_f, t_r",
            "lost, run baseline_bounce_2: m_s +4 %, k_sf -3 %",
        ),
        runs=(whole.runs[0], run, *whole.runs[2:]),
    )


def refused() -> Outcome:
    """Return one without numbers."""
    text = "no accepted run: record bounce, pitch and roll in both mass states"
    return replace(
        outcome(),
        verdict="refused",
        headline="The parameters must not be used.",
        findings=(FindingRow("no_runs", "refused", text),),
        chi2_per_n=math.nan,
        parameters=(),
        derived=(),
        states=(),
        runs=(),
    )


def _matrix(diagonal: float) -> tuple[Row, ...]:
    return tuple(
        tuple(diagonal if i == j else -0.25 * diagonal for j in range(7)) for i in range(7)
    )


def _curve() -> Curve:
    time_s = tuple(0.01 * i for i in range(300))
    fitted = tuple(4.0 * math.exp(-1.7 * t) * math.cos(6.6 * t) for t in time_s)
    ripple = tuple(y + 0.05 * math.sin(91.0 * t) for t, y in zip(time_s, fitted, strict=True))
    return Curve("body_acc_z", "m/s²", time_s, ripple, time_s, fitted)
