"""CPU time of paths and tangents of a car with every element."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from identify.nonlinear import integrator
from identify.nonlinear.car import car
from identify.nonlinear.integrator import acting, plan_of, start_of
from identify.nonlinear.path import PATH, USUAL, InitialState

from ..identify.nonlinear.cars import model_of, moving, rich
from ..identify.nonlinear.truth import BASELINE

RUNS = 6
END_S = 2.0


def main() -> None:
    """Print the CPU time of one evaluation of six runs of 2 s with every element free."""
    model = model_of(knots="K7")
    free = np.array([i for i, n in enumerate(model.names) if not n.startswith("s_m")])
    one, own = car(model, rich(model, False), BASELINE, free), moving()
    cars, initials, ends = [one] * RUNS, [own] * RUNS, [END_S] * RUNS
    acts = acting([one])
    _warm(one, own, acts)
    began = time.process_time()
    paths = integrator.integrate(cars, initials, ends, USUAL.step_s, PATH)
    path_s = time.process_time() - began
    began = time.process_time()
    for path in paths:
        assert path is not None
        start, plan = start_of(one, own, acts, PATH), plan_of(one, path, USUAL)
        integrator.tangents(one, acts, path, start, plan)
    tangent_s = time.process_time() - began
    print(f"paths {path_s:.2f} s, tangents {tangent_s:.2f} s ({len(acts)} unknowns)")


def _warm(one: Any, own: InitialState, acts: Any) -> None:
    """Compile, or load what was compiled."""
    (path,) = integrator.integrate([one], [own], [0.05], USUAL.step_s, PATH)
    assert path is not None
    start, plan = start_of(one, own, acts, PATH), plan_of(one, path, USUAL)
    integrator.tangents(one, acts, path, start, plan)


if __name__ == "__main__":
    main()
