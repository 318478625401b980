"""The CSV of damper curves, and what is said where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.errors import InputError
from identify import Identification, Quality
from identify.nonlinear.forces import AxleForces, DamperCurve, Forces
from tui.damper_csv import write_damper_csv


def test_each_axle_and_speed_is_a_row(tmp_path: Path) -> None:
    v = np.array([-0.1, 0.1])
    curve = DamperCurve(v, 1500.0 * v, np.ones(2), 1500.0 * v, np.ones(2))
    axles = (AxleForces("front", curve, {}, ()), AxleForces("rear", curve, {}, ()))
    result = Identification(Quality((), 1.0), {}, forces=Forces(axles, ()))
    write_damper_csv(result.document(), tmp_path / "d.csv")
    lines = (tmp_path / "d.csv").read_text().splitlines()
    assert lines[0].startswith("axle,speed_m_s,force_n,force_low_n,force_high_n")
    assert [line.split(",")[:3] for line in lines[1:]] == [
        ["front", "-0.1", "-150"], ["front", "0.1", "150"],
        ["rear", "-0.1", "-150"], ["rear", "0.1", "150"],
    ]  # fmt: skip


def test_a_linear_car_has_none(tmp_path: Path) -> None:
    document = Identification(Quality((), 1.0), {}).document()
    with pytest.raises(InputError, match="the linear model explains the decays"):
        write_damper_csv(document, tmp_path / "d.csv")
    assert not (tmp_path / "d.csv").exists()


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    curve = DamperCurve(*(np.zeros(1),) * 5)
    axles = (AxleForces("front", curve, {}, ()), AxleForces("rear", curve, {}, ()))
    document = Identification(Quality((), 1.0), {}, forces=Forces(axles, ())).document()
    with pytest.raises(InputError, match="cannot be written: No such file"):
        write_damper_csv(document, tmp_path / "none" / "d.csv")
