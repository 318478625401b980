"""Fits the nonlinear model: its elements are released in stages, then all unknowns are polished."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..fit.varpro import pseudo_inverse
from ..model.matrices import Real
from .begin import at_likely_scale, initial_states_of, refined, weak_priors
from .car import KNOTS, Model
from .fit import Clock, Optimum, fit, gain_of
from .path import POLISH, ROUGH, InitialState
from .problem import Problem, Run

# Groups of unknowns that are released, tested and named together: the elements of a structure -----


@dataclass(frozen=True, slots=True)
class Group:
    """One choice in `[vehicle.structure]`."""

    name: str
    """As in `[vehicle.structure]`."""
    stage: int | None
    """In which it is released; None if it joins when its gain is large enough."""
    kinds: tuple[str, ...] = ()
    """Unknowns, without the axle at their end; those of knees depend on the number of these."""
    positive: bool = False
    """True if a size below zero means that the element is absent."""

    def members(self, model: Model) -> tuple[str, ...]:
        """Return the names of its unknowns."""
        if self.name == "cg_offset":
            return self.kinds
        if self.kinds:
            return tuple(f"{kind}{axle}" for kind in self.kinds for axle in "fr")
        bends_at_rest = self.name == "one_sided_dampers"
        return tuple(
            f"h_{axle}{j}"
            for axle in "fr"
            for j, knot in enumerate(model.knots, start=1)
            if (knot == 0.0) is bends_at_rest
        )

    def subsets(self, sizes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
        """Return the sets of unknowns, each of which may show that the element is present.

        `sizes`: its unknowns that are zero where it is absent.  The sets are all of them and,
        because a car may have the element on one axle only, those of the front and of the rear; the
        knees of both axles stay together.
        """
        if not self.kinds or self.name == "cg_offset":
            return (tuple(sizes),)
        of_axles = (tuple(name for name in sizes if name.endswith(axle)) for axle in "fr")
        return (tuple(sizes), *(of_axle for of_axle in of_axles if of_axle))


GROUPS = (
    Group("anti_roll_bars", 0, ("k_a",)),
    Group("cg_offset", 0, ("y_s",)),
    Group("progressive_springs", 0, ("k_2", "k_3")),
    Group("friction", 0, ("F_c", "d_c"), positive=True),
    Group("static_friction", None, ("r_c", "v_c"), positive=True),
    Group("one_sided_dampers", 0),
    Group("damper_knees", 0),
    Group("damper_mounts", None, ("s_m",), positive=True),
    Group("tyre_damping", 1, ("c_t",), positive=True),
    Group("progressive_tyres", 1, ("b_t",), positive=True),
    Group("friction_left_right", 1, ("dF_c",)),
    Group("dampers_left_right", 1, ("s_c",)),
    Group("corners_left_right", 1, ("dk_s", "dk_t", "dm_u")),
    Group("bump_stops", 2, ("k_b", "g_b", "p_b"), positive=True),
)
BY_NAME = {group.name: group for group in GROUPS}
STAGES = tuple(tuple(group.name for group in GROUPS if group.stage == i) for i in range(3))
"""Order of release: large effects first, then effects that imitate them.  If all were released
together from a far start, each would fit the effects of others.  Stated uncertainties (lateness,
weights, places) are released after the first stage: earlier they would absorb the elements."""


def positions(model: Model, groups: tuple[str, ...], corrections: bool) -> NDArray[np.intp]:
    """Return which unknowns are free, (F,): those of the car and of the named groups.

    `corrections`: whether those of stated uncertainties are free, too.
    """
    fixed = {name for group in GROUPS for name in group.members(model)}
    fixed -= {name for group in groups for name in BY_NAME[group].members(model)}
    fixed |= set() if corrections else set(model.box.corrections)
    return np.array([i for i, name in enumerate(model.names) if name not in fixed], dtype=np.intp)


# The release --------------------------------------------------------------------------------------

_ROUGH = 2e-3
"""Part of the cost that a stage may leave to the next one."""
_JOINING_SIZES = {"damper_mounts": 0.3, "static_friction": 0.2}
"""Groups that join where their gain is large enough, with the start of their sizes: a compliance of
0.3e-6 m/N, beyond the local minimum at zero; static friction a fifth above the sliding one."""
_LAST_KNOTS, _POLISHED_KNOTS = KNOTS["K21"], KNOTS["K37"]
"""Knees of the last stage and of the polish: what 21 knees leave moves tyres and wheels by up to
0.7 standard deviations where scales narrow the intervals, and without the four beyond 0.3 m/s I_xx
of a car with solid axles was up to 3 off."""
_STAGE_STEPS, _LAST_STEPS, _POLISH_STEPS = 25, 40, 25
"""Largest numbers of steps of an early stage, of the last one and of the polish."""
_FAR_CHI2 = 10.0
"""chi2/n of a first stage from which later stages do not come down to the noise (8.2 became 0.99,
17.6 did not)."""
_SEARCH_PART = 0.7
"""Part of the time after which the search ends; the polish has the rest."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """Start of a search."""

    runs: tuple[Run, ...]
    """The decays."""
    searched: tuple[Run, ...]
    """The decays, shorter and with fewer samples, to find the neighbourhood of the optimum."""
    eta: Real
    """Unknowns, (P,), with elements that are absent."""
    sigma: Mapping[str, float]
    """Standard deviation of each channel's noise."""
    skipped_s: float
    """Time after the beginning of the decays from which they are fitted, s."""

    def initials(self, model: Model, eta: Real) -> tuple[InitialState, ...]:
        """Return the initial state of each run by the linear model at `eta`, (P,)."""
        return initial_states_of(model, eta, tuple(run.decay for run in self.runs), self.sigma)


def release(
    model: Model,
    attempts: Iterable[Attempt],
    allowed: Callable[[str], bool],
    log: Callable[[str], None],
    clock: Clock,
) -> tuple[Optimum, tuple[str, ...]] | None:
    """Return the optimum of the nonlinear model and the groups in it; None without a finite path.

    The first stage is fitted for one attempt after the other until one ends low enough; the later
    stages follow from the best end, and up to twice more from the next best where they leave more
    than noise.  The best of all is polished.

    `attempts`: a further one is taken only where the earlier ones fail.  `allowed`: whether a group
    may be released.  `log`: receives a line for each stage.  `clock`: limits the time; what it did
    not suffice for is in it afterwards.
    """
    search = _Search(allowed, log, clock)
    first_groups = tuple(name for name in STAGES[0] if allowed(name))
    next_attempts = iter(attempts)
    whole_attempt: Attempt | None = None
    # Ends of the first stage that are not followed yet, and of all stages; each begins with chi2/n,
    # and has the groups in it.
    first_ends: list[tuple[float, Optimum, Attempt, tuple[str, ...]]] = []
    last_ends: list[tuple[float, Optimum, Attempt, tuple[str, ...]]] = []
    is_over = clock.limit(_SEARCH_PART, "other starts of the search")
    while len(last_ends) < 3:  # attempts that are followed through the later stages
        while all(_chi2(first_end) >= _FAR_CHI2 for _, first_end, _, _ in first_ends):
            attempt = None if first_ends and is_over() else next(next_attempts, None)
            if attempt is None:
                break
            whole_attempt = whole_attempt or attempt  # the first one leaves nothing out
            first = search.first_stage(model, attempt, first_groups)
            if first is not None:
                first_end, groups = first
                # A first stage that leaves out the beginnings ends three times lower from any
                # start, because stops and lift-off are not in it.
                likely_chi2 = _chi2(first_end) * (3.0 if attempt.skipped_s > 0.0 else 1.0)
                first_ends.append((likely_chi2, first_end, attempt, groups))
                first_ends.sort(key=lambda entry: entry[0])
        if not (first_ends and whole_attempt):
            break
        _, first_end, attempt, groups = first_ends.pop(0)
        best, groups = search.later_stages(first_end, groups)
        if attempt.skipped_s > 0.0:
            best, attempt = search.with_beginnings(best, attempt, whole_attempt)
            best, groups = search.with_joining_groups(best, groups)
        chi2 = _chi2(best)
        last_ends.append((chi2, best, attempt, groups))
        # Beyond the noise, the next attempt is followed as well: a first stage that ends lower is
        # not always nearer.  Far beyond it a sensor is wrong and not the start, unless this attempt
        # has gone astray from its own first stage.
        if not (1.2 < chi2 < 10.0 or chi2 > _chi2(first_end)) or is_over():
            break
    if not last_ends:
        return None
    _, best, attempt, groups = min(last_ends, key=lambda entry: entry[0])
    polished = search.polish(best, replace(best.point.problem, runs=attempt.runs), groups)
    if polished is not None and "damper_mounts" in groups and not polished.converged:
        problem = polished.point.problem
        # Rigid ones, at their bound, promise more than the paths give, and block all others.
        if not (polished.eta[_size_positions(problem.model, "damper_mounts")] > 0.0).any():
            other_groups = tuple(name for name in groups if name != "damper_mounts")
            without_mounts = search.polish(polished, problem, other_groups)
            if without_mounts is not None:
                return without_mounts, other_groups
    return None if polished is None else (polished, groups)


def _chi2(end: Optimum) -> float:
    """Return the cost of a search over its samples less the runs' own unknowns."""
    # 18 of a run: seven displacements, seven speeds, the friction at four corners.
    return end.cost / sum(run.freedom - 18.0 for run in end.point.problem.runs)


@dataclass(frozen=True, slots=True)
class _Search:
    """The stages of a search; its fields are arguments of `release`."""

    allowed: Callable[[str], bool]
    log: Callable[[str], None]
    clock: Clock

    def first_stage(
        self, model: Model, attempt: Attempt, groups: tuple[str, ...]
    ) -> tuple[Optimum, tuple[str, ...]] | None:
        """Return the end of the first stage from a linear start, and the groups in it.

        Where it is far from the noise, stops are touched: they join before the elements that would
        imitate them.  None without a finite path.
        """
        eta = attempt.eta.copy()
        centre, prior = weak_priors(model, eta)
        if "friction" in groups:
            eta[_size_positions(model, "friction")] = 15.0 / 50.0  # N, of 50 N a unit
        problem = Problem(model, attempt.searched, centre, prior, positions(model, groups, False))
        initials = attempt.initials(model, attempt.eta)
        end = self._stage(groups, problem, eta, initials, _STAGE_STEPS, _ROUGH)
        if end is None:
            return None
        is_far = _chi2(end) >= _FAR_CHI2 and self.allowed("bump_stops")
        stops = begin_stops(end) if is_far else None
        if stops is not None:
            with_stops = (*groups, "bump_stops")
            released = replace(problem, free=positions(model, with_stops, False))
            names, initials = ("bump_stops",), end.point.initials
            later = self._stage(names, released, stops, initials, _STAGE_STEPS, _ROUGH)
            if later is not None and later.cost < end.cost:
                return later, with_stops
        return end, groups

    def later_stages(
        self, best: Optimum, groups: tuple[str, ...]
    ) -> tuple[Optimum, tuple[str, ...]]:
        """Return the optimum with the later stages released, and the groups in it.

        Each stage begins with stops or mounts at a place and size of their own, if they promise to
        lower the cost, or else, where this leads nowhere, without them.
        """
        for stage in STAGES[1:]:
            is_last = stage == STAGES[-1]
            new = tuple(name for name in stage if self.allowed(name) and name not in groups)
            with_stage = groups + new
            starts = [(with_stage, best.eta)]
            stops = begin_stops(best) if "bump_stops" in new else None
            if stops is not None:
                starts.insert(0, (with_stage, stops))
            problem = best.point.problem
            if is_last and self._promises("damper_mounts", best):
                with_mounts = _joined(problem.model, starts[0][1], "damper_mounts")
                starts.insert(0, ((*with_stage, "damper_mounts"), with_mounts))
            steps, rough = (_LAST_STEPS, 0.1 * _ROUGH) if is_last else (_STAGE_STEPS, _ROUGH)
            for start_groups, eta in starts:
                released = problem
                if is_last and "damper_knees" in with_stage:
                    released, eta = refined(problem, eta, _LAST_KNOTS)
                released = replace(released, free=positions(released.model, start_groups, True))
                eta = at_likely_scale(released, eta)
                names = start_groups[len(groups) :] or stage
                end = self._stage(names, released, eta, best.point.initials, steps, rough)
                # Else this start has gone astray.  Without any gain the cost is equal to rounding:
                # the groups stay in, because a parameter that is left out is not determined.
                if end is not None and end.cost <= (1.0 + 1e-9) * best.cost:
                    best, groups = end, start_groups
                    break
        return self.with_joining_groups(best, groups)

    def with_joining_groups(
        self, best: Optimum, groups: tuple[str, ...]
    ) -> tuple[Optimum, tuple[str, ...]]:
        """Return the optimum after groups of large gain have joined, and the groups in it."""
        for name in _JOINING_SIZES:
            if name in groups or not self._promises(name, best):
                continue
            problem, with_group = best.point.problem, (*groups, name)
            released = replace(problem, free=positions(problem.model, with_group, True))
            eta = _joined(problem.model, best.eta, name)
            end = self._stage((name,), released, eta, best.point.initials, _LAST_STEPS)
            if end is not None and end.cost < best.cost:
                best, groups = end, with_group
        return best, groups

    def _stage(
        self,
        names: tuple[str, ...],
        problem: Problem,
        eta: Real,
        initials: tuple[InitialState, ...],
        steps: int,
        rough: float = 0.0,
    ) -> Optimum | None:
        """Return the end of the fit that releases some groups; None without a finite path."""
        names_of_groups = ", ".join(names)
        end = fit(
            problem, eta, initials, ROUGH, rough=rough, max_iterations=steps,
            is_over=self.clock.limit(_SEARCH_PART, names_of_groups.replace("_", " ")),
        )  # fmt: skip
        if end is not None:
            self.log(f"{names_of_groups}: chi2/n {_chi2(end):.3f} after {end.iterations} steps")
        return end

    def with_beginnings(
        self, best: Optimum, attempt: Attempt, whole: Attempt
    ) -> tuple[Optimum, Attempt]:
        """Return the optimum with the beginnings that an attempt left out, and that attempt.

        The vehicle is held while each run's first motion is sought.  Runs whose beginning this
        vehicle does not explain stay as they were, and all do where the model then explains the
        whole a tenth worse.  `whole`: an attempt that leaves nothing out.
        """
        problem = best.point.problem
        first_states = whole.initials(problem.model, best.eta)
        runs, searched = list(attempt.runs), list(attempt.searched)
        initials = list(best.point.initials)
        is_over = self.clock.limit(_SEARCH_PART, "beginnings of the decays")
        for i, run in enumerate(whole.searched):
            motion = _first_motion(best, run, first_states[i], is_over)
            # A vehicle that was found without a beginning explains it up to chi2/n 5.
            if motion is not None and motion.point.predicted[0].cost < 5.0 * run.freedom:
                runs[i], searched[i], initials[i] = whole.runs[i], run, motion.point.initials[0]
        end = fit(
            replace(problem, runs=tuple(searched)), best.eta, tuple(initials), ROUGH,
            rough=0.1 * _ROUGH, max_iterations=_LAST_STEPS, is_over=is_over,
        )  # fmt: skip
        if end is None or _chi2(end) > 1.1 * _chi2(best):
            return best, attempt
        self.log(f"beginnings: chi2/n {_chi2(end):.3f} after {end.iterations} steps")
        return end, replace(attempt, runs=tuple(runs), searched=tuple(searched))

    def polish(self, best: Optimum, whole: Problem, groups: tuple[str, ...]) -> Optimum | None:
        """Return the optimum for whole runs, with curves on more knees; None without a path."""
        eta = best.eta
        if "damper_knees" in groups and whole.model.knots != _POLISHED_KNOTS:
            whole, eta = refined(whole, eta, _POLISHED_KNOTS)
        whole = replace(whole, free=positions(whole.model, groups, True))
        end = fit(
            whole, at_likely_scale(whole, eta), best.point.initials, POLISH, tolerance=0.3,
            max_iterations=_POLISH_STEPS, is_over=self.clock.limit(1.0, "the last steps"),
        )  # fmt: skip
        if end is not None:
            self.log(f"polished in {end.iterations} steps, decrement {end.decrement:.2g}")
        return end

    def _promises(self, name: str, best: Optimum) -> bool:
        """Return whether a group would lower the cost by much more than chance."""
        problem = best.point.problem
        has_friction = problem.model.names.index("F_cf") in problem.free
        if not self.allowed(name) or (name == "static_friction" and not has_friction):
            return False
        n = sum(run.freedom for run in problem.runs)
        gains, sizes = gain_of(best, best.eta, _size_positions(problem.model, name))
        gain = float(gains[sizes > 0.0].sum()) / max(1.0, best.cost / n)
        # Mounts join at twice the criterion's limit, static friction far below that for which it
        # is named: without it the sliding friction reads up to 20 % high and wheels 1 % light.
        return gain > (4.0 * float(np.log(n)) if name == "damper_mounts" else 4.0)


def _size_positions(model: Model, name: str) -> NDArray[np.intp]:
    """Return the positions of a group's first unknown, its size, front and rear."""
    kind = BY_NAME[name].kinds[0]
    return np.array([model.names.index(f"{kind}{axle}") for axle in "fr"])


def _joined(model: Model, eta: Real, name: str) -> Real:
    """Return the unknowns with a group at its start values."""
    result = eta.copy()
    result[_size_positions(model, name)] = _JOINING_SIZES[name]
    return result


def _first_motion(
    best: Optimum, run: Run, initial: InitialState, is_over: Callable[[], bool]
) -> Optimum | None:
    """Return the optimum of a run's first motion, the vehicle that of `best`; None without path."""
    problem = replace(best.point.problem, free=np.zeros(0, dtype=np.intp), runs=(run,))
    initials = (initial,)
    return fit(problem, best.eta, initials, ROUGH, max_iterations=_STAGE_STEPS, is_over=is_over)


def moved_by_beginnings(
    best: Optimum, runs: tuple[Run, ...], first_states: tuple[InitialState, ...], clock: Clock
) -> Real:
    """Return by how much the free unknowns move, (F,), if the beginnings left out are fitted, too.

    Residuals without them may be as white as the noise although the laws of the elements fail in
    large motions: two parts of the data that disagree show it (Hausman 1978).  Zeros where they
    disagree no more than by chance, and where the fit of all does not hold either: a bump that
    lasts longer than stated says nothing about the vehicle.
    """
    problem = replace(best.point.problem, runs=runs)
    is_over = clock.limit(1.0, "beginnings left out")
    initials = []
    for run, x0 in zip(runs, first_states, strict=True):
        motion = _first_motion(best, run, x0, is_over)
        initials.append(motion.point.initials[0] if motion else x0)
    end = fit(
        problem, best.eta, tuple(initials), ROUGH,
        rough=0.1 * _ROUGH, max_iterations=_LAST_STEPS, is_over=is_over,
    )  # fmt: skip
    if end is None or _chi2(end) > 1.5:  # above it, a fit is refused
        return np.zeros(len(problem.free))
    moved, variance = (end.eta - best.eta)[problem.free], np.diag(pseudo_inverse(best.information))
    # Noise alone moved the unknown that moved most by 1.4 standard deviations in a test.
    return np.asarray(moved * bool((moved**2 > 3.0**2 * variance).any()))


# Finds the gap at which the bump stop of each axle begins in a fit --------------------------------

_RELATIVE_GAPS = (0.97, 0.93, 0.86, 0.77, 0.66, 0.54, 0.42, 0.3)
"""Gaps at which a bump stop is tried, over the axle's largest compression: the cost of a stop that
is not touched has no slope by its gap, and a fit does not reach a gap of 40 mm from 33 mm while a
progressive spring imitates the stop."""


def begin_stops(best: Optimum) -> Real | None:
    """Return the unknowns, (P,), with each axle's bump stop where it would lower the cost most.

    None where no stop would lower it by more than chance.
    """
    problem = best.point.problem
    # Positions of the unknowns, front and rear: stiffness of the stop, its gap, and what imitates
    # the stop while it is missing.
    rates, gaps, *imitations = (
        np.array([problem.model.names.index(f"{kind}{axle}") for axle in "fr"])
        for kind in ("k_b", "g_b", "k_2", "k_3")
    )
    largest_of_runs = [
        car.travels(run.path.states).max(axis=0)
        for car, run in zip(best.point.cars, best.point.predicted, strict=True)
    ]
    # At least 10 mm: a gap has no logarithm at zero.
    largest_m = np.maximum(np.max(largest_of_runs, axis=0).reshape(2, 2).max(axis=1), 0.01)
    result = best.eta.copy()
    n = sum(run.freedom for run in problem.runs)
    best_gains = np.full(2, 2.0 * np.log(n) * max(1.0, best.cost / n))
    for relative_gap in _RELATIVE_GAPS:
        trial = best.eta.copy()
        trial[gaps] = np.log(relative_gap * largest_m)
        gains, sizes = gain_of(best, trial, rates)
        better = (sizes > 0.0) & (gains > best_gains)  # (2,)
        best_gains[better] = gains[better]
        result[gaps[better]] = trial[gaps[better]]
        result[rates[better]] = np.minimum(sizes[better], 1.5)  # 1.5e5 N/m at most
        # From a spring stiffened as much as the missing stop required, the search did not return
        # in 40 steps; from zero it needs 4 to 8.
        for positions_of_kind in imitations:
            result[positions_of_kind[better]] = 0.0
    return result if result[rates].any() else None
