"""Tables of damper curves, each read back by other means, and what is said where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from daq.errors import InputError
from identify import Estimate, Identification, Judgement
from identify.nonlinear.forces import AxleForces, DamperCurve, Forces
from tui.damper_table import write_damper_table


def test_each_axle_and_speed_is_a_row(tmp_path: Path) -> None:
    v = np.array([-0.1, 0.1])
    curve = DamperCurve(v, 1500.0 * v, np.ones(2), 1500.0 * v, np.ones(2))
    axles = (AxleForces("front", curve, {}, ()), AxleForces("rear", curve, {}, ()))
    result = Identification(Judgement((), 1.0), {}, forces=Forces(axles, ()))
    write_damper_table(result.document(), tmp_path / "d.csv")
    lines = (tmp_path / "d.csv").read_text().splitlines()
    assert lines[0].startswith("axle,speed_m_s,force_n,force_low_n,force_high_n")
    assert [line.split(",")[:3] for line in lines[1:]] == [
        ["front", "-0.1", "-150"], ["front", "0.1", "150"],
        ["rear", "-0.1", "-150"], ["rear", "0.1", "150"],
    ]  # fmt: skip


def test_a_linear_car_has_none(tmp_path: Path) -> None:
    document = Identification(Judgement((), 1.0), {}).document()
    with pytest.raises(InputError, match="the linear model explains the decays"):
        write_damper_table(document, tmp_path / "d.csv")
    assert not (tmp_path / "d.csv").exists()


def test_a_folder_is_created_or_its_fault_is_one_line(tmp_path: Path) -> None:
    curve = DamperCurve(*(np.zeros(1),) * 5)
    axles = (AxleForces("front", curve, {}, ()), AxleForces("rear", curve, {}, ()))
    document = Identification(Judgement((), 1.0), {}, forces=Forces(axles, ())).document()
    write_damper_table(document, tmp_path / "new" / "folder" / "d.csv")
    with pytest.raises(InputError, match="name another folder"):
        write_damper_table(document, tmp_path / "new" / "folder" / "d.csv" / "d.csv")


SPEED = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])


def made() -> Identification:
    """Return a result with a curve that differs front and rear, friction, and an open mount."""
    axles = []
    for axle, c in (("front", 1500.0), ("rear", 2100.0)):
        force = c * SPEED
        total = force + 50.0 * np.sign(SPEED)
        curve = DamperCurve(SPEED, force, np.full(5, 10.0), total, np.full(5, 20.0))
        friction = Estimate(50.0, 1.0, 48.04, 51.96, "N", 50.0)
        mount = Estimate(1e6, 4e5, 6e5, 4e6, "N/m")
        axles.append(AxleForces(axle, curve, {"friction": friction, "mount": mount}, ()))
    forces = Forces((axles[0], axles[1]), ())
    return Identification(Judgement((), 1.0), {}, forces=forces)


def _modelica_tables(text: str) -> dict[str, list[list[float]]]:
    """Read tables as the Modelica standard library states their form, sharing no code with it."""
    lines = text.splitlines()
    assert lines[0] == "#1"
    words = [w for line in lines[1:] if not line.startswith("#") for w in line.split()]
    tables: dict[str, list[list[float]]] = {}
    while words:
        assert words.pop(0) == "double"
        name, _, size = words.pop(0).rstrip(")").partition("(")
        rows, columns = (int(part) for part in size.split(","))
        values = [float(words.pop(0)) for _ in range(rows * columns)]
        tables[name] = [values[i * columns : (i + 1) * columns] for i in range(rows)]
    return tables


def test_the_text_is_a_table_of_modelica(tmp_path: Path) -> None:
    path = tmp_path / "dampers.txt"
    write_damper_table(made().document(), path)
    text = path.read_text()
    assert text.isascii()
    tables = _modelica_tables(text)
    assert list(tables) == ["front", "rear"]
    for name, c in (("front", 1500.0), ("rear", 2100.0)):
        table = np.array(tables[name])
        assert np.all(np.diff(table[:, 0]) > 0.0)  # CombiTable1Ds refuses any other
        np.testing.assert_allclose(table[:, 1], c * SPEED)
        np.testing.assert_allclose(table[:, 2], c * SPEED - 19.6, atol=0.01)
        np.testing.assert_allclose(table[:, 4], c * SPEED + 50.0 * np.sign(SPEED))
    assert "# rear friction = 50 N" in text
    assert "mount" not in text  # what is not determined has no number here either


def test_the_mat_file_has_the_same_matrices_and_the_other_elements(tmp_path: Path) -> None:
    path = tmp_path / "dampers.mat"
    write_damper_table(made().document(), path)
    found = loadmat(path, squeeze_me=True)
    np.testing.assert_allclose(found["rear"][:, 0], SPEED)
    np.testing.assert_allclose(found["rear"][:, 1], 2100.0 * SPEED)
    assert [str(name) for name in found["columns"][:2]] == ["speed_m_s", "force_n"]
    assert float(found["front_elements"]["friction"]) == 50.0
    assert found["front_elements"].dtype.names == ("friction",)


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"end its name in \.csv, \.txt, \.mat"):
        write_damper_table(made().document(), tmp_path / "dampers.xls")
