"""Eqs. 22-33 on true modes, with diagonal and full added mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight, VehicleGeometry
from dbc.words import InputError
from identify.model.matrices import PhysicalModel, delta_mass, physical_model
from identify.modes.modal_model import ModalModel, modes_of
from identify.paper import (
    identify_parameters,
    physical_matrices,
    sequential_vehicle,
    state_matrix_of,
)

VEHICLE = physical_model(FORD_GRANADA)
PAPER = np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0])
HUBS: tuple[HubWeight, ...] = tuple(
    HubWeight(mass, corner) for mass, corner in zip((4, 4, 5, 5), Corner, strict=True)
)
SKEWED: tuple[BodyWeight | HubWeight, ...] = (
    BodyWeight(70.0, x_m=-0.4, y_m=0.5, height_m=0.3),
    BodyWeight(25.0, x_m=0.3, y_m=-0.4),
    BodyWeight(40.0, x_m=-2.9, y_m=0.1),
    *HUBS,
)


def test_the_state_matrix_comes_back_from_its_modes() -> None:
    found = state_matrix_of(modes_of(VEHICLE.A))
    size = np.abs(VEHICLE.A).max()
    np.testing.assert_allclose(found, VEHICLE.A, atol=1e-11 * size)


@pytest.mark.parametrize(
    "dM", [PAPER, delta_mass(AddedMass(SKEWED), FORD_GRANADA.a).real], ids=["paper", "full"]
)
def test_mass_damping_and_stiffness_come_back(dM: NDArray[np.float64]) -> None:
    found = physical_matrices(VEHICLE.A, VEHICLE.with_mass(dM).A, dM)
    for name in ("M", "C", "K"):
        truth = getattr(VEHICLE, name)
        np.testing.assert_allclose(getattr(found, name), truth, atol=1e-9 * np.abs(truth).max())


@pytest.mark.parametrize("geometry", [None, FORD_GRANADA.geometry], ids=["15", "11"])
def test_parameters_come_back_through_a_full_added_mass(geometry: VehicleGeometry | None) -> None:
    dM = delta_mass(AddedMass(SKEWED), FORD_GRANADA.a).real
    result = identify_parameters(
        modes_of(VEHICLE.A),
        modes_of(VEHICLE.with_mass(dM).A),
        dM,
        geometry,
    )
    np.testing.assert_allclose(result.parameters.to_array(), FORD_GRANADA.to_array(), rtol=1e-9)


def _damping_by_forces(c_front: float, c_rear: float) -> NDArray[np.float64]:
    """Return C column by column: the dampers' pull against a unit velocity of each coordinate."""
    places = ((1.25, 0.74), (1.25, -0.74), (-1.51, 0.74), (-1.51, -0.74))  # x forward, y left
    columns = []
    for velocity in np.eye(7):
        force = np.zeros(7)
        for wheel, (x, y) in enumerate(places):
            body = velocity[0] - x * velocity[1] + y * velocity[2]
            pull = (c_front if wheel < 2 else c_rear) * (body - velocity[3 + wheel])
            force[:3] += pull * np.array([1.0, -x, y])
            force[3 + wheel] -= pull
        columns.append(force)
    return np.array(columns).T


@pytest.mark.parametrize(
    "dM", [PAPER, delta_mass(AddedMass(SKEWED), FORD_GRANADA.a).real], ids=["paper", "full"]
)
def test_each_way_to_the_damping_finds_the_dampers_of_its_own_runs(
    dM: NDArray[np.float64],
) -> None:
    """The dampers are warmer in the loaded runs: 1500 and 1400 first, then 1300 and 1700 N s/m."""
    cold, warm = _damping_by_forces(1500.0, 1400.0), _damping_by_forces(1300.0, 1700.0)
    lower = [
        np.hstack([-np.linalg.solve(M, VEHICLE.K), -np.linalg.solve(M, C)])
        for M, C in ((VEHICLE.M, cold), (VEHICLE.M + dM, warm))
    ]
    light, loaded = (np.vstack([np.eye(7, 14, 7), rows]) for rows in lower)
    found = identify_parameters(modes_of(light), modes_of(loaded), dM, None).damping
    assert list(found) == ["baseline", "added", "mean"]
    for way, front, rear in (
        ("baseline", 1500.0, 1400.0), ("added", 1300.0, 1700.0), ("mean", 1400.0, 1550.0),
    ):  # fmt: skip
        assert found[way] == pytest.approx({"c_sf": front, "c_sr": rear}, rel=1e-6)


def test_a_wrong_tape_measure_stays_and_spoils_only_what_depends_on_it() -> None:
    wrong = replace(FORD_GRANADA.geometry, a=1.05 * 1.25, b=1.05 * 1.51)
    result = identify_parameters(
        modes_of(VEHICLE.A), modes_of(VEHICLE.with_mass(PAPER).A), PAPER, wrong
    )
    assert result.parameters.geometry == wrong
    found = result.parameters.to_array() / FORD_GRANADA.to_array() - 1.0
    np.testing.assert_allclose(found[:5], 0.0, atol=1e-9)  # M does not know of lengths (Fig. 8)
    assert abs(found[5]) > 0.005


def test_a_vehicle_of_negative_mass_is_no_answer() -> None:
    """As if the weights had been taken off in the second state."""
    with pytest.raises(InputError, match="no vehicle with positive parameters"):
        identify_parameters(modes_of(VEHICLE.A), modes_of(VEHICLE.with_mass(PAPER).A), -PAPER, None)


@pytest.mark.parametrize(
    ("weights", "names"),
    [
        (SKEWED[:3], "z_uA, z_uB, z_uC, z_uD"),
        ((*SKEWED[:3], *HUBS[:2], HUBS[3]), "z_uC"),
        (HUBS, "z_s, theta, phi"),
        ((BodyWeight(50.0, x_m=-1.25, y_m=0.3), *HUBS), "z_s, theta, phi"),
        ((BodyWeight(30.0, x_m=-0.5, y_m=0.0), BodyWeight(30.0, -2.0, 0.0), *HUBS), "phi"),
    ],
)
def test_degrees_of_freedom_without_mass_are_named(
    weights: tuple[BodyWeight | HubWeight, ...], names: str
) -> None:
    dM = delta_mass(AddedMass(weights), FORD_GRANADA.a).real
    with pytest.raises(InputError, match=f"no mass moves with {names} "):
        physical_matrices(VEHICLE.A, VEHICLE.with_mass(dM).A, dM)


def test_six_modes_are_refused() -> None:
    modes = modes_of(VEHICLE.A)
    with pytest.raises(InputError, match="6 modes for 7 degrees of freedom"):
        state_matrix_of(ModalModel(modes.poles[:6], modes.shapes[:, :6]))


def test_the_same_mode_twice_is_refused() -> None:
    modes = modes_of(VEHICLE.A)
    twice = [0, 1, 2, 3, 4, 5, 5]
    with pytest.raises(InputError, match="same pole and shape"):
        state_matrix_of(ModalModel(modes.poles[twice], modes.shapes[:, twice]))


# The paper's order of estimation ------------------------------------------------------------------

GRANADA = physical_model(FORD_GRANADA)


def identified(name: str, row: int, column: int, factor: float) -> NDArray[np.float64]:
    """Return the parameters, over the true ones, where one element came out otherwise."""
    matrices = {key: getattr(GRANADA, key).copy() for key in ("M", "C", "K")}
    matrices[name][row, column] *= factor
    found = sequential_vehicle(PhysicalModel(**matrices))
    return np.asarray(found.to_array() / FORD_GRANADA.to_array())


def test_exact_matrices_give_the_exact_vehicle() -> None:
    assert sequential_vehicle(GRANADA).to_array() == pytest.approx(FORD_GRANADA.to_array())


@pytest.mark.parametrize(
    ("name", "row", "column", "moved"),
    [
        ("M", 0, 0, {0}),
        ("M", 2, 2, {2}),
        ("M", 3, 3, {3}),  # half of it: the mean of both wheels
        ("M", 6, 6, {4}),
        ("M", 0, 1, set()),  # of M the diagonal only
        ("K", 1, 1, set()),  # holds squares of the lengths
        ("K", 2, 2, set()),
        ("K", 1, 2, set()),
        ("K", 1, 3, {11}),  # pitch and a front wheel: a, and by K[1, 0] b
        ("C", 1, 1, set()),
        ("C", 1, 0, set()),  # damping is taken from what holds no length
    ],
)
def test_each_parameter_is_read_from_the_elements_of_the_paper(
    name: str, row: int, column: int, moved: set[int]
) -> None:
    factor = identified(name, row, column, 1.1)
    away = {i for i, value in enumerate(factor) if abs(value - 1.0) > 1e-9}
    assert moved <= away
    assert away <= moved | ({11, 12} if moved == {11} else set())
