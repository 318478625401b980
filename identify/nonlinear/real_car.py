"""Fits the nonlinear model to a real car, where the linear one does not explain the decays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from daq.vehicle import Structure

from ..decays.decay import FreeDecay, decay_start_s
from ..fit.estimation import Estimation, basin, floored, rough_noise
from ..fit.grey_box import SIGNED
from ..fit.likelihood import FACTS, PRIORS, Fit, Residuals
from ..fit.uncertainty import Estimate
from ..fit.varpro import NormalBlock, pseudo_inverse
from ..model.matrices import Real
from .begin import LENGTHS, initial_states_of, is_impossible, scaled_to_vehicle
from .car import KNOTS, Model, elements
from .fit import Clock, Optimum, scatter, widened
from .forces import AXLES, ElementChoice, Forces, axle_forces, element_estimates
from .path import POLISH, InitialState
from .problem import Point, Problem, point_at, run_of
from .release import GROUPS, Attempt, moved_by_beginnings, release

_SEARCH_RATE_HZ, _START_RATE_HZ = 250.0, 125.0
"""Rates of the samples, Hz, of the search and of the linear fit from which it starts."""
_ATTEMPTS = ((0.0, 0.0, 0), (0.0, 0.15, 1), (0.15, 0.15, 0), (0.25, 0.25, 0))
"""Attempts: time after the beginning of the decays, s, from which they are fitted; the same for the
linear start; index of the generic vehicle that replaces an impossible linear start.  In the first
tenths of a second wheels may leave the ground and stops be touched: one car of 400 kg started at
chi2/n 1700 with wheels twice too heavy, and 0.15 s later with all but its dampers within 25 %.
Wheels are known by little else than that time."""
_LAWS_ALIKE, _LAWS_EACH, _LAWS_LENGTHS = 0.013, 0.007, 0.003
"""Relative standard deviations by which the laws of the elements, which are not quite a car's, may
move what decays say: of all masses, inertias, springs and dampers alike, of each of them, and of
each length.  No residual shows it: a stop, a damper or a friction of another form leaves residuals
as white as the noise.  Of 15 such cars 95 % of the intervals hold with it, 73 % without."""


@dataclass(frozen=True)
class RealCar:
    """The result of the nonlinear fit."""

    estimation: Estimation
    """As for the linear fit: parameters first, then corrections, then the free elements."""
    forces: Forces
    """Curves and elements."""


def real_car(
    linear: Estimation,
    vehicles: Sequence[Real],
    decided: Mapping[str, bool],
    log: Callable[[str], None],
    most_s: float = 45.0,
) -> RealCar | None:
    """Return the fit of the nonlinear model to the decays of an estimation that does not hold.

    `vehicles`, sequence of (15,) float64: generic vehicles to start from.  `decided`: elements that
    `[vehicle.structure]` forces or forbids.  `log`: receives a line for each stage.  `most_s`:
    processor time of search and polish, s.  Returns None where the search finds no finite path.
    """
    records = linear.records
    start_s = np.array([decay_start_s(record) for record in records])
    decays = tuple(r.decay(float(s)) for r, s in zip(records, start_s, strict=True))
    sigma = floored(linear.rest or rough_noise(decays), decays)
    symmetric, bars = linear.box.structure.symmetric, decided.get("anti_roll_bars", True)
    tyre_damping, cg_offset = (decided.get(name, True) for name in ("tyre_damping", "cg_offset"))
    # Attempts start from a linear fit with bars, but without tyre damping and offset of the CG.
    start_box = linear.box.with_structure(Structure(symmetric, bars, False, False))
    box = linear.box.with_structure(Structure(symmetric, bars, tyre_damping, cg_offset))
    model = Model(replace(box, may_lift=True), KNOTS["K3"])
    few_samples = tuple(
        replace(record, recordings=tuple(r.thinned(_START_RATE_HZ) for r in record.recordings))
        for record in records
    )
    generic_etas = [start_box.unknowns(vehicle) for vehicle in vehicles]

    def attempts() -> Iterator[Attempt]:
        for skipped_s, linear_s, i_vehicle in _ATTEMPTS:
            near = basin(start_box, few_samples, linear.rest, start_s + linear_s, generic_etas)
            start_eta = scaled_to_vehicle(start_box, near, vehicles)
            if is_impossible(start_box, start_eta, vehicles):
                start_eta = generic_etas[i_vehicle]
            full = start_box.full(start_eta.astype(complex)).real
            starts_s = (start_s + skipped_s).tolist()
            whole = [r.decay(s) for r, s in zip(records, starts_s, strict=True)]
            yield Attempt(
                runs=tuple(run_of(model, decay, sigma) for decay in whole),
                searched=tuple(run_of(model, beginning_of(decay), sigma) for decay in whole),
                eta=model.unknowns(model.box.unknowns_of(full)),
                sigma=sigma,
                skipped_s=skipped_s,
            )

    clock = Clock(most_s)
    if not symmetric:  # corners with parameters of their own have these differences in them
        decided = {"dampers_left_right": False, "corners_left_right": False, **decided}
    with threadpool_limits(1, "blas"):  # the runs of a fit share the processors instead
        released = release(model, attempts(), lambda name: decided.get(name, True), log, clock)
    if released is None:
        return None
    best, groups = released
    fitted, moved = best.point.problem, np.zeros(len(best.point.problem.free))
    if any(run.decay.start_s > d.start_s for run, d in zip(fitted.runs, decays, strict=True)):
        beginnings = tuple(beginning_of(decay) for decay in decays)
        runs = tuple(run_of(fitted.model, decay, sigma) for decay in beginnings)
        initials = initial_states_of(fitted.model, best.eta, beginnings, sigma)
        moved = moved_by_beginnings(best, runs, initials, clock)
    result = _result(linear, best, groups, sigma, decided, moved)
    unreached = tuple(clock.unreached)
    return replace(result, estimation=replace(result.estimation, unreached=unreached))


def beginning_of(decay: FreeDecay) -> FreeDecay:
    """Return the beginning of a decay, which holds nearly all information on a car."""
    first = tuple(r.between(0.0, 1.2) for r in decay.recordings)
    return replace(decay, recordings=first).thinned(_SEARCH_RATE_HZ)


def _result(
    linear: Estimation,
    best: Optimum,
    groups: tuple[str, ...],
    sigma: dict[str, float],
    decided: Mapping[str, bool],
    moved: Real,
) -> RealCar:
    """Return estimation and forces at an optimum.

    `groups`: those of elements that are in it.  `moved`: by how much the free unknowns move with
    beginnings that were left out, (F,).
    """
    point, problem = best.point, best.point.problem
    model, free = problem.model, problem.free
    residuals = residuals_of(point)
    freedom = sum(sum(of_run.freedom.values()) for of_run in residuals) - len(free)
    chi2 = sum(of_run.chi2(sigma) for of_run in residuals) / freedom
    by_noise = covariance = pseudo_inverse(best.information)
    # Two standard deviations above 1 the intervals follow the scatter of the scores.
    if chi2 - 1.0 > 2.0 * float(np.sqrt(2.0 / freedom)):
        covariance = widened(covariance, scatter(point))
    # Scales and tape are not off with the laws: they keep what the decays say near the truth.
    _, facts = problem.fact_terms(point.eta)
    by_decays = by_noise @ (best.information - facts.T @ facts)
    laws = by_decays @ laws_covariance(model, free) @ by_decays.T + np.outer(moved, moved)
    covariance = covariance + laws
    reported = np.union1d(np.arange(model.n_linear), free)
    index_of_free = np.ix_(*[np.searchsorted(reported, free)] * 2)
    covariance_of_reported, laws_of_reported = np.zeros((2, len(reported), len(reported)))
    covariance_of_reported[np.diag_indices(len(reported))] = np.inf
    covariance_of_reported[index_of_free] = covariance
    laws_of_reported[index_of_free] = laws
    initials = {r.decay.label: x0 for r, x0 in zip(problem.runs, point.initials, strict=True)}
    engine = NonlinearEngine(problem, point.eta, initials, reported)
    estimation = Estimation(
        box=model.box,
        records=linear.records,
        fit=Fit(
            eta=point.eta[reported],
            covariance=covariance_of_reported,
            cost=best.cost,
            information={label: b.information for label, b in engine.blocks_at(point).items()},
            iterations=best.iterations,
            converged=best.converged,
        ),
        decays=tuple(run.decay for run in problem.runs),
        sigma=sigma,
        rest=linear.rest,
        residuals=residuals,
        chi2_per_n=chi2,
        nonlinear=engine,
        laws=laws_of_reported,
    )
    values = element_estimates(best, covariance)
    choices = _choices(best, by_noise, values, groups, chi2, freedom, decided)
    axles = tuple(axle_forces(best, covariance, values, axle) for axle in AXLES)
    return RealCar(estimation, Forces(axles, choices))


def laws_covariance(model: Model, free: NDArray[np.intp]) -> Real:
    """Return what the errors of the laws add to the covariance of the free unknowns, (F, F).

    It is zero for bars, tyre damping and offsets, whose unknown is no logarithm.
    """
    # Standard deviation of each unknown: in common with all others, and of its own.
    alike, each = np.zeros(len(model.names)), np.zeros(len(model.names))
    for i, name in enumerate(model.box.parameters):
        if name in LENGTHS:
            each[i] = _LAWS_LENGTHS * (name not in SIGNED)
        elif name not in SIGNED:
            alike[i], each[i] = _LAWS_ALIKE, _LAWS_EACH
    return np.outer(alike[free], alike[free]) + np.diag(each[free] ** 2)


def _choices(
    best: Optimum,
    covariance: Real,
    values: Mapping[str, Estimate],
    groups: tuple[str, ...],
    chi2: float,
    freedom: float,
    decided: Mapping[str, bool],
) -> tuple[ElementChoice, ...]:
    """Return what each group explains: the rise of the cost without it, by the noise's covariance.

    Of both axles, the front and the rear, those that show the group best are reported.
    """
    problem = best.point.problem
    model = problem.model
    result = []
    for group in GROUPS:
        members = [n for n in group.members(model) if n in values]
        if group.name not in groups or not members:
            continue
        # A length, a speed or a gap does not count: it has a prior, and no value at which its
        # element is absent.
        sizes = [n for n in members if not n.startswith(("d_c", "v_c", "g_b", "p_b"))]
        index_of = {n: int(np.flatnonzero(problem.free == model.names.index(n))[0]) for n in sizes}
        tests = []
        for subset in group.subsets(sizes):
            indices = [index_of[n] for n in subset]
            x = best.eta[problem.free[indices]]
            is_possible = bool((x > 0.0).all()) or not group.positive
            rise = float(x @ pseudo_inverse(covariance[np.ix_(indices, indices)]) @ x)
            gain = rise / max(1.0, chi2) if is_possible else 0.0
            tests.append((gain, len(subset) * float(np.log(freedom))))
        gain, threshold = max(tests, key=lambda test: test[0] - test[1])
        kept, is_decided = decided.get(group.name, gain > threshold), group.name in decided
        estimates = {n: values[n] for n in members}
        result.append(ElementChoice(group.name, gain, threshold, kept, is_decided, estimates))
    return tuple(result)


# Gives the nonlinear fit the interface of the linear one ------------------------------------------


@dataclass(frozen=True)
class NonlinearEngine:
    """The fitted problem, with normal blocks and residuals as those of the linear engine."""

    problem: Problem
    eta: Real
    """(P,) all unknowns at the optimum."""
    initials: Mapping[str, InitialState]
    """Initial state of each run, by its label."""
    reported: NDArray[np.intp]
    """Positions, among all, of the unknowns of a `Fit`."""

    @property
    def elements(self) -> Mapping[str, int]:
        """Position among the unknowns of a `Fit` of each element that may be zero, knees apart."""
        sized = {e.name for e in elements(()) if not e.logarithmic}
        names = self.problem.model.names
        reported = enumerate(names[i] for i in self.reported.tolist())
        return {name: position for position, name in reported if name in sized}

    def normal_blocks(
        self, decays: tuple[FreeDecay, ...], sigma: Mapping[str, float], eta: Real
    ) -> dict[str, NormalBlock]:
        """Return what each decay, the facts and the priors contribute at the reported unknowns."""
        return self.blocks_at(self._point(decays, sigma, eta))

    def residuals(
        self, decays: tuple[FreeDecay, ...], sigma: Mapping[str, float], eta: Real
    ) -> tuple[Residuals, ...]:
        """Return the residuals of each decay at the reported unknowns."""
        return residuals_of(self._point(decays, sigma, eta))

    def fact_misfits(self, eta: Real) -> tuple[Real, Real]:
        """Return measured less predicted value of each fact in sigmas, and the latter's slopes."""
        misfits, slopes = self.problem.model.fact_misfits(self._all_unknowns(eta))
        return misfits, slopes[:, self.reported]

    def _all_unknowns(self, eta: Real) -> Real:
        """Return all unknowns, (P,), with those reported at `eta`."""
        result = self.eta.copy()
        result[self.reported] = eta
        return result

    def blocks_at(self, point: Point) -> dict[str, NormalBlock]:
        """Return what each decay, the facts and the priors contribute at a point."""
        problem = point.problem
        index = np.searchsorted(self.reported, problem.free)
        size = len(self.reported)

        def of_reported(cost: float, matrix: Real, right: Real) -> NormalBlock:
            H, g = np.zeros((size, size)), np.zeros(size)
            H[np.ix_(index, index)], g[index] = matrix, right
            return NormalBlock(cost, H, g)

        result = {}
        for name, terms in ((FACTS, problem.fact_terms), (PRIORS, problem.prior_terms)):
            misfits, slopes = terms(point.eta)
            cost = float(misfits @ misfits)
            result[name] = of_reported(cost, slopes.T @ slopes, slopes.T @ misfits)
        blocks, of_runs = point.normal.blocks, point.predicted
        for run, b, predicted in zip(problem.runs, blocks, of_runs, strict=True):
            X = b.B.T @ pseudo_inverse(b.A)  # eliminates the run's own unknowns
            matrix, right = b.C - X @ b.B, b.right_free - X @ b.right_own
            result[run.decay.label] = of_reported(predicted.cost, matrix, right)
        return result

    def _point(self, decays: tuple[FreeDecay, ...], sigma: Mapping[str, float], eta: Real) -> Point:
        """Return the point of some decays at reported unknowns, with the best initial states."""
        all_eta = self._all_unknowns(eta)
        runs = tuple(run_of(self.problem.model, decay, sigma) for decay in decays)
        problem = replace(self.problem, runs=runs)
        initials = tuple(self.initials[decay.label] for decay in decays)
        point = point_at(problem, all_eta, initials, POLISH)
        if point is None:
            raise FloatingPointError("the path of a run is not finite at these unknowns")
        for _ in range(4):  # Gauss-Newton steps: the initial states of runs are nearly linear
            blocks = point.normal.blocks
            steps = [pseudo_inverse(b.A) @ b.right_own for b in blocks]
            gain = sum(float(s @ b.right_own) for s, b in zip(steps, blocks, strict=True))
            if gain < 0.01 * len(initials):  # a tenth of a standard deviation in each run
                break
            initials = tuple(x0.moved(step) for x0, step in zip(point.initials, steps, strict=True))
            trial = point_at(problem, all_eta, initials, POLISH)
            if trial is None or trial.cost > point.cost:
                break
            point = trial
        return point


def residuals_of(point: Point) -> tuple[Residuals, ...]:
    """Return the residuals of each decay, SI, and of each channel the degrees of freedom left.

    Those that the unknowns of the vehicle use are not subtracted.
    """
    result = []
    runs, blocks = point.problem.runs, point.normal.blocks
    for run, predicted, block in zip(runs, point.predicted, blocks, strict=True):
        n_own = len(block.A)
        inverse_A = pseudo_inverse(block.A)
        values: dict[str, Real] = {}
        freedom: dict[str, float] = {}
        of_recordings = (predicted.residuals, run.weights, run.bases, block.jacobian)
        for r, misfits, weight, basis, J in zip(run.decay.recordings, *of_recordings, strict=True):
            for c, channel in enumerate(r.group.channels):
                values[channel.name] = misfits[:, c] / weight[c]
                J_own = J[:, c, :n_own]
                n_used = float(np.sum((J_own @ inverse_A) * J_own))  # the share of this channel
                n_fitted = basis.shape[1]  # offset and transients of the low-pass
                freedom[channel.name] = len(misfits) - n_fitted - n_used
        result.append(Residuals(run.decay.label, values, freedom))
    return tuple(result)
