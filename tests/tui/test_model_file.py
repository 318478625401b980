"""The identified model in other programs' files: the physics that it must have, and the digits."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat

from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from dbc import InputError
from dbc.finding import Finding, Severity
from identify.fit.uncertainty import Correlation, Estimate
from identify.identification import Identification
from identify.model.matrices import physical_model
from identify.trust.finding import Judgement
from tui.model_file import state_space, write_model


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


def test_python_control(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    control = ModuleType("control")

    def ss(*matrices: Any, inputs: list[str], outputs: list[str]) -> tuple[Any, ...]:
        return (*map(np.array, matrices), inputs, outputs)

    vars(control)["ss"] = ss
    monkeypatch.setitem(sys.modules, "control", control)
    path = tmp_path / "m.py"
    write_model(_made(), path)
    held: dict[str, Any] = {}
    exec(path.read_text(), held)
    space = state_space(_made(), "baseline")
    for got, name in zip(held["systems"]["baseline"], "ABCD", strict=False):
        assert_array_equal(got, getattr(space, name))


def test_modelica(tmp_path: Path) -> None:
    path = tmp_path / "m.mo"
    write_model(_made(), path)
    text = path.read_text()
    assert text.startswith("block IdentifiedVehicle")
    assert text.rstrip().endswith("end IdentifiedVehicle;")
    assert text.count("{") == text.count("}")
    space = state_space(_made(), "baseline")
    for name, nxt in zip("ABC", "BCD", strict=True):
        part = text[text.index(f"  {name} = ") : text.index(f"  {nxt} = ")]
        numbers = [float(x) for x in re.findall(r"-?\d[\d.]*(?:e[+-]?\d+)?", part)]
        assert_array_equal(numbers, getattr(space, name).ravel())


def test_json(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    result = _made()
    write_model(result, path)
    document = json.loads(path.read_text())
    assert_array_equal(document["mass_states"]["baseline"]["K"], physical_model(FORD_GRANADA).K)
    found = np.array(document["covariance"]["matrix"])
    sigma = 0.01 * FORD_GRANADA.to_array()
    assert_allclose(np.sqrt(np.diag(found)), sigma)
    assert found[0, 1] == pytest.approx(0.5 * sigma[0] * sigma[1])
    assert "dbc" not in document["provenance"]


@pytest.mark.parametrize(
    ("name", "made", "why"),
    [
        ("m.xyz", _made(), "not a known form of model"),
        ("m.mat", _made(std=0.5), "not determined: m_s"),
        ("m.mat", _made(refused=True), "identification is refused"),
    ],
)
def test_what_is_not_written(tmp_path: Path, name: str, made: Identification, why: str) -> None:
    with pytest.raises(InputError, match=why):
        write_model(made, tmp_path / name)


def test_the_folder_of_a_model_is_created(tmp_path: Path) -> None:
    write_model(_made(), tmp_path / "new" / "m.mat")
    with pytest.raises(InputError, match="name another folder"):
        write_model(_made(), tmp_path / "new" / "m.mat" / "m.mat")
