"""Finds the optimum from records: noise levels, start values, and where each free decay begins.

Every sample of the first 50 ms counts: the wheels' motion has lost half its size by then.  From a
start that is late enough the samples before it are predicted one by one, each prediction updated
by the samples already accepted (recursive least squares).  The errors of prediction are independent
and of known variance as long as the motion is free; the bump's last force shows sooner or later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from daq.channels import Quantity

from ..decays.decay import (
    FreeDecay,
    Record,
    by_channel,
    decay_start_s,
    difference_noise,
    onset_s,
    quiet_counts,
    quiet_noise,
)
from ..model.matrices import Real
from .grey_box import GreyBox
from .likelihood import (
    HOLD,
    Engine,
    Fit,
    LinearEngine,
    Linearised,
    Noise,
    Residuals,
    fit,
    linearised,
    residuals_of,
)
from .varpro import LinearPart, StateModel, slopes

_BASIN_CHI2 = 1.3
"""chi2/n below which a search has led near an optimum that holds."""
Records = tuple[Record, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Estimation:
    """A fit with everything that it is based on.

    Compared by identity, so that derived values can be cached per estimation.
    """

    box: GreyBox
    records: Records
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
    laws: Real | None = None
    """Part of the covariance that no residual shows, (P, P): what the errors of the laws of a
    nonlinear fit move; None for the linear one."""
    unreached: tuple[str, ...] = ()
    """Parts of a nonlinear search that it had no time for, in words."""

    @property
    def engine(self) -> Engine:
        """Engine of this fit: evaluates normal blocks and residuals of runs at other unknowns."""
        return self.nonlinear or LinearEngine(self.box)

    @property
    def full(self) -> Real:
        """Full parameters at the optimum, (28,)."""
        return self.box.full(self.fit.eta.astype(complex)).real

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residuals, not reduced by the shared unknowns."""
        return sum(sum(r.freedom.values()) for r in self.residuals)

    @property
    def chi2_limit(self) -> float:
        """Upper limit of chi2/n if the model holds."""
        if self.freedom <= 0.0:
            return 1.0
        # Without rest, differences of residuals are worth more than half as many samples.
        quiet = sum(quiet_counts(self.records).values()) if self.rest else self.freedom / 2.0
        std = float(np.sqrt(2 / self.freedom + 2 / quiet))  # noise levels rest on finite samples
        # Five standard deviations; clocks fitted to arrival times and quantisation may cause 0.02.
        return 1.0 + max(0.02, 5.0 * std)

    @property
    def holds(self) -> bool:
        """True if the model explains the decays up to the noise."""
        return self.chi2_per_n <= self.chi2_limit

    @property
    def noise(self) -> dict[str, float]:
        """Noise that residuals are compared with: at rest where it was measured."""
        return floored(self.rest, self.decays) if self.rest else self.sigma


@lru_cache(maxsize=8)  # many gates ask for it
def linearised_at(estimation: Estimation) -> Linearised:
    """Return the linear model at the optimum, the channels weighted by their noise."""
    box = estimation.box
    # The sizes of elements follow the unknowns of the box in a nonlinear fit.
    eta = estimation.fit.eta[: len(box.prior_sigma)]
    return linearised(box, estimation.decays, estimation.noise, eta)


def estimate(box: GreyBox, records: Sequence[Record], starts: Sequence[Real]) -> Estimation:
    """Return the fit of all records from the stated end of the bump, or from later if it must be.

    `starts`, sequence of (15,) float64: parameters to begin from, the most trusted first; further
    ones are tried only where the earlier ones find no optimum.
    """
    from_stated_end = first_estimate(box, records, starts)
    return from_stated_end if from_stated_end.holds else later_estimate(from_stated_end, starts)


def first_estimate(box: GreyBox, records: Sequence[Record], starts: Sequence[Real]) -> Estimation:
    """Return the fit from the stated end of the bump; arguments as in `estimate`."""
    records = tuple(records)
    start_s = np.array([decay_start_s(record) for record in records])
    rest_noise = quiet_noise(records)
    near_eta = basin(box, records, rest_noise, start_s, [box.unknowns(theta) for theta in starts])
    fitted = _fitted_from(box, records, rest_noise, start_s, near_eta)
    return with_earlier_starts(fitted) if fitted.holds else fitted


def later_estimate(first: Estimation, starts: Sequence[Real]) -> Estimation:
    """Return the fit from the earliest later start from which the model holds, else `first`.

    A bump may be longer than stated; one that is not stated is taken as long enough.
    """
    box, records, rest_noise = first.box, first.records, first.rest
    # With the bump's last force in the window the first fit may have gone astray.
    start_etas = first.fit.eta, box.unknowns(starts[0])
    stated_s = np.array([decay_start_s(record) for record in records])
    # The shortest decay, too, keeps half a period of the wheels, 0.05 s.
    longest_delay_s = min(r.end_s - s for r, s in zip(records, stated_s, strict=True)) - 0.05
    # No later: a start after an error in the wheels' motion has died, in 0.2 s, would hide it.
    delays_s = [delay_s for delay_s in (0.02, 0.05) if delay_s < longest_delay_s]
    if not (delays_s and all(np.isfinite(record.bump_s) for record in records)):
        return first

    def best_search(delay_s: float) -> _Search:
        """Return the better of the searches on the decays that begin so much later."""
        start_s = stated_s + delay_s
        searches = (_search(box, records, rest_noise, start_s, eta) for eta in start_etas)
        return min(searches, key=lambda search: search.chi2_per_n)

    # A model that holds from some start holds from any later one: a search from the last one shows
    # whether the others are worth a fit.
    if best_search(delays_s[-1]).chi2_per_n >= _BASIN_CHI2:
        return first
    for delay_s in delays_s:
        near_eta = best_search(delay_s).eta
        fitted = _fitted_from(box, records, rest_noise, stated_s + delay_s, near_eta)
        if fitted.holds:
            return with_earlier_starts(replace(fitted, later_s=delay_s))
    return first


def basin(
    box: GreyBox, records: Records, rest_noise: Noise, start_s: Real, etas: Sequence[Real]
) -> Real:
    """Return the best optimum, (P,), that searches from some starts led to.

    No further start is taken after one that explains nearly all, or leads where another one led.
    `rest_noise`: noise at rest.  `start_s`,
    (n_records,): starts of the decays.  `etas`: where to begin, each (P,), at least one.
    """
    best = _search(box, records, rest_noise, start_s, etas[0])
    for eta in etas[1:]:
        if best.explains:
            break
        other = _search(box, records, rest_noise, start_s, eta)
        # Two searches whose costs differ by less than 1 % have led to one optimum.
        is_same_optimum = abs(other.chi2_per_n / best.chi2_per_n - 1.0) < 0.01
        best = min(best, other, key=lambda search: search.chi2_per_n)
        if is_same_optimum:
            break
    return best.eta


def with_earlier_starts(first: Estimation) -> Estimation:
    """Return the fit with each decay's start as far back as the model holds, with pooled noise.

    `first`: a fit whose starts are late enough, so that it holds.
    """
    best = first
    # Each fit shows a little more of the motion, so the starts are moved back three times at most.
    for _ in range(3):
        model = linearised_at(best)
        information = np.sum(list(best.fit.information.values()), axis=0)
        # Each unknown is known to a factor e before any run: else predictions would have no
        # covariance where runs do not determine the masses.
        covariance = np.linalg.inv(information + np.eye(len(information)))
        starts_s = [
            _earliest_start_s(model.points[d.mass_state], covariance, record, d, linear)
            for record, d, linear in zip(best.records, best.decays, model.linear, strict=True)
        ]
        if best is not first and starts_s == [d.start_s for d in best.decays]:
            break
        noise, eta = _pooled_noise(best), best.fit.eta
        moved = _fitted_from(best.box, best.records, best.rest, np.array(starts_s), eta, noise)
        if not moved.holds:
            break
        best = replace(moved, later_s=first.later_s)
    return best


@dataclass(frozen=True, slots=True)
class _Search:
    """Result of a search: the point (P,), its misfit, whether it explains nearly all."""

    eta: Real
    chi2_per_n: float
    explains: bool


def _search(box: GreyBox, records: Records, rest_noise: Noise, start_s: Real, eta: Real) -> _Search:
    """Return what a search on thinned samples finds from `eta`, which may be far off."""
    pairs = zip(records, start_s.tolist(), strict=True)
    # 250 Hz are enough to find the basin of the optimum.
    decays = tuple(record.decay(start).thinned(250.0) for record, start in pairs)
    sigma = floored(rest_noise or rough_noise(decays), decays)
    n_values = sum(decay.n_values for decay in decays)
    motion_power = sum(  # in units of the noise's power
        float(np.sum(r.values.var(axis=0) / [sigma[c.name] ** 2 for c in r.group.channels]))
        * len(r.values)
        for decay in decays
        for r in decay.recordings
    )
    # To a tenth of a standard deviation: a search is followed by a fit.
    fitted = fit(box, decays, sigma, eta, 0.1, 40, HOLD)
    # In the right basin even a wrong model leaves no more than 3 % of the motion's power.
    explains = fitted.cost < _BASIN_CHI2 * n_values + 0.03 * motion_power
    return _Search(fitted.eta, fitted.cost / n_values, explains)


def _fitted_from(
    box: GreyBox,
    records: Records,
    rest_noise: dict[str, float],
    start_s: Real,
    eta: Real,
    known_noise: dict[str, float] | None = None,
) -> Estimation:
    """Return the fit of the decays that begin at `start_s`, (n_records,), from near its optimum.

    `rest_noise`: noise at rest, which chi2/n is measured by.  `known_noise`: noise by which the
    channels are weighted, if another one is known.
    """
    decays = tuple(r.decay(float(s)) for r, s in zip(records, start_s, strict=True))
    sigma = floored(known_noise or rest_noise or rough_noise(decays), decays)
    # Without rest, noise and fit settle together in two more fits.
    for _ in range(1 if rest_noise else 3):
        fitted = fit(box, decays, sigma, eta, max_iterations=30)
        eta = fitted.eta
        residuals = residuals_of(linearised(box, decays, sigma, eta), decays, sigma)
        fit_sigma = sigma  # by which this fit is weighted
        if not rest_noise:
            sigma = floored(_residual_noise(residuals), decays)
    noise = floored(rest_noise, decays) if rest_noise else fit_sigma
    chi2 = sum(run.chi2(noise) for run in residuals)
    freedom = sum(sum(run.freedom.values()) for run in residuals) - len(box.parameters)
    chi2_per_n = chi2 / freedom if freedom > 0 else float("inf")
    return Estimation(box, records, fitted, decays, fit_sigma, rest_noise, residuals, chi2_per_n)


def _pooled_noise(estimation: Estimation) -> dict[str, float]:
    """Return the noise at rest pooled with that of the residuals, SI; empty without rest.

    There may be but a few dozen samples at rest.
    """
    rest_freedom, pooled = quiet_counts(estimation.records), {}
    for name, std in estimation.rest.items():
        runs = [run for run in estimation.residuals if name in run.values]
        squares = sum(float(run.values[name] @ run.values[name]) for run in runs)
        squares += rest_freedom[name] * std**2
        freedom = rest_freedom[name] + sum(run.freedom[name] for run in runs)
        pooled[name] = float(np.sqrt(squares / freedom))
    return pooled


def rough_noise(decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Return an upper bound of the noise from the samples themselves."""
    columns = by_channel(recording for decay in decays for recording in decay.recordings)
    return {
        name: max(float(difference_noise(values)) for values in each)
        for name, each in columns.items()
    }


def _residual_noise(residuals: Sequence[Residuals]) -> dict[str, float]:
    """Return each channel's noise, SI: the rough part of its residuals, over all decays alike."""
    variances: dict[str, list[Real]] = {}
    for run in residuals:
        for name, values in run.values.items():
            variances.setdefault(name, []).append(difference_noise(values) ** 2)
    return {name: float(np.sqrt(np.mean(each))) for name, each in variances.items()}


def floored(sigma: Noise, decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Return noise levels of at least 1e-5 of a channel's rms: noise-free data have rounding."""
    columns = by_channel(recording for decay in decays for recording in decay.recordings)
    rms = {
        name: float(np.sqrt(np.mean([values @ values / len(values) for values in each])))
        for name, each in columns.items()
    }
    # A channel of zeros has no noise, and zero has no inverse.
    return {name: max(std, 1e-5 * rms.get(name, 0.0), 1e-300) for name, std in sigma.items()}


# The vehicles from which a search may start -------------------------------------------------------

_MID_SIZE_CAR = np.array(
    [1500, 2500, 500, 40, 40, 20e3, 20e3, 200e3, 200e3, 1500, 1500, 1.3, 1.4, 0.75, 0.75]
)
"""SI, in the order of `daq.vehicle.PARAMETER_NAMES`: five masses and inertias, six springs and
dampers, four lengths."""


def generic_vehicles(usual: Real = _MID_SIZE_CAR) -> tuple[Real, ...]:
    """Return the vehicles, each (15,), from which a search may start: a car and its variants.

    The variants are lighter, heavier, stiffer and more strongly damped; together they lie within a
    factor of two or three of anything on four wheels that is bumped by hand.  `usual`, (15,): the
    car, as far as it is known.
    """
    factors = ((1.0, 1.0), (2.0, 2.0), (0.5, 0.5), (1.0, 2.0), (2.0, 1.0), (4.0, 4.0))
    return tuple(usual * np.repeat([mass, force, 1.0], [5, 6, 4]) for mass, force in factors)


# Where a free decay begins: how far back a fitted model explains a record -------------------------


def _earliest_start_s(
    point: StateModel, covariance: Real, record: Record, decay: FreeDecay, linear: LinearPart
) -> float:
    """Return the earliest start from which the samples are free decay, s.

    `point`: the fitted model for the record's mass state.  `covariance`, (P, P) float64: of the
    unknowns of the fit, finite.  `decay` and `linear`: from a start that is late enough, with its
    linear part.
    """
    onset = onset_s(record)
    from_s = record.start_s if onset is None else onset  # no decay can start before
    values_before = _values_before(point, covariance, record, decay, linear, from_s)
    instants_s, forced_s = _free_instants(*values_before)
    if forced_s is not None:
        channels = [c for r in decay.recordings for c in r.group.channels]
        # Accelerations of wheels show a force at once, all else within 10 ms.
        has_hubs = any(c.quantity is Quantity.HUB_ACCELERATION for c in channels)
        force_end_s = forced_s + (0.001 if has_hubs else 0.01)
        instants_s = [instant for instant in instants_s if instant > force_end_s]
    # A little before the sample, so that rounding does not cut it off.
    return decay.start_s + min(instants_s) - 1e-7 if instants_s else decay.start_s


def _values_before(
    point: StateModel,
    covariance: Real,
    record: Record,
    decay: FreeDecay,
    linear: LinearPart,
    from_s: float,
) -> tuple[Real, Real, Real, Real]:
    """Return the n values from `from_s` to the start, the last one first, in units of sigma.

    Returns their times from the start, s, negative, (n,); their slopes by the unknowns of the fit
    and the linear part of the run, (n, n_unknown); measured less predicted, (n,); and the
    covariance of the unknowns.  Arguments are those of `_earliest_start_s`.
    """
    modal_state = point.modes.W @ linear.solution[: len(point.modes.poles)]
    # Weighted products of the slopes by the linear part and by the unknowns.
    mixed = np.zeros((len(linear.solution), len(covariance)))
    times_s, rows, errors = [], [], []  # of each recording, its channels one after the other
    for recording, product, stack in zip(
        decay.recordings, linear.products, linear.coefficients, strict=True
    ):
        group = point.group(recording.group)
        J = slopes(point, group, modal_state)
        per_sigma = np.sqrt(group.weight)[:, None]
        weighted_stack = stack * group.weight[:, None, None]  # as J, first axis the channels
        mixed += np.tensordot(weighted_stack, product.gram[:, group.motion] @ J, ((0, 1), (0, 1)))
        cut = record.whole(recording).between(from_s, decay.start_s)
        before_start = replace(cut, time_s=cut.time_s + (from_s - decay.start_s))  # below zero
        basis = point.basis(before_start)
        # Slopes of the samples by the P unknowns and by the linear part, (n_channels, n, ..).
        by_unknown, by_linear = basis[:, group.motion] @ J, basis @ stack
        by_both = np.concatenate([by_unknown, by_linear], axis=2) * per_sigma[..., None]
        times_s.append(np.tile(before_start.time_s, len(stack)))
        rows.append(by_both.reshape(-1, by_both.shape[2]))
        errors.append(((before_start.values.T - by_linear @ linear.solution) * per_sigma).ravel())
    time_s = np.concatenate(times_s)
    order = np.argsort(-time_s, kind="stable")
    # Covariances: the linear part follows the unknowns (`across`), and has an error of its own with
    # all of them known.
    across = -linear.normal_inverse @ mixed @ covariance
    of_linear = linear.normal_inverse - across @ mixed.T @ linear.normal_inverse
    joint = np.block([[covariance, across.T], [across, of_linear]])
    return time_s[order], np.concatenate(rows)[order], np.concatenate(errors)[order], joint


def _free_instants(
    time_s: Real, by_unknown: Real, errors: Real, covariance: Real
) -> tuple[list[float], float | None]:
    """Return the times of free decay before the start, and that of the last force; None if none.

    Backwards from the start, the accepted instants predict the next one.  Arguments are those that
    `_values_before` returns.
    """
    change = np.zeros(by_unknown.shape[1])  # of the unknowns, by the accepted instants
    accepted: list[float] = []
    chi2s: list[tuple[float, int]] = []  # of the errors at each instant, and their number
    begins = np.flatnonzero(np.diff(time_s, prepend=np.inf))  # first value of each instant
    for begin, end in pairwise([*begins, len(time_s)]):
        rows, instant_s = by_unknown[begin:end], float(time_s[begin])
        error = errors[begin:end] - rows @ change
        row_covariance = rows @ covariance
        error_covariance = np.eye(len(error)) + row_covariance @ rows.T  # the noise has sigma 1
        gain_and_error = np.linalg.solve(error_covariance, np.column_stack([row_covariance, error]))
        gain, whitened = gain_and_error[:, :-1], gain_and_error[:, -1]
        chi2s.append((float(error @ whitened), len(error)))
        if _is_forced(chi2s):
            return accepted, instant_s
        accepted.append(instant_s)
        change = change + row_covariance.T @ whitened
        covariance = covariance - row_covariance.T @ gain
    return accepted, None


def _is_forced(chi2s: Sequence[tuple[float, int]]) -> bool:
    """Return whether the last instants, one or up to 16 together, are no free decay.

    `chi2s`: chi2 of the errors of prediction at each instant, and how many errors it is of.
    """
    for width in (1, 2, 4, 8, 16):  # many show a small force that one does not
        if width <= len(chi2s):
            window_chi2, freedom = np.sum(chi2s[-width:], axis=0).tolist()
            # The limit by Wilson and Hilferty (1931), at a normal deviate of 4.5: 3 in a million.
            variance = 2.0 / (9.0 * freedom)
            if window_chi2 > freedom * (1.0 - variance + 4.5 * variance**0.5) ** 3:
                return True
    return False
