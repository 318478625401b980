"""Fits the rich model to a real car, where the linear one does not explain the decays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from daq.vehicle import Structure

from ..decays.decay import FreeDecay, Record, decay_start_s
from ..fit.estimation import Estimation, basin, floored, rough_noise
from ..fit.grey_box import GreyBox
from ..fit.likelihood import Fit
from .begin import is_impossible, scaled_to_vehicle
from .car import KNOTS, Model
from .engine import NonlinearEngine, residuals_of
from .fit import Clock, Optimum, inverse
from .forces import ElementChoice, Forces, axle_forces, element_estimates
from .problem import run_of
from .release import GROUPS, Attempt, release
from .score import scatter, widened

_CLEAN_SIGMAS = 2.0
"""Excess of chi2/n, in standard deviations, above which intervals follow the scores' scatter."""

_SEARCH_S = 1.2
"""Length of the decays, s, in the search for the optimum: the rest adds a few per cent."""
_SEARCH_RATE_HZ = 250.0
_START_RATE_HZ = 125.0
"""Rates of the samples, Hz, of the search and of the linear fit from which it starts."""

_ATTEMPTS = ((0.0, 0.0, 0), (0.0, 0.15, 1), (0.15, 0.15, 0), (0.25, 0.25, 0))
"""Attempts: time after the beginning of the decays, s, from which they are fitted; the same for the
linear start; index of the generic vehicle that replaces an impossible linear start.  In the first
tenths of a second wheels may leave the ground and stops be touched: one car of 400 kg started at
chi2/n 1700 with wheels twice too heavy, and 0.15 s later with all but its dampers within 25 %.
Wheels are known by little else than that time."""

_TIME_S = 45.0
"""Processor time of the search and the polish, s: with the linear fits before them, and the faults
that are tried first, an identification takes a minute at most."""

Log = Callable[[str], None]


@dataclass(frozen=True)
class RealCar:
    """The result of the nonlinear fit."""

    estimation: Estimation
    """As for the linear fit: parameters first, then corrections, then the free elements."""
    forces: Forces
    """Curves and elements."""


def real_car(
    linear: Estimation,
    vehicles: Sequence[NDArray[np.float64]],
    decided: Mapping[str, bool],
    log: Log,
) -> RealCar | None:
    """Fit the rich model to the decays of an estimation that does not hold.

    `vehicles`, sequence of (15,) float64: generic vehicles to start from.  `decided`: elements that
    `[vehicle.structure]` forces or forbids.  `log`: receives a line for each stage.  Returns None
    where the search finds no finite path.
    """
    records, rest = linear.records, linear.rest
    start_s = np.array([decay_start_s(record) for record in records])
    decays = tuple(r.decay(float(s)) for r, s in zip(records, start_s, strict=True))
    sigma = floored(rest or rough_noise(decays), decays)
    model, simple = _models(linear.box, decided)
    few = tuple(thinned(record) for record in records)
    near = [simple.unknowns(theta) for theta in vehicles]

    def attempts() -> Iterator[Attempt]:
        for late_s, linear_s, generic in _ATTEMPTS:
            near_by = basin(simple, few, rest, start_s + linear_s, near)
            sized = scaled_to_vehicle(simple, near_by, vehicles)
            start = near[generic] if is_impossible(simple, sized, vehicles) else sized
            full = simple.full(start.astype(complex)).real
            eta = model.unknowns(model.box.unknowns_of(full))
            own = tuple(r.decay(float(s)) for r, s in zip(records, start_s + late_s, strict=True))
            yield Attempt(
                runs=tuple(run_of(model, decay, sigma) for decay in own),
                searched=tuple(run_of(model, begun(decay), sigma) for decay in own),
                eta=eta,
                sigma=sigma,
                late_s=late_s,
            )

    clock = Clock(_TIME_S)
    with threadpool_limits(1, "blas"):  # the runs of a fit share the processors instead
        end = release(model, attempts(), lambda name: decided.get(name, True), log, clock)
    if end is None:
        return None
    best, chosen = end
    result = _result(linear, best, chosen, sigma, decided)
    unreached = tuple(clock.unreached)
    return replace(result, estimation=replace(result.estimation, unreached=unreached))


def thinned(record: Record) -> Record:
    """Return a record with only the samples that the linear start needs."""
    return replace(record, recordings=tuple(r.thinned(_START_RATE_HZ) for r in record.recordings))


def begun(decay: FreeDecay) -> FreeDecay:
    """Return the beginning of a decay, which holds nearly all information on a car."""
    first = tuple(r.between(0.0, _SEARCH_S) for r in decay.recordings)
    return replace(decay, recordings=first).thinned(_SEARCH_RATE_HZ)


def _models(box: GreyBox, decided: Mapping[str, bool]) -> tuple[Model, GreyBox]:
    """Return the rich model, and the linear one with bars from which it starts."""
    bars = decided.get("anti_roll_bars", True)
    rich = Structure(
        box.structure.symmetric,
        bars,
        decided.get("tyre_damping", True),
        decided.get("cg_offset", True),
    )
    simple = Structure(box.structure.symmetric, bars, False, False)
    model = Model(replace(box.with_structure(rich), lifts=True), KNOTS["K3"])
    return model, box.with_structure(simple)


def _result(
    linear: Estimation,
    best: Optimum,
    chosen: tuple[str, ...],
    sigma: dict[str, float],
    decided: Mapping[str, bool],
) -> RealCar:
    at, problem = best.point, best.point.problem
    model, free = problem.model, problem.free
    left = residuals_of(at)
    squares = sum(
        float(values @ values) / sigma[name] ** 2
        for one in left
        for name, values in one.values.items()
    )
    freedom = sum(sum(one.freedom.values()) for one in left) - len(free)
    chi2 = squares / freedom
    covariance = inverse(best.information)
    if chi2 - 1.0 > _CLEAN_SIGMAS * float(np.sqrt(2.0 / freedom)):
        covariance = widened(covariance, scatter(at))
    shown = np.union1d(np.arange(model.first), free)
    place = np.searchsorted(shown, free)
    full = np.zeros((len(shown), len(shown)))
    full[np.diag_indices(len(shown))] = np.inf
    full[np.ix_(place, place)] = covariance
    initials = {r.decay.label: own for r, own in zip(problem.runs, at.initials, strict=True)}
    engine = NonlinearEngine(problem, at.eta, initials, shown)
    parts = engine.parts(at)
    fit = Fit(
        at.eta[shown],
        full,
        best.cost,
        {label: part.information for label, part in parts.items()},
        best.iterations,
        best.converged,
    )
    estimation = Estimation(
        box=model.box,
        records=linear.records,
        fit=fit,
        decays=tuple(run.decay for run in problem.runs),
        sigma=sigma,
        rest=linear.rest,
        residuals=left,
        chi2_per_n=chi2,
        nonlinear=engine,
    )
    values = element_estimates(best, covariance)
    choices = _choices(best, covariance, chosen, chi2, freedom, decided)
    return RealCar(estimation, Forces(axle_forces(best, covariance, values), choices))


def _choices(
    best: Optimum,
    covariance: NDArray[np.float64],
    chosen: tuple[str, ...],
    chi2: float,
    freedom: float,
    decided: Mapping[str, bool],
) -> tuple[ElementChoice, ...]:
    """Return what each group explains: the rise of the cost without it, by its covariance.

    The part of a group (both axles, the front, the rear) that shows it best is reported.
    """
    problem = best.point.problem
    model = problem.model
    values = element_estimates(best, covariance)
    plain = inverse(best.information)
    result = []
    for group in GROUPS:
        members = [n for n in group.members(model) if n in values]
        if group.name not in chosen or not members:
            continue
        # A length, a speed or a gap does not count: it has a prior, and no value at which its
        # element is absent.
        sized = [n for n in members if not n.startswith(("d_c", "v_c", "g_b", "p_b"))]
        place = {n: int(np.flatnonzero(problem.free == model.names.index(n))[0]) for n in sized}
        shown = []
        for part in group.parts(sized):
            at = [place[n] for n in part]
            x = best.eta[problem.free[at]]
            real = bool((x > 0.0).all()) or not group.positive
            gain = float(x @ inverse(plain[np.ix_(at, at)]) @ x) / max(1.0, chi2) if real else 0.0
            shown.append((gain, len(part) * float(np.log(freedom))))
        gain, threshold = max(shown, key=lambda one: one[0] - one[1])
        result.append(
            ElementChoice(
                group.name,
                gain,
                threshold,
                decided.get(group.name, gain > threshold),
                group.name in decided,
                {n: values[n] for n in members},
            )
        )
    return tuple(result)
