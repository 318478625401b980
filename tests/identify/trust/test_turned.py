"""An IMU whose axes are turned about z against the car's: pitch and roll show a part of each other.

Through the simulated car, which is written from forces.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.config import load_bench
from daq.runs import Run
from daq.sessions import Session
from identify.pipeline import identify_parameters
from identify.trust.finding import Verdict

from ...flow.coverage import simulated_session
from .campaigns import by_gate

CODE = "IMU_turned_about_z"


def _turned(run: Run, angle: float) -> Run:
    """Return a run as an IMU shows it that is turned to the left, as seen from above."""
    groups = []
    for group in run.groups:
        shown = dict(group.values)
        if "roll_rate" in shown:
            roll, pitch = shown["roll_rate"], shown["pitch_rate"]  # about x forward, y to the left
            shown["roll_rate"] = np.cos(angle) * roll + np.sin(angle) * pitch
            shown["pitch_rate"] = np.cos(angle) * pitch - np.sin(angle) * roll
        groups.append(replace(group, values=shown))
    return replace(run, groups=tuple(groups))


@pytest.fixture(scope="module")
def straight() -> Session:
    return simulated_session(load_bench(None), 500)


@pytest.mark.parametrize("angle_deg", [5.0, pytest.param(-2.0, marks=pytest.mark.long)])
def test_the_angle_of_a_turned_imu_is_found(straight: Session, angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    turned = replace(straight, runs=tuple(_turned(run, angle) for run in straight.runs))
    found = identify_parameters(turned)
    assert found.quality.verdict is Verdict.DOUBTFUL
    text = by_gate(found.quality.findings)[CODE].text
    assert "with its x axis along the car" in text
    size, half = re.findall(r"IMU_Rate (\S+) ± (\S+) deg", text)[0]
    # To first order, and what remains of a large turn widens nothing.
    assert abs(float(size) - angle_deg) < max(2.0 * float(half), 0.03 * abs(angle_deg))
    assert found.forces is None  # no element of the car is sought for a fault of the bench


def test_an_imu_that_is_straight_is_no_finding(straight: Session) -> None:
    assert CODE not in by_gate(identify_parameters(straight).quality.findings)
