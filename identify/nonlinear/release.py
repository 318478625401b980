"""The fit of the rich model: its elements are released in stages, then all is polished."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .car import Model
from .fit import Optimum, fit, inverse, reduced
from .groups import BY_NAME, CORRECTIONS_FROM, STAGES, positions
from .path import Own
from .priors import weak_priors
from .problem import Problem, normal, point
from .refine import refined
from .run import Run
from .unknowns import KNOTS

_ROUGH = 2e-3
"""Share of the cost that a stage may leave to the next one."""
_FIRST_FRICTION_N = 15.0
_FIRST_COMPLIANCE = 0.3e-6
"""Compliance, m/N, from which the mounts begin: beyond the trap at zero."""
_LAST_KNOTS = "K7"
"""Knees of the last stage: real curves bend between those of the first stages."""
_PAYS = 4.0
"""Logarithms of the number of samples that the mounts must gain: two of the criterion's limit."""
_STAGE_STEPS = 25
_LAST_STEPS = 40
_POLISH_STEPS = 10
_CONVERGED = 0.05
_POLISHED = 0.1

Log = Callable[[str], None]


def release(
    model: Model,
    runs: tuple[Run, ...],
    eta: NDArray[np.float64],
    owns: tuple[Own, ...],
    allowed: Callable[[str], bool],
    log: Log,
) -> tuple[Optimum, tuple[str, ...]] | None:
    """Return the optimum of the rich model and the groups in it; None without a finite path.

    `eta`, (P,) float64: linear start, elements at rest.  `owns`: how each run begins by it.
    `allowed`: whether a group may be released.  `log`: receives a line for each stage.
    """
    centre, prior = weak_priors(model, eta)
    problem = Problem(model, runs, centre, prior, np.zeros(0, dtype=np.intp))
    n = sum(run.freedom - 18.0 for run in runs)
    start = eta.copy()
    chosen: tuple[str, ...] = ()
    best: Optimum | None = None
    if allowed("friction"):
        for name in BY_NAME["friction"].members(model)[:2]:
            start[model.names.index(name)] = _FIRST_FRICTION_N / 50.0
    for k, stage in enumerate(STAGES):
        chosen += tuple(name for name in stage if allowed(name))
        if k == CORRECTIONS_FROM and best is not None and _mounts_pay(problem, best, allowed, log):
            chosen += ("damper_mounts",)
            _begin_mounts(model, start)
        last = k == len(STAGES) - 1
        if last and "damper_knees" in chosen:
            problem, start = refined(problem, start, KNOTS[_LAST_KNOTS])
            model = problem.model
        free = positions(model, chosen, k >= CORRECTIONS_FROM)
        found = fit(
            problem.releasing(free), start, owns, tolerance=_CONVERGED,
            rough=0.0 if last else _ROUGH, max_iterations=_LAST_STEPS if last else _STAGE_STEPS,
        )  # fmt: skip
        if found is None:
            chosen = chosen[: -len(stage)]
            continue
        best, start, owns = found, found.eta, found.point.owns
        log(f"{', '.join(stage)}: chi2/n {best.cost / n:.3f} after {best.iterations} steps")
    if best is None:
        return None
    if "damper_mounts" not in chosen and _mounts_pay(problem, best, allowed, log):
        chosen += ("damper_mounts",)
        _begin_mounts(model, start)
        free = positions(model, chosen, True)
        found = fit(
            problem.releasing(free), start, owns, tolerance=_CONVERGED, max_iterations=_LAST_STEPS
        )
        best = found if found is not None and found.cost < best.cost else best
    polished = fit(
        best.point.problem, best.eta, best.point.owns, polish=True, tolerance=_POLISHED,
        max_iterations=_POLISH_STEPS,
    )  # fmt: skip
    return (polished or best), chosen


def _mounts_pay(problem: Problem, best: Optimum, allowed: Callable[[str], bool], log: Log) -> bool:
    """Return whether compliant mounts would lower the cost by much more than chance."""
    if not allowed("damper_mounts"):
        return False
    n = sum(run.freedom for run in problem.runs)
    gain = score(problem, best, _mount_positions(problem.model)) / max(1.0, best.cost / n)
    log(f"damper_mounts: would lower the cost by {gain:.0f}")
    return bool(gain > _PAYS * np.log(n))


def _mount_positions(model: Model) -> NDArray[np.intp]:
    names = BY_NAME["damper_mounts"].members(model)
    return np.array([model.names.index(name) for name in names], dtype=np.intp)


def _begin_mounts(model: Model, eta: NDArray[np.float64]) -> None:
    eta[_mount_positions(model)] = _FIRST_COMPLIANCE / 1e-6


def score(problem: Problem, best: Optimum, extra: NDArray[np.intp]) -> float:
    """Return by how much the cost would fall, to first order, with further unknowns free."""
    known = best.point.problem.free
    free = np.union1d(known, extra)
    at = point(problem.releasing(free), best.eta, best.point.owns, best.point.polish)
    if at is None:
        return 0.0
    matrix, right, _ = reduced(normal(at), 0.0)
    new = np.isin(free, np.setdiff1d(free, known))
    old = ~new
    cross = matrix[np.ix_(new, old)] @ inverse(matrix[np.ix_(old, old)])
    left = matrix[np.ix_(new, new)] - cross @ matrix[np.ix_(old, new)]
    push = right[new] - cross @ right[old]
    return float(push @ inverse(left, 1e-9) @ push)
