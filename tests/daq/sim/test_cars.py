"""Named cars: as published, plausible, standing under the shipped weights, and distinguishable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.config import load_bench
from daq.errors import InputError
from daq.sim.cars import GRANADA, car_names, named_car
from daq.sim.dampers import damper_law
from daq.sim.imperfections import NONE
from daq.sim.load import load_car
from daq.sim.motion import standing
from daq.sim.reported import present_parameters, true_parameters
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES


def test_the_default_car_is_the_linear_one() -> None:
    car = named_car(GRANADA)
    assert car.parameters == FORD_GRANADA
    assert car.imperfections == NONE
    assert tuple(present_parameters(car.simulated())) == PARAMETER_NAMES
    assert car.simulated(tail_s=3.5).tail_s == 3.5


@pytest.mark.parametrize("name", [name for name in car_names() if name != GRANADA])
def test_each_car_has_friction_and_stands_under_the_shipped_weights(name: str) -> None:
    car = named_car(name)
    p, i = car.parameters, car.imperfections
    assert car.source
    assert min(i.friction.front_n, i.friction.rear_n) >= 30.0
    for state in load_bench(None).mass_states:
        standing(load_car(p, state.added, i))
    # Within the 5 to 95 % of 204 measured vehicles, and a little beyond.
    assert 0.32 < np.sqrt(p.I_xx / p.m_s) / (p.t_f + p.t_r) < 0.46
    assert 0.8 < p.I_yy / (p.m_s * p.a * p.b) < 1.2
    assert present_parameters(car.simulated())["F_cf"] == i.friction.front_n


def test_published_figures_are_kept() -> None:
    escort = named_car("escort").parameters
    assert (escort.m_s, escort.k_sf, escort.k_tf) == (1094.5427, 21898.33, 189785.5)
    # Their damping is the secant of the curve that they are given.
    assert escort.c_sf == pytest.approx(1459.39)
    jeep = named_car("cherokee").imperfections
    assert jeep.damper_front is not None
    forces = damper_law([jeep.damper_front], [1.0]).force(np.array([[-0.0525, 0.105]]))
    np.testing.assert_allclose(forces, [[-440.2, 331.8]])
    assert (jeep.bar_front_n_m, jeep.bar_rear_n_m) == (-7984.0, -5494.0)


def test_a_worn_damper_is_half_of_a_sound_one() -> None:
    sound, worn = named_car("escort"), named_car("escort-worn")
    assert worn.parameters == sound.parameters
    assert worn.imperfections == replace(sound.imperfections, damper=(1.0, 0.5, 1.0, 1.0))
    assert worn.title != sound.title
    truth = true_parameters(worn.simulated())
    assert truth["c_sf"] == pytest.approx(0.75 * sound.parameters.c_sf)
    assert truth["c_sr"] == pytest.approx(sound.parameters.c_sr)


def test_an_unknown_car_is_answered_with_the_nearest() -> None:
    with pytest.raises(InputError, match=r"--car escrt: is unknown \(did you mean escort"):
        named_car("escrt")
    with pytest.raises(InputError, match=r"is unknown .use granada, granada-rough, "):
        named_car("xyz")
