"""A result made by hand: round numbers, so that what is made of it can be judged by reading."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from dbc.words import Finding, Severity
from identify import Estimate, Identification, Judgement, ModalModel, PhysicalModel
from identify.fit.uncertainty import Correlation, ModeEstimate
from identify.modes.modal_model import Pairing
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.trust.finding import Loss, Survival


def estimate(value: float, half: float, unit: str) -> Estimate:
    """Return an estimate by half of its interval, taken as two standard deviations."""
    return Estimate(value, half / 2.0, value - half, value + half, unit)


OPEN = Estimate(0.7, inf, -inf, inf, "m")
"""A length that no run determines."""


def mode(hz: float, half_hz: float, ratio: float, half: float) -> ModeEstimate:
    return ModeEstimate(estimate(hz, half_hz, "Hz"), estimate(ratio, half, "1"))


def forces() -> Forces:
    """Return forces of a car that is not linear, known between -0.15 and 0.15 m/s."""
    speed = np.array([-0.15, 0.15])
    curve = DamperCurve(speed, 1000.0 * speed, np.full(2, 5.0), 1200.0 * speed, np.full(2, 10.0))
    kept = ElementChoice("friction", 120.0, 20.0, True, False, {})
    dropped = ElementChoice("bump_stops", 3.0, 40.0, False, False, {})
    front = AxleForces("front", curve, {"bump_stop": estimate(50.0, 3.9, "N")}, ())
    return Forces((front, replace(front, axle="rear", values={})), (kept, dropped))


def result() -> Identification:
    """Return a doubtful result with four reasons, an open length and forces."""
    findings = tuple(Finding(f"g{i}", Severity.WARNING, f"reason {i}") for i in range(4))
    survival = Survival(("m_s", "a"), {"t_f": Loss("not determined")})
    one = np.ones(1)
    model = ModalModel(np.array([3.0j - 4.0]), np.ones((1, 1), complex), 0.2 * one, 0.3 * one)
    return Identification(
        Judgement(findings, 1.0625, {"baseline_roll_1": {"hub": 1.5}},
                  {"baseline_roll_1": (20.0, 30.0)}, survival),
        {"uuid": "one", "created": "2026-11-22", "origin": "replayed"},
        parameters={
            "m_s": estimate(1380.0, 7.6, "kg"), "a": estimate(1.25, 0.0, "m"), "t_f": OPEN,
        },
        derived={"damping_ratio_heave": estimate(0.25, 0.011, "1")},
        motion_ratios={"travel_fl": estimate(0.7, 0.013, "1")},
        correlation=Correlation(("m_s", "t_f"), np.array([[1.0, 0.1], [0.1, 1.0]])),
        drivers={
            "m_s": {"baseline_bounce_1": 0.25, "baseline_bounce_2": 0.5, "wb": 0.25},
            "t_f": {"wb": 1.0},
        },
        modal={"baseline": model},
        modes={
            "baseline": (
                mode(1.2, 0.02, 0.25, 0.011),
                mode(10.0, 0.02, 0.2, 0.5),
                mode(11.0, 0.02, 0.3, 0.011),
            ),
            "added": (mode(9.5, 0.02, 0.2, 0.011), mode(1.1, 0.02, 0.24, 0.011)),
        },
        mode_names={
            "baseline": ("body bounce", "front wheels", "rear wheels"),
            "added": ("front wheels", "body bounce"),
        },
        pairings={
            "added": Pairing(np.array([0, 1]), np.array([1, 0]), np.array([0.9, 0.8]), ((0, 1),))
        },
        sensed={"baseline": model},
        closed_form={"m_s": 1400.0},
        closed_form_damping={"mean": {"c_sf": 1500.0}},
        closed_form_reason="one mass state",
        physical={"baseline": PhysicalModel(np.eye(7), 2.0 * np.eye(7), 3.0 * np.eye(7))},
        noise={"hub": 0.15},
        forces=forces(),
    )  # fmt: skip
