"""Finds the optimum from records: noise levels, start values, and the start of each decay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import (
    FreeDecay,
    Record,
    decay_start_s,
    difference_noise,
    onset_s,
    quiet_counts,
    quiet_noise,
)
from .decay_start import earliest_start_s
from .grey_box import GreyBox
from .likelihood import (
    HOLD,
    Engine,
    Fit,
    LinearEngine,
    LinearFit,
    Linearised,
    Residuals,
    fit,
    linearised,
    residuals_of,
)

_BASIN_CHI2 = 1.3
"""chi2/n below which a search has led near an optimum that holds."""
_SEARCH_RATE_HZ = 250.0  # enough to find the basin of the optimum
_LATER_S = (0.02, 0.05)
"""Later starts, s, to try when the model does not fit from the stated end of the bump.  None is
later: an error in the wheels' motion dies within 0.2 s, and a start after that would hide it."""
_LATER_UNSTATED_S = (0.1, 0.2, 0.4)
"""Later starts, s, to try where no bump is stated and a record may begin within it."""
_SEARCH_STEPS = 40
_FIT_STEPS = 30
_WIDEST = 1.0
"""Standard deviation of each unknown, the logarithm of a parameter, before any run: a factor e.
Without it, predictions would have no covariance where runs do not determine the masses."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Estimation:
    """A fit with everything that it is based on.

    Compared by identity, so that derived values can be cached per estimation.
    """

    box: GreyBox
    """Structure of the problem."""
    records: tuple[Record, ...]
    """All runs."""
    fit: Fit
    """The optimum."""
    decays: tuple[FreeDecay, ...]
    """The windows used, one for each record."""
    sigma: dict[str, float]
    """Noise level by which each channel is weighted, SI: measured at rest and, if the model holds,
    in the residuals."""
    rest: dict[str, float]
    """Noise level measured at rest; empty if there was no quiet stretch."""
    residuals: tuple[Residuals, ...]
    """One for each decay."""
    chi2_per_n: float
    """Mean square residual in units of the noise at rest, by degrees of freedom: 1 if the model
    holds.  Without a quiet stretch the noise is the rough part of the residuals."""
    later_s: float = 0.0
    """Delay after the expected start from which the decays were first fitted with success, s."""
    nonlinear: Engine | None = None
    """Engine of a nonlinear fit; None if the fit is the linear one."""
    laws: NDArray[np.float64] | None = None
    """Part of the covariance that no residual shows, (P, P): what the errors of the laws of a
    nonlinear fit move; None for the linear one."""
    unreached: tuple[str, ...] = ()
    """Parts of a nonlinear search that it had no time for, in words."""

    @property
    def engine(self) -> Engine:
        """Engine of this fit: evaluates normal blocks and residuals of runs at other unknowns."""
        return self.nonlinear or LinearEngine(self.box)

    @property
    def full(self) -> NDArray[np.float64]:
        """Full parameters at the optimum, (28,)."""
        return self.box.full(self.fit.eta.astype(complex)).real

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residuals, not reduced by the shared unknowns."""
        return sum(sum(r.freedom.values()) for r in self.residuals)

    @property
    def chi2_std(self) -> float:
        """Standard deviation of chi2/n if the model holds; noise levels rest on finite samples."""
        quiet = sum(quiet_counts(self.records).values()) if self.rest else self.freedom / 2.0
        return float(np.sqrt(2 / self.freedom + 2 / quiet)) if self.freedom > 0.0 else 0.0

    @property
    def chi2_limit(self) -> float:
        """Upper limit of chi2/n if the model holds."""
        # Five standard deviations; clocks fitted to arrival times and quantisation may cause 0.02.
        excess = max(0.02, 5.0 * self.chi2_std)
        return 1.0 + excess if self.freedom > 0.0 else 1.0

    @property
    def holds(self) -> bool:
        """True if the model explains the decays up to the noise."""
        return self.chi2_per_n <= self.chi2_limit

    @property
    def noise(self) -> dict[str, float]:
        """Noise that residuals are compared with: at rest where it was measured."""
        return floored(self.rest, self.decays) if self.rest else self.sigma


_LINEARISED: WeakKeyDictionary[Estimation, Linearised] = WeakKeyDictionary()
"""Linear model of each estimation in use; computed once, because many gates ask for it."""


def linearised_at(estimation: Estimation) -> Linearised:
    """Return the linear model at the optimum, the channels weighted by their noise."""
    if estimation not in _LINEARISED:
        fit, noise, decays = estimation.fit, estimation.noise, estimation.decays
        model = fit.linearised if isinstance(fit, LinearFit) else None
        if model is None or model.decays is not decays or estimation.sigma != noise:
            box = estimation.box
            # The sizes of elements follow the unknowns of the box in a nonlinear fit.
            model = linearised(box, decays, noise, fit.eta[: len(box.prior_sigma)])
        _LINEARISED[estimation] = model
    return _LINEARISED[estimation]


def estimate(
    box: GreyBox, records: Sequence[Record], starts: Sequence[NDArray[np.float64]]
) -> Estimation:
    """Find the most likely parameters of all records.

    The decays start where the stated bump ends; if the model does not fit from there, a later start
    is tried.  Once it fits, the samples before the start show how far back a decay reaches.

    `starts`, sequence of (15,) float64: parameters to begin from, the most trusted first; further
    ones are tried only where the earlier ones find no optimum.
    """
    first = first_estimate(box, records, starts)
    if first.holds or not later_may_hold(first, starts):
        return first
    return later_estimate(first, starts)


def first_estimate(
    box: GreyBox, records: Sequence[Record], starts: Sequence[NDArray[np.float64]]
) -> Estimation:
    """Fit the decays from the stated end of the bump; arguments as in `estimate`."""
    records = tuple(records)
    start_s = np.array([decay_start_s(record) for record in records])
    rest = quiet_noise(records)
    near = basin(box, records, rest, start_s, [box.unknowns(theta) for theta in starts])
    trial = _fitted_from(box, records, rest, start_s, near)
    return settled(trial) if trial.holds else trial


def later_estimate(first: Estimation, starts: Sequence[NDArray[np.float64]]) -> Estimation:
    """Return a fit from a later start if one may hold (`later_may_hold`), else the first fit."""
    box, records, rest = first.box, first.records, first.rest
    near, generic = first.fit.eta, box.unknowns(starts[0])
    for later_s, start_s in _later_starts(records):
        # With the bump's last force in the window the first search may have gone astray.
        searches = [_search(box, records, rest, start_s, eta) for eta in (near, generic)]
        near = min(searches, key=lambda search: search.cost).eta
        trial = _fitted_from(box, records, rest, start_s, near)
        if trial.holds:
            return settled(replace(trial, later_s=later_s))
    return first


def later_may_hold(first: Estimation, starts: Sequence[NDArray[np.float64]]) -> bool:
    """Return whether a later start explains nearly all, by a rough fit of the last one.

    A model that holds from some start holds from any later one: if it fails from the last, it fails
    from all.
    """
    laters = _later_starts(first.records)
    if not laters:
        return False
    _, last_s = laters[-1]
    n = sum(
        record.decay(float(s)).thinned(_SEARCH_RATE_HZ).n_values
        for record, s in zip(first.records, last_s, strict=True)
    )
    return any(
        _search(first.box, first.records, first.rest, last_s, eta).cost < _BASIN_CHI2 * n
        for eta in (first.fit.eta, first.box.unknowns(starts[0]))
    )


def _later_starts(records: tuple[Record, ...]) -> list[tuple[float, NDArray[np.float64]]]:
    """Return the delays to try, s, each with the later starts of all decays, (n_records,) s."""
    first_s = np.array([decay_start_s(record) for record in records])
    stated = all(np.isfinite(record.bump_s) for record in records)
    # Where rest was seen and no bump is stated, the first guess is late enough for any bump.
    movable = np.array([stated or onset_s(record) is None for record in records])
    if not movable.any():
        return []
    # The shortest decay, too, keeps half a period of the wheels, 0.05 s.
    longest_s = min(r.end_s - s for r, s in zip(records, first_s, strict=True)) - 0.05
    return [
        (later_s, first_s + np.where(movable, later_s, 0.0))
        for later_s in (_LATER_S if stated else _LATER_UNSTATED_S)
        if later_s < longest_s
    ]


def basin(
    box: GreyBox,
    records: tuple[Record, ...],
    rest: dict[str, float],
    start_s: NDArray[np.float64],
    etas: Sequence[NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return an optimum, (P,), that explains nearly all, or that two starts led to.

    Else it is the best that any start led to.  `rest`: noise at rest, SI.  `start_s`, (n_records,):
    starts of the decays.  `etas`: where to begin, each (P,), at least one.
    """
    best = _search(box, records, rest, start_s, etas[0])
    for eta in etas[1:]:
        if best.explains:
            break
        search = _search(box, records, rest, start_s, eta)
        # Two searches whose costs differ by less than 1 % have led to one optimum.
        again = abs(search.cost / best.cost - 1.0) < 0.01
        best = min(best, search, key=lambda one: one.cost)
        if again:
            break
    return best.eta


def settled(late: Estimation) -> Estimation:
    """Move each decay's start as far back as the model holds; weigh the channels by their noise."""
    best = late
    # Each fit shows a little more of the motion, so the starts are moved back three times at most.
    for _ in range(3):
        model = linearised_at(best)
        information = np.sum(list(best.fit.information.values()), axis=0)
        covariance = np.linalg.inv(information + np.eye(len(information)) / _WIDEST**2)
        starts_s = [
            earliest_start_s(
                model.points[d.mass_state], covariance, record, d, linear, _lower_s(record)
            )
            for record, d, linear in zip(best.records, best.decays, model.linear, strict=True)
        ]
        if starts_s == [d.start_s for d in best.decays]:
            break
        moved = _fitted_from(best.box, best.records, best.rest, np.array(starts_s), best.fit.eta)
        if not moved.holds:
            break
        best = replace(moved, later_s=late.later_s)
    return _reweighted(best)


def _lower_s(record: Record) -> float:
    """Return the time before which no decay can start, s: the onset of motion, if it was seen."""
    onset = onset_s(record)
    return record.start_s if onset is None else onset


@dataclass(frozen=True, slots=True)
class _Search:
    """Result of a search: the point (P,), its cost, whether it explains nearly all."""

    eta: NDArray[np.float64]
    cost: float
    explains: bool


def _search(
    box: GreyBox,
    records: tuple[Record, ...],
    rest: dict[str, float],
    start_s: NDArray[np.float64],
    eta: NDArray[np.float64],
) -> _Search:
    """Search an optimum on thinned samples, from `eta`, which may be far off."""
    decays = tuple(
        r.decay(float(s)).thinned(_SEARCH_RATE_HZ) for r, s in zip(records, start_s, strict=True)
    )
    sigma = floored(rest or rough_noise(decays), decays)
    n = sum(decay.n_values for decay in decays)
    power = 0.0  # of the motion, in units of the noise's power
    for recording in (r for decay in decays for r in decay.recordings):
        motion = recording.values - recording.values.mean(axis=0)
        noise = [sigma[c.name] for c in recording.group.channels]
        power += float(np.sum((motion / noise) ** 2))
    # To a tenth of a standard deviation: a search is followed by a fit.
    rough = fit(box, decays, sigma, eta, 0.1, _SEARCH_STEPS, HOLD)
    # In the right basin even a wrong model leaves no more than 3 % of the motion's power.
    explains = rough.cost < _BASIN_CHI2 * n + 0.03 * power
    return _Search(rough.eta, rough.cost, explains)


def _fitted_from(
    box: GreyBox,
    records: tuple[Record, ...],
    rest: dict[str, float],
    start_s: NDArray[np.float64],
    eta: NDArray[np.float64],
) -> Estimation:
    """Fit the decays that begin at the given times, (n_records,), from near the optimum."""
    decays = tuple(r.decay(float(s)) for r, s in zip(records, start_s, strict=True))
    sigma = floored(rest or rough_noise(decays), decays)
    fine = fit(box, decays, sigma, eta, max_iterations=_FIT_STEPS)
    residuals = residuals_of(fine.linearised, decays, sigma)
    if not rest:
        # In two fits the noise and the fit settle together.
        for _ in range(2):
            sigma = floored(_residual_noise(residuals), decays)
            fine = fit(box, decays, sigma, fine.eta)
            residuals = residuals_of(fine.linearised, decays, sigma)
    chi2 = _chi2_per_n(box, residuals, sigma)
    return Estimation(box, records, fine, decays, sigma, rest, residuals, chi2)


def _reweighted(best: Estimation) -> Estimation:
    """Pool the noise at rest, a few dozen samples perhaps, with that of the residuals."""
    if not best.rest:
        return best
    counts = quiet_counts(best.records)
    pooled = {}
    for name, std in best.rest.items():
        in_runs = [decay for decay in best.residuals if name in decay.values]
        squares = sum(float(decay.values[name] @ decay.values[name]) for decay in in_runs)
        freedom = sum(decay.freedom[name] for decay in in_runs)
        total = counts[name] * std**2 + squares
        pooled[name] = float(np.sqrt(total / (counts[name] + freedom)))
    sigma = floored(pooled, best.decays)
    fine = fit(best.box, best.decays, sigma, best.fit.eta)
    residuals = residuals_of(fine.linearised, best.decays, sigma)
    chi2 = _chi2_per_n(best.box, residuals, best.noise)
    return replace(best, fit=fine, sigma=sigma, residuals=residuals, chi2_per_n=chi2)


def _chi2_per_n(box: GreyBox, residuals: Sequence[Residuals], sigma: dict[str, float]) -> float:
    """Return the mean square residual in units of `sigma`, by degrees of freedom."""
    squares = sum(
        float(values @ values) / sigma[name] ** 2
        for decay in residuals
        for name, values in decay.values.items()
    )
    freedom = sum(sum(decay.freedom.values()) for decay in residuals) - len(box.parameters)
    return squares / freedom if freedom > 0 else float("inf")


def rough_noise(decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Return an upper bound of the noise from the samples themselves."""
    largest: dict[str, float] = {}
    for decay in decays:
        for recording in decay.recordings:
            noise = difference_noise(recording.values)
            for channel, std in zip(recording.group.channels, noise.tolist(), strict=True):
                largest[channel.name] = max(largest.get(channel.name, 0.0), std)
    return largest


def _residual_noise(residuals: Sequence[Residuals]) -> dict[str, float]:
    """Return each channel's noise, SI: the rough part of its residuals, over all decays alike."""
    variances: dict[str, list[NDArray[np.float64]]] = {}
    for decay in residuals:
        for name, values in decay.values.items():
            variances.setdefault(name, []).append(difference_noise(values) ** 2)
    return {name: float(np.sqrt(np.mean(each))) for name, each in variances.items()}


def floored(sigma: dict[str, float], decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Keep noise levels above what rounding makes of noise-free data."""
    mean_squares: dict[str, list[float]] = {}
    for decay in decays:
        for recording in decay.recordings:
            squares = np.einsum("nc,nc->c", recording.values, recording.values)
            means = (squares / len(recording.values)).tolist()
            for channel, mean in zip(recording.group.channels, means, strict=True):
                mean_squares.setdefault(channel.name, []).append(mean)
    # Noise-free data have the noise of rounding, 1e-5 of a channel's rms.
    floor = {name: 1e-5 * float(np.sqrt(np.mean(each))) for name, each in mean_squares.items()}
    # A channel of zeros has no noise, and zero has no inverse.
    return {name: max(std, floor.get(name, 0.0), 1e-300) for name, std in sigma.items()}


# The vehicles from which a search may start -------------------------------------------------------

_MID_SIZE_CAR = np.array(
    [1500, 2500, 500, 40, 40, 20e3, 20e3, 200e3, 200e3, 1500, 1500, 1.3, 1.4, 0.75, 0.75]
)
"""SI, in the order of `daq.vehicle.PARAMETER_NAMES`: five masses and inertias, six springs and
dampers, four lengths."""


def generic_vehicles() -> tuple[NDArray[np.float64], ...]:
    """Return the vehicles, each (15,), from which a search may start: a car and its variants.

    The variants are lighter, heavier, stiffer and more strongly damped; together they lie within a
    factor of two or three of anything on four wheels that is bumped by hand.
    """
    factors = ((1.0, 1.0), (2.0, 2.0), (0.5, 0.5), (1.0, 2.0), (2.0, 1.0), (4.0, 4.0))
    return tuple(
        _MID_SIZE_CAR * np.repeat([mass, force, 1.0], [5, 6, 4]) for mass, force in factors
    )
