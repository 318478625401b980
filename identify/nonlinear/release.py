"""Fits the rich model: its elements are released in stages, then all unknowns are polished."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .begin import at_likely_scale, initial_states_of, refined, weak_priors
from .car import KNOTS, Model
from .fit import Clock, Optimum, fit, gain_of, inverse
from .path import POLISH, ROUGH, InitialState
from .problem import Problem, Run

# Groups of unknowns that are released, tested and named together: the elements of a structure -----


@dataclass(frozen=True, slots=True)
class Group:
    """One choice in `[vehicle.structure]`."""

    name: str
    """As in `[vehicle.structure]`."""
    kinds: tuple[str, ...]
    """Unknowns, without the axle at their end."""
    middle: bool | None = None
    """True for the damper's knee at rest, False for its other knees; None for all else."""
    positive: bool = False
    """True if a size below zero means that the element is absent."""

    def members(self, model: Model) -> tuple[str, ...]:
        """Return the names of its unknowns."""
        if self.name == "cg_offset":
            return self.kinds
        if self.middle is None:
            return tuple(f"{k}{axle}" for k in self.kinds for axle in "fr")
        return tuple(
            f"h_{axle}{j + 1}"
            for axle in "fr"
            for j, knot in enumerate(model.knots)
            if (knot == 0.0) is self.middle
        )

    def parts(self, sized: Sequence[str]) -> tuple[tuple[str, ...], ...]:
        """Return the sets of unknowns, each of which may show that the element is present.

        `sized`: its unknowns that are zero where it is absent.  Because a car may have it on one
        axle only, the sets are all unknowns, those of the front and those of the rear.  The knees
        of both axles are one set.
        """
        if self.middle is not None or self.name == "cg_offset":
            return (tuple(sized),)
        axles = (tuple(name for name in sized if name.endswith(axle)) for axle in "fr")
        return (tuple(sized), *(part for part in axles if part))


GROUPS = (
    Group("anti_roll_bars", ("k_a",)),
    Group("cg_offset", ("y_s",)),
    Group("progressive_springs", ("k_2", "k_3")),
    Group("friction", ("F_c", "d_c"), positive=True),
    Group("static_friction", ("r_c", "v_c"), positive=True),
    Group("one_sided_dampers", (), True),
    Group("damper_knees", (), False),
    Group("damper_mounts", ("s_m",), positive=True),
    Group("tyre_damping", ("c_t",), positive=True),
    Group("progressive_tyres", ("b_t",), positive=True),
    Group("friction_left_right", ("dF_c",)),
    Group("dampers_left_right", ("s_c",)),
    Group("corners_left_right", ("dk_s", "dk_t", "dm_u")),
    Group("bump_stops", ("k_b", "g_b", "p_b"), positive=True),
)
BY_NAME = {group.name: group for group in GROUPS}

STAGES = (
    (
        "anti_roll_bars", "cg_offset", "progressive_springs", "friction", "one_sided_dampers",
        "damper_knees",
    ),
    (
        "tyre_damping", "progressive_tyres", "friction_left_right", "dampers_left_right",
        "corners_left_right",
    ),
    ("bump_stops",),
)  # fmt: skip
"""Order of release: large effects first, then effects that imitate them.  If all were released
together from a far start, each would fit the effects of others.  Mounts and static friction join
when their gain is large enough."""
CORRECTIONS_FROM = 1
"""Stage with which stated uncertainties (lateness, weights, places) are released: earlier they
would absorb the effects of the elements."""


def positions(model: Model, chosen: tuple[str, ...], corrections: bool) -> NDArray[np.intp]:
    """Return which unknowns are free with the chosen groups, (F,)."""
    optional = {name for group in GROUPS for name in group.members(model)}
    wanted = {name for group in chosen for name in BY_NAME[group].members(model)}
    stated = set(model.box.corrections)
    free = []
    for i, name in enumerate(model.names):
        if corrections if name in stated else name in wanted or name not in optional:
            free.append(i)
    return np.array(free, dtype=np.intp)


# The release --------------------------------------------------------------------------------------

_ROUGH_SHARE = 2e-3
"""Share of the cost that a stage may leave to the next one."""
_FIRST_FRICTION_N = 15.0
_JOINING_SIZES = {"damper_mounts": 0.3, "static_friction": 0.2}
"""Groups that join where their gain is large enough, with the start of their sizes: a compliance of
0.3e-6 m/N, beyond the local minimum at zero; static friction a fifth above the sliding one."""
_LAST_KNOTS, _POLISHED_KNOTS = "K21", "K37"
"""Knees of the last stage and of the polish: what 21 knees leave moves tyres and wheels by up to
0.7 standard deviations where scales narrow the intervals, and without the four beyond 0.3 m/s I_xx
of a car with solid axles was up to 3 off."""
_STAGE_STEPS = 25
_FOLLOWED_CHI2 = 10.0
"""Largest chi2/n of a first stage from which later stages come down to the noise (8.2 became 0.99,
17.6 did not): where no attempt ends below, the next one is made."""
_FOUND_CHI2, _HOPELESS_CHI2 = 1.2, 10.0
"""chi2/n of the last stage between which the next best attempt is followed as well: a first stage
that ends lower is not always nearer.  Where the best attempt ends higher, a sensor is wrong and not
the start, unless it ends higher than its own first stage: then it has gone astray."""
_HOLDS_CHI2, _DISAGREE_SIGMAS = 1.5, 3.0
"""chi2/n above which a fit is refused, and standard deviations by which an unknown must move with
the beginnings that were left out: noise alone moved the one that moved most by 1.4 in a test."""
_LAST_STEPS = 40
_SEARCH_SHARE = 0.7
"""Share of the time after which the search ends; the polish has the rest."""
_POLISH_STEPS = 25
_CONVERGED = 0.05
_POLISHED = 0.3

Log = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Attempt:
    """Start of a search."""

    runs: tuple[Run, ...]
    """The decays."""
    searched: tuple[Run, ...]
    """The decays, shorter and with fewer samples, to find the neighbourhood of the optimum."""
    eta: NDArray[np.float64]
    """Unknowns, (P,), with elements at rest."""
    sigma: Mapping[str, float]
    """Standard deviation of each channel's noise."""
    skipped_s: float
    """Time after the beginning of the decays from which they are fitted, s."""

    def initials(self, model: Model, eta: NDArray[np.float64]) -> tuple[InitialState, ...]:
        """Return the initial state of each run by the linear model at `eta`, (P,)."""
        return initial_states_of(model, eta, tuple(run.decay for run in self.runs), self.sigma)


def release(
    model: Model,
    attempts: Iterable[Attempt],
    allowed: Callable[[str], bool],
    log: Log,
    clock: Clock,
) -> tuple[Optimum, tuple[str, ...]] | None:
    """Return the optimum of the rich model and the groups in it; None without a finite path.

    `attempts`: a further one is taken only where the earlier ones fail.  `allowed`: whether a group
    may be released.  `log`: receives a line for each stage.  `clock`: limits the time; what it did
    not suffice for is in it afterwards.
    """
    search = _Search(allowed, log, clock)
    chosen = tuple(name for name in STAGES[0] if allowed(name))
    next_attempts = iter(attempts)
    tried: list[Attempt] = []
    first_ends: list[tuple[float, Optimum, Attempt]] = []
    last_ends: list[tuple[float, Optimum, Attempt, tuple[str, ...]]] = []
    is_over = clock.limit(_SEARCH_SHARE, "other starts of the search")
    while len(last_ends) < 3:  # attempts that are followed through the later stages
        while all(_chi2(first_end) >= _FOLLOWED_CHI2 for _, first_end, _ in first_ends):
            if first_ends and is_over():
                break
            attempt = next(next_attempts, None)
            if attempt is None:
                break
            tried.append(attempt)
            first_end = search.first_stage(model, attempt, chosen)
            if first_end is not None:
                # A first stage that leaves out the beginnings ends three times lower from any
                # start, because stops and lift-off are not in it.
                likely_chi2 = _chi2(first_end) * (3.0 if attempt.skipped_s > 0.0 else 1.0)
                first_ends.append((likely_chi2, first_end, attempt))
                first_ends.sort(key=lambda entry: entry[0])
        if not first_ends:
            break
        _, first_end, attempt = first_ends.pop(0)
        best, groups = search.later_stages(first_end, chosen)
        if attempt.skipped_s > 0.0:
            best, attempt = search.with_beginnings(best, attempt, tried[0])
            best, groups = search.with_joining_groups(best, groups)
        chi2 = _chi2(best)
        last_ends.append((chi2, best, attempt, groups))
        if not (_FOUND_CHI2 < chi2 < _HOPELESS_CHI2 or chi2 > _chi2(first_end)) or is_over():
            break
    if not last_ends:
        return None
    _, best, attempt, chosen = min(last_ends, key=lambda entry: entry[0])
    polished = search.polish(best, replace(best.point.problem, runs=attempt.runs), chosen)
    if polished is None:
        return None
    if "damper_mounts" in chosen and not polished.converged:
        problem = polished.point.problem
        # Rigid ones, at their bound, promise more than the paths give, and block all others.
        if not (polished.eta[_size_positions(problem.model, "damper_mounts")] > 0.0).any():
            other_groups = tuple(name for name in chosen if name != "damper_mounts")
            without_mounts = search.polish(polished, problem, other_groups)
            if without_mounts is not None:
                return without_mounts, other_groups
    return polished, chosen


def _chi2(end: Optimum) -> float:
    """Return the cost of a search over its samples less the runs' own unknowns."""
    # 18 of a run: seven displacements, seven speeds, the friction at four corners.
    return end.cost / sum(run.freedom - 18.0 for run in end.point.problem.runs)


@dataclass(frozen=True, slots=True)
class _Search:
    """The common part of the stages of a search; arguments of `release`."""

    allowed: Callable[[str], bool]
    log: Log
    clock: Clock

    def first_stage(
        self, model: Model, attempt: Attempt, chosen: tuple[str, ...]
    ) -> Optimum | None:
        """Return the end of the first stage from a linear start; None without a finite path."""
        eta = attempt.eta.copy()
        centre, prior = weak_priors(model, eta)
        if "friction" in chosen:
            eta[_size_positions(model, "friction")] = _FIRST_FRICTION_N / 50.0  # N of one unit
        problem = Problem(model, attempt.searched, centre, prior, positions(model, chosen, False))
        initials = attempt.initials(model, attempt.eta)
        return self._stage(chosen, problem, eta, initials, _STAGE_STEPS, _ROUGH_SHARE)

    def later_stages(
        self, best: Optimum, chosen: tuple[str, ...]
    ) -> tuple[Optimum, tuple[str, ...]]:
        """Return the optimum with the later stages released, and the groups in it."""
        for number, stage in enumerate(STAGES[1:], start=1):
            with_stage = chosen + tuple(name for name in stage if self.allowed(name))
            starts = [(with_stage, best.eta)]
            stops = begin_stops(best, self.log) if "bump_stops" in with_stage else None
            if stops is not None:
                starts.insert(0, (with_stage, stops))
            problem = best.point.problem
            is_last = number == len(STAGES) - 1
            if is_last and self._promises("damper_mounts", best):
                with_mounts = _joined(problem.model, starts[0][1], "damper_mounts")
                starts.insert(0, ((*with_stage, "damper_mounts"), with_mounts))
            steps, rough_share = (
                (_LAST_STEPS, 0.1 * _ROUGH_SHARE) if is_last else (_STAGE_STEPS, _ROUGH_SHARE)
            )
            for groups, eta in starts:
                released = problem
                if is_last and "damper_knees" in with_stage:
                    released, eta = refined(problem, eta, KNOTS[_LAST_KNOTS])
                free = positions(released.model, groups, number >= CORRECTIONS_FROM)
                released = released.releasing(free)
                eta = at_likely_scale(released, eta)
                end = self._stage(stage, released, eta, best.point.initials, steps, rough_share)
                # Else the new start of these groups has led it astray.
                if end is not None and end.cost < best.cost:
                    best, chosen = end, groups
                    break
        return self.with_joining_groups(best, chosen)

    def with_joining_groups(
        self, best: Optimum, chosen: tuple[str, ...]
    ) -> tuple[Optimum, tuple[str, ...]]:
        """Return the optimum after groups of large gain have joined, and the groups in it."""
        for name in _JOINING_SIZES:
            if name in chosen or not self._promises(name, best):
                continue
            problem, with_group = best.point.problem, (*chosen, name)
            released = problem.releasing(positions(problem.model, with_group, True))
            eta = _joined(problem.model, best.eta, name)
            end = self._stage((name,), released, eta, best.point.initials, _LAST_STEPS)
            if end is not None and end.cost < best.cost:
                best, chosen = end, with_group
        return best, chosen

    def _stage(
        self,
        names: tuple[str, ...],
        problem: Problem,
        eta: NDArray[np.float64],
        initials: tuple[InitialState, ...],
        steps: int,
        rough: float = 0.0,
    ) -> Optimum | None:
        """Return the end of the fit that releases some groups; None without a finite path."""
        names_of_groups = ", ".join(names)
        end = fit(
            problem, eta, initials, ROUGH, tolerance=_CONVERGED, rough=rough, max_iterations=steps,
            is_over=self.clock.limit(_SEARCH_SHARE, names_of_groups.replace("_", " ")),
        )  # fmt: skip
        if end is not None:
            self.log(f"{names_of_groups}: chi2/n {_chi2(end):.3f} after {end.iterations} steps")
        return end

    def with_beginnings(
        self, best: Optimum, attempt: Attempt, first: Attempt
    ) -> tuple[Optimum, Attempt]:
        """Return the optimum with the beginnings that an attempt left out, and the attempt.

        The vehicle is held while each run's first motion is sought.  Runs whose beginning this
        vehicle does not explain stay as they were.  `first`: the attempt that leaves nothing out.
        """
        problem = best.point.problem
        first_states = first.initials(problem.model, best.eta)
        runs, searched = list(attempt.runs), list(attempt.searched)
        initials = list(best.point.initials)
        is_over = self.clock.limit(_SEARCH_SHARE, "beginnings of the decays")
        n_back = 0
        for i, run in enumerate(first.searched):
            found = _first_motion(best, run, first_states[i], is_over)
            # Up to chi2/n 5 from its beginning, by a vehicle that was found without it, the
            # beginning is fitted, too.
            if found is not None and found.point.predicted[0].cost < 5.0 * run.freedom:
                runs[i], searched[i], initials[i] = first.runs[i], run, found.point.initials[0]
                n_back += 1
        end = fit(
            replace(problem, runs=tuple(searched)), best.eta, tuple(initials), ROUGH,
            tolerance=_CONVERGED, rough=0.1 * _ROUGH_SHARE, max_iterations=_LAST_STEPS,
            is_over=is_over,
        )  # fmt: skip
        # Where chi2/n grows by more than a tenth, the model does not hold in the beginnings.
        if end is None or _chi2(end) > 1.1 * _chi2(best):
            self.log("the beginnings stay left out")
            return best, attempt
        self.log(
            f"beginnings of {n_back} of {len(runs)} runs: chi2/n {_chi2(end):.3f} after "
            f"{end.iterations} steps"
        )
        return end, replace(attempt, runs=tuple(runs), searched=tuple(searched))

    def polish(self, best: Optimum, whole: Problem, chosen: tuple[str, ...]) -> Optimum | None:
        """Return the optimum for whole runs, with curves on more knees; None without a path."""
        eta = best.eta
        if "damper_knees" in chosen and whole.model.knots != KNOTS[_POLISHED_KNOTS]:
            whole, eta = refined(whole, eta, KNOTS[_POLISHED_KNOTS])
        whole = whole.releasing(positions(whole.model, chosen, True))
        end = fit(
            whole, at_likely_scale(whole, eta), best.point.initials, POLISH, tolerance=_POLISHED,
            max_iterations=_POLISH_STEPS, is_over=self.clock.limit(1.0, "the last steps"),
        )  # fmt: skip
        if end is not None:
            self.log(f"polished in {end.iterations} steps, decrement {end.decrement:.2g}")
        return end

    def _promises(self, name: str, best: Optimum) -> bool:
        """Return whether a group would lower the cost by much more than chance."""
        problem = best.point.problem
        model = problem.model
        has_friction = model.names.index("F_cf") in problem.free
        if not self.allowed(name) or (name == "static_friction" and not has_friction):
            return False
        n = sum(run.freedom for run in problem.runs)
        gains_and_sizes = gain_of(problem, best, best.eta, _size_positions(model, name))
        gain = sum(of_axle for of_axle, size in zip(*gains_and_sizes, strict=True) if size > 0.0)
        gain /= max(1.0, best.cost / n)
        self.log(f"{name}: would lower the cost by {gain:.0f}")
        # Mounts join at twice the criterion's limit, static friction far below that for which it
        # is named: without it the sliding friction reads up to 20 % high and wheels 1 % light.
        least_gain = 4.0 * float(np.log(n)) if name == "damper_mounts" else 4.0
        return bool(gain > least_gain)


def _size_positions(model: Model, name: str) -> NDArray[np.intp]:
    """Return the positions of a group's first unknown, its size, front and rear."""
    kind = BY_NAME[name].kinds[0]
    return np.array([model.names.index(f"{kind}{axle}") for axle in "fr"])


def _joined(model: Model, eta: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the unknowns with a group at its start values."""
    result = eta.copy()
    result[_size_positions(model, name)] = _JOINING_SIZES[name]
    return result


def _first_motion(
    best: Optimum, run: Run, initial: InitialState, is_over: Callable[[], bool]
) -> Optimum | None:
    """Return the optimum of a run's own unknowns with the vehicle of `best` held."""
    held_vehicle = replace(best.point.problem, free=np.zeros(0, dtype=np.intp), runs=(run,))
    return fit(
        held_vehicle, best.eta, (initial,), ROUGH, is_over=is_over, tolerance=_CONVERGED,
        max_iterations=_STAGE_STEPS,
    )  # fmt: skip


def moved_by_beginnings(
    best: Optimum, runs: tuple[Run, ...], first_states: tuple[InitialState, ...], clock: Clock
) -> NDArray[np.float64]:
    """Return by how much the free unknowns move, (F,), if the beginnings left out are fitted, too.

    What is left without them may be as white as the noise, and no scatter of scores shows that the
    laws of the elements fail in large motions: two parts of the data that disagree do (Hausman
    1978).  Zeros where they disagree no more than by chance, and where the fit of all does not hold
    either: a bump that lasts longer than stated says nothing about the vehicle.
    """
    problem = replace(best.point.problem, runs=runs)
    is_over = clock.limit(1.0, "beginnings left out")
    initials = []
    for run, x0 in zip(runs, first_states, strict=True):
        motion = _first_motion(best, run, x0, is_over)
        initials.append(motion.point.initials[0] if motion else x0)
    share, steps = 0.1 * _ROUGH_SHARE, _LAST_STEPS
    end = fit(problem, best.eta, tuple(initials), ROUGH, _CONVERGED, share, steps, is_over)
    if end is None or _chi2(end) > _HOLDS_CHI2:
        return np.zeros(len(problem.free))
    moved, variance = (end.eta - best.eta)[problem.free], np.diag(inverse(best.information))
    return np.asarray(moved * bool((moved**2 > _DISAGREE_SIGMAS**2 * variance).any()))


# Finds the gap at which the bump stop of each axle begins in a fit --------------------------------

_STOOD_IN = ("k_2", "k_3")
"""Unknowns that imitate an axle's stop while it is missing.  They begin again at zero when it
joins: from a spring stiffened as much as the missing stop required, the search did not return in 40
steps; from zero it needs 4 to 8."""
_SHARES = (0.97, 0.93, 0.86, 0.77, 0.66, 0.54, 0.42, 0.3)
"""Gaps at which a bump stop is tried, in shares of the axle's largest compression: the cost of a
stop that is not touched has no slope by its gap, and a fit does not reach a gap of 40 mm from 33
mm while a progressive spring imitates the stop."""


def begin_stops(best: Optimum, log: Callable[[str], None]) -> NDArray[np.float64] | None:
    """Return the unknowns, (P,), with each axle's bump stop where it would lower the cost most.

    None where no stop would lower it by more than chance.  `log`: receives a line.
    """
    problem = best.point.problem
    names = problem.model.names
    n = sum(run.freedom for run in problem.runs)
    rates = np.array([names.index(f"k_b{axle}") for axle in "fr"])
    gaps = np.array([names.index(f"g_b{axle}") for axle in "fr"])
    largest_of_runs = [
        car.travels(run.path.states).max(axis=0)
        for car, run in zip(best.point.cars, best.point.predicted, strict=True)
    ]
    # At least 10 mm: a gap has no logarithm at zero.
    largest_m = np.maximum(np.max(largest_of_runs, axis=0).reshape(2, 2).max(axis=1), 0.01)
    result = best.eta.copy()
    best_gains = np.full(2, 2.0 * np.log(n) * max(1.0, best.cost / n))
    for share in _SHARES:
        trial = best.eta.copy()
        trial[gaps] = np.log(share * largest_m)
        gains, sizes = gain_of(problem, best, trial, rates)
        for i, axle in enumerate("fr"):
            if sizes[i] > 0.0 and gains[i] > best_gains[i]:
                best_gains[i] = gains[i]
                result[gaps[i]] = trial[gaps[i]]
                result[rates[i]] = min(sizes[i], 1.5)  # 1.5e5 N/m at most
                result[[names.index(f"{kind}{axle}") for kind in _STOOD_IN]] = 0.0
    gaps_mm = [f"{1e3 * np.exp(result[gaps[i]]):.0f} mm" for i in np.flatnonzero(result[rates])]
    log(f"bump_stops: begin at {', '.join(gaps_mm) or 'nothing'}")
    return result if gaps_mm else None
