"""Fits the rich model: its elements are released in stages, then all unknowns are polished."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .begin import at_likely_scale, initial_states_of, refined, weak_priors
from .car import KNOTS, Model
from .fit import Clock, Optimum, fit, gain_of, inverse
from .path import POLISH, ROUGH, InitialState, travel_speeds
from .problem import Point, Problem, Run

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
AS_PARAMETERS = frozenset({"anti_roll_bars", "cg_offset", "tyre_damping"})
"""Groups that are also parameters of the linear model."""

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
_LATE = {"damper_mounts": 0.3, "static_friction": 0.2}
"""Groups that join where their gain is large enough, with the start of their sizes: a compliance of
0.3e-6 m/N, beyond the local minimum at zero; static friction a fifth above the sliding one."""
_LAST_KNOTS, _POLISHED_KNOTS = "K21", "K37"
"""Knees of the last stage and of the polish: what 21 knees leave moves tyres and wheels by up to
0.7 standard deviations where scales narrow the intervals, and without the four beyond 0.3 m/s I_xx
of a car with solid axles was up to 3 off."""
_STAGE_STEPS = 25
_FOLLOWED = 10.0
"""Largest chi2/n of a first stage from which later stages come down to the noise (8.2 became 0.99,
17.6 did not): where no attempt ends below, the next one is made."""
_FOUND, _HOPELESS = 1.2, 10.0
"""chi2/n of the last stage between which the next best attempt is followed as well: a first stage
that ends lower is not always nearer.  Where the best attempt ends higher, a sensor is wrong and not
the start, unless it ends higher than its own first stage: then it has gone astray."""
_HOLDS, _DISAGREE = 1.5, 3.0
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
    late_s: float
    """Time after the beginning of the decays from which they are fitted, s."""

    def initials(self, model: Model, eta: NDArray[np.float64]) -> tuple[InitialState, ...]:
        """Return the initial state of each run by the linear model at `eta`, (P,)."""
        return initial_states_of(model, eta, tuple(run.decay for run in self.runs), self.sigma)

    @property
    def freedom(self) -> float:
        """Number of searched samples less that of the runs' own unknowns."""
        return sum(run.freedom - 18.0 for run in self.searched)


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
    chosen = tuple(name for name in STAGES[0] if allowed(name))
    source = iter(attempts)
    begun: list[Attempt] = []
    waiting: list[tuple[float, Optimum, Attempt]] = []
    ends: list[tuple[float, Optimum, Attempt, tuple[str, ...]]] = []
    is_over = clock.limit(_SEARCH_SHARE, "other starts of the search")
    while len(ends) < 3:  # attempts that are followed through the later stages
        while all(one.cost >= _FOLLOWED * attempt.freedom for _, one, attempt in waiting):
            if waiting and is_over():
                break
            attempt = next(source, None)
            if attempt is None:
                break
            begun.append(attempt)
            end = _first(model, attempt, chosen, clock)
            if end is not None:
                chi2 = end.cost / attempt.freedom
                log(f"{', '.join(chosen)}: chi2/n {chi2:.3f} after {end.iterations} steps")
                # A first stage that leaves out the beginnings ends three times lower from any
                # start, because stops and lift-off are not in it.
                likely = chi2 * (3.0 if attempt.late_s > 0.0 else 1.0)
                waiting = sorted([*waiting, (likely, end, attempt)], key=lambda one: one[0])
        if not waiting:
            break
        _, start, taken = waiting.pop(0)
        best, fitted, groups = _stages(start, taken, begun[0], chosen, allowed, log, clock)
        chi2 = best.cost / fitted.freedom
        ends.append((chi2, best, fitted, groups))
        if not (_FOUND < chi2 < _HOPELESS or chi2 > start.cost / taken.freedom) or is_over():
            break
    if not ends:
        return None
    _, best, taken, chosen = min(ends, key=lambda one: one[0])
    polished = _polished(best, replace(best.point.problem, runs=taken.runs), chosen, log, clock)
    if polished is not None and not polished.converged:
        there = _without_vanished(polished, chosen)
        if there != chosen:
            again = _polished(polished, polished.point.problem, there, log, clock)
            polished, chosen = (polished, chosen) if again is None else (again, there)
    return None if polished is None else (polished, chosen)


def _stages(
    best: Optimum,
    taken: Attempt,
    first: Attempt,
    chosen: tuple[str, ...],
    allowed: Callable[[str], bool],
    log: Log,
    clock: Clock,
) -> tuple[Optimum, Attempt, tuple[str, ...]]:
    """Release the later stages from the end of the first one.

    `taken`: the attempt that led there; `first`: the attempt that leaves nothing out.  Returns the
    optimum, the attempt with the data that are then fitted, and the groups in the optimum.
    """
    n = taken.freedom
    problem = best.point.problem
    for k, stage in enumerate(STAGES[1:], start=1):
        more = chosen + tuple(name for name in stage if allowed(name))
        starts = [(more, best.eta)]
        if "bump_stops" in more and (begun := begin_stops(best, log)) is not None:
            starts.insert(0, (more, begun))
        last = k == len(STAGES) - 1
        if last and _promises("damper_mounts", problem, best, allowed, log):
            joined = _joined(problem.model, starts[0][1], "damper_mounts")
            starts.insert(0, ((*more, "damper_mounts"), joined))
        refine = last and "damper_knees" in more
        for groups, eta in starts:
            within, start = refined(problem, eta, KNOTS[_LAST_KNOTS]) if refine else (problem, eta)
            freed = within.releasing(positions(within.model, groups, k >= CORRECTIONS_FROM))
            end = fit(
                freed, at_likely_scale(freed, start), best.point.initials, ROUGH,
                tolerance=_CONVERGED, rough=0.1 * _ROUGH_SHARE if last else _ROUGH_SHARE,
                max_iterations=_LAST_STEPS if last else _STAGE_STEPS,
                is_over=clock.limit(_SEARCH_SHARE, in_words(stage)),
            )  # fmt: skip
            if end is None:
                continue
            log(f"{', '.join(stage)}: chi2/n {end.cost / n:.3f} after {end.iterations} steps")
            if end.cost < best.cost:  # else the new start of these groups has led it astray
                best, chosen, problem = end, groups, end.point.problem
                break
    best, chosen = _with_late(best, n, chosen, allowed, log, clock)
    if taken.late_s > 0.0:
        best, taken = _with_beginnings(best, taken, first, log, clock)
        best, chosen = _with_late(best, taken.freedom, chosen, allowed, log, clock)
    return best, taken, chosen


def _with_late(
    best: Optimum,
    n: float,
    chosen: tuple[str, ...],
    allowed: Callable[[str], bool],
    log: Log,
    clock: Clock,
) -> tuple[Optimum, tuple[str, ...]]:
    """Return the optimum after groups of large gain have joined, and the groups in it."""
    for name in _LATE:
        problem = best.point.problem
        if name in chosen or not _promises(name, problem, best, allowed, log):
            continue
        more = (*chosen, name)
        end = fit(
            problem.releasing(positions(problem.model, more, True)),
            _joined(problem.model, best.eta, name), best.point.initials, ROUGH,
            tolerance=_CONVERGED, max_iterations=_LAST_STEPS,
            is_over=clock.limit(_SEARCH_SHARE, in_words((name,))),
        )  # fmt: skip
        if end is None:
            continue
        log(f"{name}: chi2/n {end.cost / n:.3f} after {end.iterations} steps")
        if end.cost < best.cost:
            best, chosen = end, more
    return best, chosen


def _with_beginnings(
    best: Optimum, taken: Attempt, first: Attempt, log: Log, clock: Clock
) -> tuple[Optimum, Attempt]:
    """Return the optimum with the beginnings that an attempt left out, and the attempt with them.

    The vehicle is held while each run's first motion is sought.  Runs whose beginning this
    vehicle does not explain stay as they were.
    """
    problem, late = best.point.problem, best.cost / taken.freedom
    begun = first.initials(problem.model, best.eta)
    runs, searched, initials = list(taken.runs), list(taken.searched), list(best.point.initials)
    is_over = clock.limit(_SEARCH_SHARE, "beginnings of the decays")
    for i, run in enumerate(first.searched):
        alone = _first_motion(best, run, begun[i], is_over)
        # Up to chi2/n 5 from its beginning, by a vehicle that was found without it, the beginning
        # is fitted, too.
        if alone is not None and alone.point.predicted[0].cost < 5.0 * run.freedom:
            runs[i], searched[i], initials[i] = first.runs[i], run, alone.point.initials[0]
    whole = replace(taken, runs=tuple(runs), searched=tuple(searched))
    end = fit(
        replace(problem, runs=whole.searched), best.eta, tuple(initials), ROUGH,
        tolerance=_CONVERGED, rough=0.1 * _ROUGH_SHARE, max_iterations=_LAST_STEPS,
        is_over=is_over,
    )  # fmt: skip
    # Where chi2/n grows by more than a tenth, the model does not hold in the beginnings.
    if end is None or end.cost / whole.freedom > 1.1 * late:
        log("the beginnings stay left out")
        return best, taken
    back = sum(run is begun for run, begun in zip(searched, first.searched, strict=True))
    log(
        f"beginnings of {back} of {len(runs)} runs: chi2/n {end.cost / whole.freedom:.3f} after "
        f"{end.iterations} steps"
    )
    return end, whole


def _first_motion(
    best: Optimum, run: Run, begun: InitialState, is_over: Callable[[], bool]
) -> Optimum | None:
    """Return the optimum of a run's own unknowns for the vehicle that was found."""
    held = replace(best.point.problem, free=np.zeros(0, dtype=np.intp), runs=(run,))
    return fit(
        held, best.eta, (begun,), ROUGH, is_over=is_over, tolerance=_CONVERGED,
        max_iterations=_STAGE_STEPS,
    )  # fmt: skip


def moved_by_beginnings(
    best: Optimum, runs: tuple[Run, ...], begun: tuple[InitialState, ...], clock: Clock
) -> NDArray[np.float64]:
    """Return by how much the free unknowns move, (F,), if the beginnings left out are fitted, too.

    What is left without them may be as white as the noise, and no scatter of scores shows that the
    laws of the elements fail in large motions: two parts of the data that disagree do (Hausman
    1978).  Zeros where they disagree no more than by chance, and where the fit of all does not hold
    either: a bump that lasts longer than stated says nothing about the vehicle.
    """
    problem = replace(best.point.problem, runs=runs)
    is_over = clock.limit(1.0, "beginnings left out")
    ends = [_first_motion(best, run, x0, is_over) for run, x0 in zip(runs, begun, strict=True)]
    initials = tuple(e.point.initials[0] if e else x0 for e, x0 in zip(ends, begun, strict=True))
    share, steps = 0.1 * _ROUGH_SHARE, _LAST_STEPS
    end = fit(problem, best.eta, initials, ROUGH, _CONVERGED, share, steps, is_over)
    if end is None or end.cost > _HOLDS * sum(run.freedom - 18.0 for run in runs):
        return np.zeros(len(problem.free))
    moved, variance = (end.eta - best.eta)[problem.free], np.diag(inverse(best.information))
    return np.asarray(moved * bool((moved**2 > _DISAGREE**2 * variance).any()))


def _polished(
    best: Optimum, whole: Problem, chosen: tuple[str, ...], log: Log, clock: Clock
) -> Optimum | None:
    """Return the optimum for whole runs, with curves on more knees; None without a finite path."""
    eta = best.eta
    if "damper_knees" in chosen and whole.model.knots != KNOTS[_POLISHED_KNOTS]:
        whole, eta = refined(whole, eta, KNOTS[_POLISHED_KNOTS])
    whole = whole.releasing(positions(whole.model, chosen, True))
    end = fit(
        whole, at_likely_scale(whole, eta), best.point.initials, POLISH, tolerance=_POLISHED,
        max_iterations=_POLISH_STEPS, is_over=clock.limit(1.0, "the last steps"),
    )  # fmt: skip
    if end is not None:
        log(f"polished in {end.iterations} steps, decrement {end.decrement:.2g}")
    return end


def _without_vanished(best: Optimum, chosen: tuple[str, ...]) -> tuple[str, ...]:
    """Return the groups without mounts that have become rigid.

    At their bound, their tangents promise more than the paths give, and block all other unknowns.
    """
    sizes = best.eta[_sizes(best.point.problem.model, "damper_mounts")]
    return tuple(name for name in chosen if name != "damper_mounts" or (sizes > 0.0).any())


def _first(model: Model, attempt: Attempt, chosen: tuple[str, ...], clock: Clock) -> Optimum | None:
    """Return the end of the first stage from a linear start; None if it has no finite path."""
    eta = attempt.eta.copy()
    centre, prior = weak_priors(model, eta)
    if "friction" in chosen:
        for name in BY_NAME["friction"].members(model)[:2]:
            eta[model.names.index(name)] = _FIRST_FRICTION_N / 50.0
    problem = Problem(model, attempt.searched, centre, prior, positions(model, chosen, False))
    return fit(
        problem, eta, attempt.initials(model, attempt.eta), ROUGH, tolerance=_CONVERGED,
        rough=_ROUGH_SHARE, max_iterations=_STAGE_STEPS,
        is_over=clock.limit(_SEARCH_SHARE, in_words(chosen)),
    )  # fmt: skip


def in_words(groups: Sequence[str]) -> str:
    """Return the names of some groups in words."""
    return ", ".join(group.replace("_", " ") for group in groups)


def _promises(
    name: str, problem: Problem, best: Optimum, allowed: Callable[[str], bool], log: Log
) -> bool:
    """Return whether a group would lower the cost by much more than chance."""
    model = problem.model
    has_friction = model.names.index("F_cf") in problem.free
    if not allowed(name) or (name == "static_friction" and not has_friction):
        return False
    n = sum(run.freedom for run in problem.runs)
    promised = gain_of(problem, best, best.eta, _sizes(model, name))
    gain = sum(g for g, size in zip(*promised, strict=True) if size > 0.0)
    gain /= max(1.0, best.cost / n)
    log(f"{name}: would lower the cost by {gain:.0f}")
    # Mounts join at twice the criterion's limit, static friction far below that for which it is
    # named: without it the sliding friction reads up to 20 % high and wheels 1 % light.
    pays = 4.0 * float(np.log(n)) if name == "damper_mounts" else 4.0
    return bool(gain > pays)


def _sizes(model: Model, name: str) -> NDArray[np.intp]:
    """Return the positions of a group's first unknown, front and rear."""
    kind = BY_NAME[name].kinds[0]
    return np.array([model.names.index(f"{kind}{axle}") for axle in "fr"])


def _joined(model: Model, eta: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the unknowns with a group at its start values."""
    result = eta.copy()
    result[_sizes(model, name)] = _LATE[name]
    return result


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
    largest = _largest_compressions(best.point)
    result = best.eta.copy()
    most = np.full(2, 2.0 * np.log(n) * max(1.0, best.cost / n))
    for share in _SHARES:
        tried = best.eta.copy()
        tried[gaps] = np.log(share * largest)
        gains, sizes = gain_of(problem, best, tried, rates)
        for i, axle in enumerate("fr"):
            if sizes[i] > 0.0 and gains[i] > most[i]:
                most[i] = gains[i]
                result[gaps[i]] = tried[gaps[i]]
                # It begins with 1.5e5 N/m at most.
                result[rates[i]] = min(sizes[i], 1.5)
                result[[names.index(f"{kind}{axle}") for kind in _STOOD_IN]] = 0.0
    begun = [f"{1e3 * np.exp(result[gaps[i]]):.0f} mm" for i in np.flatnonzero(result[rates])]
    log(f"bump_stops: begin at {', '.join(begun) or 'nothing'}")
    return result if begun else None


def _largest_compressions(at: Point) -> NDArray[np.float64]:
    """Return the largest compression of the front and the rear suspensions in all runs, (2,) m."""
    corners = [
        travel_speeds(car, run.path.states, 0).max(axis=0)
        for car, run in zip(at.cars, at.predicted, strict=True)
    ]
    front_rear = np.max(corners, axis=0).reshape(2, 2).max(axis=1)
    # At least 10 mm: a gap has no logarithm at zero.
    return np.asarray(np.maximum(front_rear, 0.01))
