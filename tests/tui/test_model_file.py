"""The identified model in other programs' files: the physics that it must have, and the digits."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat

from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from dbc import InputError
from dbc.finding import Finding, Severity
from identify.fit.uncertainty import Correlation, Estimate
from identify.model.matrices import physical_model
from identify.nonlinear.forces import AxleForces, DamperCurve, Forces
from identify.result import Identification
from identify.trust.finding import Judgement
from tui.model_file import state_space, write_damper_table, write_model

from .batches import refused_session, write_all
from .conftest import said


def _made(std: float = 0.01, refused: bool = False) -> Identification:
    values = dict(zip(PARAMETER_NAMES, FORD_GRANADA.to_array().tolist(), strict=True))
    estimates = {n: Estimate(v, std * v, 0.0, 2.0 * v, "") for n, v in values.items()}
    n = len(values)
    matrix = 0.5 * np.eye(n) + 0.5
    return Identification(
        quality=Judgement((Finding("no_runs", Severity.ERROR, "no"),) if refused else (), 1.0),
        provenance={"uuid": "1", "dbc": "long"},
        parameters=estimates,
        correlation=Correlation(tuple(values), matrix),
        physical={"baseline": physical_model(FORD_GRANADA)},
    )


def test_a_raised_road_raises_the_car_and_weight_sinks_it() -> None:
    space = state_space(_made(), "baseline")
    gain = space.D - space.C @ np.linalg.solve(space.A, space.B)
    roads = [i for i, name in enumerate(space.inputs) if name.startswith("road under")]
    at_rest = gain[:, roads].sum(axis=1)
    outputs = dict(zip(space.outputs, at_rest, strict=True))
    for name, value in outputs.items():
        want = 1.0 if name in ("z_s [m]", *(f"z_u{c} [m]" for c in "ABCD")) else 0.0
        assert value == pytest.approx(want, abs=1e-9), name
    car = FORD_GRANADA
    # A force at the CG: springs in series with tyres, two front and two rear, about the CG.
    front = 2.0 / (1.0 / car.k_sf + 1.0 / car.k_tf)
    rear = 2.0 / (1.0 / car.k_sr + 1.0 / car.k_tr)
    stiffness = np.array(
        [[front + rear, rear * car.b - front * car.a], [0.0, front * car.a**2 + rear * car.b**2]]
    )
    stiffness[1, 0] = stiffness[0, 1]
    assert_allclose(gain[:2, 0], np.linalg.solve(stiffness, [1.0, 0.0]), rtol=1e-9)


def test_a_roll_turns_left_and_right_travels_apart() -> None:
    space = state_space(_made(), "baseline")
    travel = dict(zip(space.outputs, space.C, strict=True))
    roll = space.outputs.index("phi [rad]")
    car = FORD_GRANADA
    found = [travel[f"travel {corner} [m]"][roll] for corner in ("FL", "FR", "RL", "RR")]
    assert_allclose(found, [-car.t_f, car.t_f, -car.t_r, car.t_r])
    pitch = space.outputs.index("theta [rad]")
    found = [travel[f"travel {corner} [m]"][pitch] for corner in ("FL", "FR", "RL", "RR")]
    assert_allclose(found, [car.a, car.a, -car.b, -car.b])


def test_matlab(tmp_path: Path) -> None:
    path = tmp_path / "m.mat"
    write_model(_made(), path)
    held = loadmat(path, simplify_cells=True)
    model, space = physical_model(FORD_GRANADA), state_space(_made(), "baseline")
    for name, want in (("M", model.M), ("C_damping", model.C), ("K", model.K), ("A", space.A)):
        assert_array_equal(held["baseline"][name], want)
    assert list(held["inputs"]) == list(space.inputs)
    assert held["parameters"]["m_s"] == FORD_GRANADA.m_s
    sigma = 0.01 * FORD_GRANADA.to_array()
    assert_allclose(np.sqrt(np.diag(held["covariance"])), sigma)


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (_made(std=0.5), "not determined: m_s"),
        (_made(refused=True), "identification is refused"),
    ],
)
def test_what_is_not_written(tmp_path: Path, made: Identification, why: str) -> None:
    with pytest.raises(InputError, match=why):
        write_model(made, tmp_path / "m.mat")


def test_the_folder_of_a_file_is_created_or_its_fault_is_one_line(tmp_path: Path) -> None:
    write_model(_made(), tmp_path / "new" / "m.mat")
    with pytest.raises(InputError, match="name another folder"):
        write_model(_made(), tmp_path / "new" / "m.mat" / "m.mat")


# Curves of dampers --------------------------------------------------------------------------------

SPEED = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])


def with_curves() -> Identification:
    """Return a result with a curve that differs front and rear, friction, and an open mount."""
    axles = []
    for axle, c in (("front", 1500.0), ("rear", 2100.0)):
        force = c * SPEED
        total = force + 50.0 * np.sign(SPEED)
        curve = DamperCurve(SPEED, force, np.full(5, 10.0), total, np.full(5, 20.0))
        friction = Estimate(50.0, 1.0, 48.04, 51.96, "N", 50.0)
        mount = Estimate(1e6, 4e5, 6e5, 4e6, "N/m")
        axles.append(AxleForces(axle, curve, {"friction": friction, "mount": mount}, ()))
    return Identification(Judgement((), 1.0), {}, forces=Forces((axles[0], axles[1]), ()))


def test_each_axle_and_speed_is_a_row(tmp_path: Path) -> None:
    write_damper_table(with_curves(), tmp_path / "d.csv")
    header, *rows = csv.reader((tmp_path / "d.csv").read_text().splitlines())
    assert header[:5] == ["axle", "speed_m_s", "force_n", "force_low_n", "force_high_n"]
    assert [row[0] for row in rows] == ["front"] * 5 + ["rear"] * 5
    found = np.array([row[1:] for row in rows[5:]], dtype=float)
    assert_allclose(found[:, 0], SPEED)
    assert_allclose(found[:, 1], 2100.0 * SPEED)
    assert_allclose(found[:, 2], 2100.0 * SPEED - 19.6, atol=0.01)
    assert_allclose(found[:, 4], 2100.0 * SPEED + 50.0 * np.sign(SPEED))


def test_the_mat_file_has_the_same_matrices_and_the_other_elements(tmp_path: Path) -> None:
    path = tmp_path / "dampers.mat"
    write_damper_table(with_curves(), path)
    found = loadmat(path, squeeze_me=True)
    assert_allclose(found["rear"][:, 0], SPEED)
    assert_allclose(found["rear"][:, 1], 2100.0 * SPEED)
    assert [str(name) for name in found["columns"][:2]] == ["speed_m_s", "force_n"]
    assert float(found["front_elements"]["friction"]) == 50.0
    # What is not determined has no number here either.
    assert found["front_elements"].dtype.names == ("friction",)


def test_a_linear_car_has_no_curve(tmp_path: Path) -> None:
    linear = Identification(Judgement((), 1.0), {})
    with pytest.raises(InputError, match="the linear model explains the decays"):
        write_damper_table(linear, tmp_path / "d.csv")
    assert not (tmp_path / "d.csv").exists()


def test_an_identification_that_is_refused_says_so_and_writes_no_model(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (file,) = map(str, write_all(tmp_path, refused_session, 1))
    out, err = said(capsys, "identify", file, code=1)
    assert out.splitlines()[0] == "verdict: refused", "without a fit there is no chi2"
    assert err == ""
    for option, name in (("--dampers", "d.csv"), ("--model", "m.mat")):
        target = tmp_path / name
        out, err = said(capsys, "identify", file, option, str(target), code=2)
        assert out.splitlines()[0].startswith("verdict: refused")
        assert f"{target}: not written" in err
        assert not target.exists()
